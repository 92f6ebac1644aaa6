//! hallservo
#![no_std]

pub mod angle;
pub mod commutation;
pub mod hall;
pub mod pwm;
pub mod trig;
