//! Sine and arctangent.

use crate::{Arguments, Row, call::Function};
use core::f64::consts::TAU;
use fixed::types::I16F16;
use hallservo::angle::ElectricalAngle;
use hallservo::trig;
use micromath::F32Ext;

macro_rules! function {
    ($name:ident) => {
        // SAFETY: the type forgets the signature; `Row` pairs the function with arguments made for it.
        unsafe { core::mem::transmute::<*const (), Function>($name as *const ()) }
    };
}

pub const ROWS: &[Row] = &[
    Row {
        item: "sine",
        by: "hallservo",
        function: function!(sine),
        budget: Some(13),
        arguments: angle,
        error: |a, r| sine_error(a, scaled(r.r0, 30)),
    },
    Row {
        item: "sine and cosine",
        by: "idsp",
        function: function!(sine_idsp),
        budget: None,
        arguments: angle,
        error: |a, r| sine_error(a, scaled(r.r0, 31)),
    },
    Row {
        item: "sine",
        by: "micromath",
        function: function!(sine_micromath),
        budget: None,
        arguments: radians,
        error: |a, r| sine_error(a, r.s0.into()),
    },
    Row {
        item: "sine",
        by: "libm",
        function: function!(sine_libm),
        budget: None,
        arguments: radians,
        error: |a, r| sine_error(a, r.s0.into()),
    },
    Row {
        item: "sine",
        by: "cordic, 16 bit fraction",
        function: function!(sine_cordic),
        budget: None,
        arguments: fixed_radians,
        error: |a, r| sine_error(a, scaled(r.r0, 16)),
    },
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

/// Angles all over the turn; r3, which the functions ignore, keeps the angle for the error.
fn angle(index: u32) -> Arguments {
    static mut COSINE: i32 = 0;
    let bits = index.wrapping_mul(0x9E37_79B9);
    Arguments {
        r: [bits, (&raw mut COSINE).addr() as u32, 0, bits],
        ..Default::default()
    }
}

fn radians(index: u32) -> Arguments {
    let arguments = angle(index);
    Arguments {
        s: [(turns(&arguments) * TAU) as f32, 0.0],
        ..arguments
    }
}

fn fixed_radians(index: u32) -> Arguments {
    let mut arguments = angle(index);
    arguments.r[0] = I16F16::from_num(turns(&arguments) * TAU).to_bits() as u32;
    arguments
}

fn turns(arguments: &Arguments) -> f64 {
    scaled(arguments.r[3], 32)
}

fn scaled(bits: u32, fraction: i32) -> f64 {
    libm::ldexp(f64::from(bits as i32), -fraction)
}

fn sine_error(arguments: &Arguments, sine: f64) -> f64 {
    sine - libm::sin(turns(arguments) * TAU)
}
