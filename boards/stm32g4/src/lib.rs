//! What the boards with an STM32G4 share. [`registers`] and [`wiring`] are pure and tested on the host, with the
//! constants of every board; the rest exists on the chip only. A board adds its pins, its constants, and the way from
//! ADC results to a sample.
#![cfg_attr(target_os = "none", no_std)]

#[cfg(not(target_os = "none"))]
pub mod check;
pub mod divide;
pub mod registers;
pub mod wiring;

/// The ADCs have 12 bits.
pub type Adc = hallservo::board::sensing::Adc<12>;

#[cfg(target_os = "none")]
mod chip;
#[cfg(target_os = "none")]
pub use chip::*;
