//! What the registers of a B-G431B-ESC1 hold.
#![cfg_attr(target_os = "none", no_std)]

pub mod constants;

#[cfg(test)]
mod registers;
