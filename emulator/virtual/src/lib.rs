//! A virtual board: the firmware on its chip, the chip on its board, a motor at its pins; scripts that do things to
//! them, and a report of what was seen.

pub mod adapter;
pub mod angle;
pub mod bus;
pub mod firmware;
pub mod outcome;
pub mod report;
mod request;
pub mod script;
pub mod serial;
pub mod session;
pub mod typed;

/// The README's example compiles.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
