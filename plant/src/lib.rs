//! Physics of the motor.
#![no_std]

pub mod construction;
pub mod rings;
