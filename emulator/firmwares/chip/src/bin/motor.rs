//! Turns a motor, without a mistake.
#![no_std]
#![no_main]

use chip_firmwares::motor;
use cortex_m_rt::entry;
use stm32_metapac::interrupt;

#[entry]
fn main() -> ! {
    motor::run(None)
}

#[interrupt]
fn ADC1_2() {
    motor::control();
}
