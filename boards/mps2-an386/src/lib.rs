//! QEMU's `mps2-an386`: a Cortex-M4F with CMSDK timers. What its firmwares share.
#![no_std]

// Linked for what they provide: the log transport and the critical section.
use defmt_semihosting as _;
use shared as _;

pub mod control;
mod device;
mod exit;
pub mod tasks;
pub mod time;
mod timers;

pub use device::Interrupt;
pub use exit::{failure, success};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

/// Sets the priorities and starts the clock. To be called once, at first.
pub fn init() -> cortex_m::Peripherals {
    let Some(mut core) = cortex_m::Peripherals::take() else { failure() };
    shared::priority::init(&mut core.NVIC, &mut core.SCB, Interrupt::Timer0);
    time::init();
    core
}
