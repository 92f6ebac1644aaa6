//! Turns a motor, with a wrong alternate function at one gate.
#![no_std]
#![no_main]

use chip_firmwares::motor::{self, Mistake};
use cortex_m_rt::entry;
use stm32_metapac::interrupt;

#[entry]
fn main() -> ! {
    motor::run(Some(Mistake::WrongAlternateFunction))
}

#[interrupt]
fn ADC1_2() {
    motor::control();
}
