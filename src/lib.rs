//! hallservo
#![no_std]

pub mod angle;
pub mod hall;
pub mod trig;
pub mod vernier;
