//! Sine and arctangent by themselves.

use crate::call::Arguments;
use crate::row::{Row, function};
use core::f64::consts::TAU;
use core::sync::atomic::AtomicI32;
use fixed::types::I16F16;
use hallservo::angle::ElectricalAngle;
use hallservo::trig;
use micromath::F32Ext;

pub const ROWS: &[Row] = &[
    Row::new("sine", "hallservo", function!(sine), angle, |a, r| sine_error(a, scaled(r.r0, 30))).budget(13),
    Row::new("sine (with cosine)", "idsp", function!(sine_idsp), angle, |a, r| sine_error(a, scaled(r.r0, 31))),
    Row::new("sine", "micromath", function!(sine_micromath), radians, |a, r| sine_error(a, r.s0.into())),
    Row::new("sine", "libm", function!(sine_libm), radians, |a, r| sine_error(a, r.s0.into())),
    Row::new("sine", "cordic, I16F16", function!(sine_cordic), fixed_radians, |a, r| sine_error(a, scaled(r.r0, 16))),
    Row::new("atan2, rad", "hallservo", function!(atan2), vector, |a, r| angle_error(a, turns(r.r0))),
    Row::new("atan2, rad", "idsp", function!(atan2_idsp), vector, |a, r| angle_error(a, turns(r.r0))),
    Row::new("atan2, rad", "micromath", function!(atan2_micromath), vector_f32, |a, r| {
        angle_error(a, r.s0 as f64 / TAU)
    }),
    Row::new("atan2, rad", "libm", function!(atan2_libm), vector_f32, |a, r| angle_error(a, r.s0 as f64 / TAU)),
    Row::new("atan2, rad", "cordic, I16F16", function!(atan2_cordic), vector_fixed, |a, r| {
        angle_error(a, scaled(r.r0, 16) / TAU)
    }),
];

#[unsafe(no_mangle)]
extern "C" fn sine(angle: i32) -> i32 {
    trig::sin(ElectricalAngle::from_bits(angle)).to_bits()
}

#[unsafe(no_mangle)]
extern "C" fn sine_idsp(angle: i32, cosine: &mut i32) -> i32 {
    let (cos, sin) = idsp::cossin(angle);
    *cosine = cos;
    sin
}

#[unsafe(no_mangle)]
extern "C" fn sine_micromath(angle: f32) -> f32 {
    F32Ext::sin(angle)
}

#[unsafe(no_mangle)]
extern "C" fn sine_libm(angle: f32) -> f32 {
    libm::sinf(angle)
}

#[unsafe(no_mangle)]
extern "C" fn sine_cordic(angle: i32) -> i32 {
    cordic::sin(I16F16::from_bits(angle)).to_bits()
}

#[unsafe(no_mangle)]
extern "C" fn atan2(y: i32, x: i32) -> i32 {
    trig::atan2(y, x).to_bits()
}

#[unsafe(no_mangle)]
extern "C" fn atan2_idsp(y: i32, x: i32) -> i32 {
    idsp::atan2(y, x)
}

#[unsafe(no_mangle)]
extern "C" fn atan2_micromath(y: f32, x: f32) -> f32 {
    F32Ext::atan2(y, x)
}

#[unsafe(no_mangle)]
extern "C" fn atan2_libm(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

#[unsafe(no_mangle)]
extern "C" fn atan2_cordic(y: i32, x: i32) -> i32 {
    cordic::atan2(I16F16::from_bits(y), I16F16::from_bits(x)).to_bits()
}

/// Angles all over the turn, their low bits stirred.
pub fn angle(index: u32) -> Arguments {
    static COSINE: AtomicI32 = AtomicI32::new(0);
    let bits = index.wrapping_mul(0x9E37_79B9);
    Arguments { r: [bits, COSINE.as_ptr().addr() as u32, 0, 0], turns: turns(bits), ..Default::default() }
}

fn radians(index: u32) -> Arguments {
    let arguments = angle(index);
    Arguments { s: [(arguments.turns * TAU) as f32, 0.0], ..arguments }
}

fn fixed_radians(index: u32) -> Arguments {
    let mut arguments = angle(index);
    arguments.r[0] = I16F16::from_num(arguments.turns * TAU).to_bits() as u32;
    arguments
}

/// (y, x) at the angle, with a length of about 2³⁰.
fn vector(index: u32) -> Arguments {
    let mut arguments = angle(index);
    let (sine, cosine) = libm::sincos(arguments.turns * TAU);
    arguments.r[0] = libm::ldexp(sine, 30) as i32 as u32;
    arguments.r[1] = libm::ldexp(cosine, 30) as i32 as u32;
    arguments
}

fn vector_f32(index: u32) -> Arguments {
    let arguments = angle(index);
    let (sine, cosine) = libm::sincos(arguments.turns * TAU);
    Arguments { s: [sine as f32, cosine as f32], ..arguments }
}

fn vector_fixed(index: u32) -> Arguments {
    let mut arguments = vector(index);
    for component in &mut arguments.r[..2] {
        *component = (*component as i32 >> 15) as u32;
    }
    arguments
}

pub fn turns(bits: u32) -> f64 {
    scaled(bits, 32)
}

fn scaled(bits: u32, fraction: i32) -> f64 {
    libm::ldexp(f64::from(bits as i32), -fraction)
}

fn sine_error(arguments: &Arguments, sine: f64) -> f64 {
    sine - libm::sin(arguments.turns * TAU)
}

/// In rad, the short way around.
pub fn angle_error(arguments: &Arguments, turns_found: f64) -> f64 {
    let error = turns_found - arguments.turns;
    (error - libm::round(error)) * TAU
}
