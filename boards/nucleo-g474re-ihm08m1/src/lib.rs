//! What the registers of a Nucleo-G474RE with an X-NUCLEO-IHM08M1 hold.
#![cfg_attr(target_os = "none", no_std)]

pub mod constants;
pub mod heads;
#[cfg(target_os = "none")]
pub mod pins;

#[cfg(test)]
mod registers;
