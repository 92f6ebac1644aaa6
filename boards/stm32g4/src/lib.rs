//! What the boards with an STM32G4 share. [`registers`] and [`sensing`] are pure and tested on the host; the rest exists on
//! the chip only. A board adds pins, constants and the way from ADC results to a sample: [`Board`].
#![cfg_attr(not(test), no_std)]

pub mod registers;
pub mod sensing;

#[cfg(target_os = "none")]
mod chip;
#[cfg(target_os = "none")]
pub use chip::*;
