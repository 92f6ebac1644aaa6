#![no_std]
#![no_main]
use embassy_stm32 as _;
use stm32g4 as _;
#[panic_handler]
fn p(_: &core::panic::PanicInfo) -> ! { loop {} }
