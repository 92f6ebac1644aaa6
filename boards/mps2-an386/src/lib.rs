//! QEMU's `mps2-an386`: a Cortex-M4F with CMSDK timers. What its firmwares share.
#![no_std]

// Linked for what they provide: the log transport and the critical section.
use defmt_semihosting as _;
use shared as _;

mod device;
mod exit;
pub mod time;
mod timers;

pub use device::Interrupt;
pub use exit::{failure, success};
