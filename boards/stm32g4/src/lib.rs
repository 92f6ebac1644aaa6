//! What the boards with an STM32G4 share. [`registers`] and [`sensing`] are pure and tested on the host; the rest exists on
//! the chip only.
#![cfg_attr(not(test), no_std)]

pub mod registers;
pub mod sensing;
