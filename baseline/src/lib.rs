//! The methods of the two papers as they are printed, but for the errors in print: what the drive's own are measured
//! against.

pub mod filter;
pub mod halls;
pub mod rings;
