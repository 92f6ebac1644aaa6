//! The adaptation's filter: one update with three sensors, on a rotor that turns steadily, while it learns.

use crate::call::Arguments;
use crate::halls;
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::hall::adapt::{Adapter, Observation, Outcome, Settings};
use mps2_an386::failure;
use static_cell::StaticCell;

#[rustfmt::skip]
pub const ROWS: &[Row] = &[
    Row::new("adaptation, one update", "hallservo", function!(adapt), turning, |_, _| 0.0).budget(1500),
];

#[unsafe(no_mangle)]
extern "C" fn adapt(adapter: &mut Adapter, observation: &Observation) -> u32 {
    u32::from(matches!(adapter.update(observation), Outcome::Learning | Outcome::Learnt))
}

struct Bench {
    adapter: Adapter,
    observation: Observation,
    angle: u32,
}

static BENCH: AtomicPtr<Bench> = AtomicPtr::new(core::ptr::null_mut());

/// 10 Hz electrical at a thousand samples a second.
const STEP: u32 = u32::MAX / 100;

/// A filter that has begun to learn.
pub fn init() {
    static PLACE: StaticCell<Bench> = StaticCell::new();
    let Ok(config) = Settings::default().validate() else { failure() };
    let Ok(adapter) = Adapter::new(&config, &halls::model()) else { failure() };
    let observation = Observation { codes: halls::model_codes(0), elapsed: 1, torque_nm: 0.0 };
    let bench = PLACE.init(Bench { adapter, observation, angle: 0 });
    let mut learns = 0;
    for _ in 0..300 {
        bench.turn();
        learns = adapt(&mut bench.adapter, &bench.observation);
    }
    if learns == 0 {
        failure();
    }
    BENCH.store(bench, Relaxed);
}

impl Bench {
    fn turn(&mut self) {
        self.angle = self.angle.wrapping_add(STEP);
        self.observation.codes = halls::model_codes(self.angle);
    }
}

/// r0: the filter, r1: the next observation.
fn turning(_: u32) -> Arguments {
    // SAFETY: a static that only the row that is being counted uses.
    let bench = unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure());
    bench.turn();
    let r = [(&raw const bench.adapter).addr() as u32, (&raw const bench.observation).addr() as u32, 0, 0];
    Arguments { r, ..Default::default() }
}
