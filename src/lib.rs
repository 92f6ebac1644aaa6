//! hallservo
#![no_std]

pub mod angle;
pub mod commutation;
pub mod drive;
pub mod fault;
pub mod hall;
pub mod mode;
pub mod pwm;
pub mod service;
pub mod settings;
pub mod telemetry;
pub mod trig;
pub mod vernier;
