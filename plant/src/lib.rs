//! Physics of the motor.
#![no_std]
