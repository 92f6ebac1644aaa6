//! What the small firmwares for the virtual STM32G4 share. One image runs on both boards. It logs what it finds and
//! asserts what it can see by itself; an assertion that fails is a line of the log, and then a fault.
#![no_std]

mod board;
mod clock;
mod converter;
pub mod motor;

pub use board::{Board, board, connect};
pub use clock::{HCLK_HZ, full_speed, wait};
pub use converter::{ADC_ENABLE, calibrate, convert_at_trigger, enable_converters};

use defmt_rtt as _;

/// The end: everything held.
pub fn done() -> ! {
    defmt::info!("done");
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    defmt::error!("{}", defmt::Display2Format(info));
    cortex_m::asm::udf()
}
