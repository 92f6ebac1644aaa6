//! What the boards with an STM32G4 share. [`registers`], [`wiring`] and [`sensing`] are pure and tested on the host, with the
//! constants of every board; the rest exists on the chip only. A board adds its pins, its constants, and the way from ADC
//! results to a sample.
#![cfg_attr(target_os = "none", no_std)]

#[cfg(not(target_os = "none"))]
pub mod check;
pub mod registers;
pub mod sensing;
pub mod wiring;

#[cfg(target_os = "none")]
mod chip;
#[cfg(target_os = "none")]
pub use chip::*;
