//! Physics of the motor.
#![no_std]

pub mod rings;
