//! An update of the adaptation, which no interrupt waits for: three Halls into eleven states.

use crate::call::Arguments;
use crate::halls::model_codes;
use crate::row::{Row, function};
use crate::trig::{angle_error, turns};
use core::f64::consts::TAU;
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::angle::ElectricalAngle;
use hallservo::hall::adapt::{Adapter, Observation, Settings};
use hallservo::hall::model::Model;
use mps2_an386::failure;
use static_cell::StaticCell;

#[rustfmt::skip]
pub const ROWS: &[Row] = &[
    Row::new("EKF update, 11 states, rad", "hallservo", function!(adapt), swinging, |a, r| angle_error(a, turns(r.r0))).budget(2300),
    Row::new("the same, turns seen whole", "hallservo", function!(adapt), turning, |a, r| angle_error(a, turns(r.r0))),
];

struct Bench {
    adapter: Adapter,
    observation: Observation,
}

#[unsafe(no_mangle)]
extern "C" fn adapt(adapter: &mut Adapter, observation: &Observation) -> i32 {
    adapter.update(observation);
    adapter.hall_angle().to_bits()
}

static BENCH: AtomicPtr<Bench> = AtomicPtr::new(core::ptr::null_mut());

/// Makes the filter that the rows use, and lets it find the rotor.
pub fn init() {
    static PLACE: StaticCell<Bench> = StaticCell::new();
    let model = Model::nominal(12, 1900.0, ElectricalAngle::THIRD);
    let settings = Settings { noise_codes: [20.0; 3], damping_nms: 0.0, ..Settings::default() };
    let adapter = settings.validate().ok().and_then(|config| Adapter::new(&config, &model).ok());
    let observation = Observation { codes: [0; 3], elapsed: 1, torque_nm: 0.0 };
    BENCH.store(PLACE.init(Bench { adapter: adapter.unwrap_or_else(|| failure()), observation }), Relaxed);
    for _ in 0..64 {
        let bench = bench();
        bench.observation.codes = model_codes(0);
        bench.adapter.update(&bench.observation);
    }
}

fn bench() -> &'static mut Bench {
    // SAFETY: null, or a static that nobody else uses, each time for the length of a call.
    unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

/// Over 216° and back, at up to 2.7 Hz: learning, but for the reversals, and never a whole turn.
fn swinging(index: u32) -> Arguments {
    at((0.3 * libm::sin(TAU * f64::from(index) / 700.0) * 4_294_967_296.0) as i64 as u32)
}

/// On from where the swing ended, at up to 10 Hz.
fn turning(index: u32) -> Arguments {
    let (swung, sped) = (0.3 * libm::sin(TAU * 16_383.0 / 700.0), f64::from(index.min(1000)));
    let turned = sped * sped * 0.5e-5 + 0.01 * f64::from(index.saturating_sub(1000));
    at(((swung + turned) * 4_294_967_296.0) as i64 as u32)
}

fn at(angle: u32) -> Arguments {
    let bench = bench();
    bench.observation.codes = model_codes(angle);
    let (adapter, observation) = ((&raw mut bench.adapter).addr(), (&raw const bench.observation).addr());
    Arguments { r: [adapter as u32, observation as u32, 0, 0], turns: turns(angle), ..Default::default() }
}
