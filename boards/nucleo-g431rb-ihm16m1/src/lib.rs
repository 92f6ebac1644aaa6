//! What the registers of a Nucleo-G431RB with an X-NUCLEO-IHM16M1 hold.
#![cfg_attr(target_os = "none", no_std)]

pub mod constants;

#[cfg(test)]
mod registers;
