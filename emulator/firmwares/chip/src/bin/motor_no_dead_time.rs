//! Turns a motor, without dead time.
#![no_std]
#![no_main]

use chip_firmwares::motor::{self, Mistake};
use cortex_m_rt::entry;
use stm32_metapac::interrupt;

#[entry]
fn main() -> ! {
    motor::run(Some(Mistake::NoDeadTime))
}

#[interrupt]
fn ADC1_2() {
    motor::control();
}
