//! Three Halls to the electrical angle: 12-bit codes of ideal sensors 120° apart, in memory as the ADC leaves them.

use crate::call::Arguments;
use crate::row::{Row, function};
use crate::trig::{angle_error, turns};
use core::f64::consts::TAU;
use core::sync::atomic::{AtomicPtr, AtomicU16, Ordering::Relaxed};
use fixed::types::I16F16;
use hallservo::angle::ElectricalAngle;
use hallservo::hall::{Codes, estimate::Estimator, model::Model};
use micromath::F32Ext;
use mps2_an386::failure;
use static_cell::StaticCell;

const OFFSET: i32 = 2048;
const AMPLITUDE: f32 = 1900.0;

pub const ROWS: &[Row] = &[
    Row::new("three Halls → angle, rad", "hallservo", function!(halls), codes, |a, r| angle_error(a, turns(r.r0)))
        .budget(40),
    Row::new("the same, with every check", "hallservo", function!(halls_checked), codes, |a, r| {
        angle_error(a, turns(r.r0))
    }),
    Row::new("three Halls → angle, rad", "idsp", function!(halls_idsp), codes, |a, r| angle_error(a, turns(r.r0))),
    Row::new("three Halls → angle, rad", "micromath", function!(halls_micromath), codes, |a, r| {
        angle_error(a, r.s0 as f64 / TAU)
    }),
    Row::new("three Halls → angle, rad", "libm", function!(halls_libm), codes, |a, r| {
        angle_error(a, r.s0 as f64 / TAU)
    }),
    Row::new("three Halls → angle, rad", "cordic, I16F16", function!(halls_cordic), codes, |a, r| {
        angle_error(a, turns(r.r0) * 65536.0 / TAU)
    }),
];

#[unsafe(no_mangle)]
extern "C" fn halls(codes: &Codes, estimator: &Estimator) -> i32 {
    estimator.angle_unchecked(codes).to_bits()
}

#[unsafe(no_mangle)]
extern "C" fn halls_checked(codes: &Codes, estimator: &Estimator) -> i32 {
    estimator.angle(codes).map_or(0, ElectricalAngle::to_bits)
}

#[unsafe(no_mangle)]
extern "C" fn halls_idsp(codes: &Codes) -> i32 {
    let (y, x) = clarke(codes);
    idsp::atan2(y, x)
}

#[unsafe(no_mangle)]
extern "C" fn halls_micromath(codes: &Codes) -> f32 {
    let (y, x) = clarke(codes);
    F32Ext::atan2(y as f32, x as f32)
}

#[unsafe(no_mangle)]
extern "C" fn halls_libm(codes: &Codes) -> f32 {
    let (y, x) = clarke(codes);
    libm::atan2f(y as f32, x as f32)
}

#[unsafe(no_mangle)]
extern "C" fn halls_cordic(codes: &Codes) -> i32 {
    let (y, x) = clarke(codes);
    // Scaled to about ±1, its domain.
    cordic::atan2(I16F16::from_bits(y >> 12), I16F16::from_bits(x >> 12)).to_bits()
}

/// (sin, cos) of sensors 0°, 120° and 240° behind the rotor, about 2²⁷·⁵ long: what a peer needs in front of its
/// arctangent, without any calibration.
#[inline(always)]
pub fn clarke(codes: &Codes) -> (i32, i32) {
    const ONE: i32 = 1 << 15;
    const SQRT_3: i32 = 56_756;
    let [a, b, c] = codes.map(|code| i32::from(code) - OFFSET);
    ((2 * a - b - c) * ONE, (c - b) * SQRT_3)
}

static ESTIMATOR: AtomicPtr<Estimator> = AtomicPtr::new(core::ptr::null_mut());

/// Ideal sensors.
pub fn model() -> Model {
    Model::nominal(12, AMPLITUDE, ElectricalAngle::THIRD)
}

/// For ideal sensors.
pub fn new_estimator() -> Estimator {
    Estimator::new(&model(), 12).unwrap_or_else(|_| failure())
}

/// Makes the estimator that the rows use.
pub fn init() {
    static PLACE: StaticCell<Estimator> = StaticCell::new();
    ESTIMATOR.store(PLACE.init(new_estimator()), Relaxed);
}

/// The estimator that [`init`] has made.
pub fn estimator() -> &'static Estimator {
    // SAFETY: null, or a static that is never written again.
    unsafe { ESTIMATOR.load(Relaxed).as_ref() }.unwrap_or_else(|| failure())
}

fn codes(index: u32) -> Arguments {
    codes_at(index.wrapping_mul(0x9E37_79B9))
}

/// The codes of ideal sensors at an angle.
pub fn model_codes(angle: u32) -> Codes {
    [0, 1, 2].map(|k| {
        let wave = libm::sin((turns(angle) - f64::from(k) / 3.0) * TAU);
        libm::round(f64::from(OFFSET) + f64::from(AMPLITUDE) * wave) as u16
    })
}

/// r0: the codes at an angle, r1: the estimator.
pub fn codes_at(angle: u32) -> Arguments {
    static CODES: [AtomicU16; 3] = [const { AtomicU16::new(0) }; 3];
    for (place, code) in CODES.iter().zip(model_codes(angle)) {
        place.store(code, Relaxed);
    }
    let estimator = (&raw const *estimator()).addr() as u32;
    Arguments { r: [CODES.as_ptr().addr() as u32, estimator, 0, 0], turns: turns(angle), ..Default::default() }
}
