//! The output for a brake resistor: high is on. It needs a pull-down at the driver of its transistor, for after a reset,
//! which is what a control interrupt that hangs ends in, the pin floats.

use crate::wiring::ChopperOutput;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::regs::Bsrr;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{GPIOA, GPIOB, GPIOC};

const PORTS: [Gpio; 3] = [GPIOA, GPIOB, GPIOC];

/// The pin in use, for those who do not know the board: its number, and its port times 16.
static PIN: AtomicU8 = AtomicU8::new(NONE);

/// Beyond the ports.
const NONE: u8 = 16 * PORTS.len() as u8;

/// Makes it an output, off.
pub(crate) fn start(output: ChopperOutput) {
    set(output, false);
    PORTS[output.port].moder().modify(|mode| mode.set_moder(output.pin, Moder::OUTPUT));
    PIN.store((output.port * 16 + output.pin) as u8, Relaxed);
}

/// Switches it.
#[inline(always)]
pub(crate) fn set(output: ChopperOutput, on: bool) {
    let pin = 1 << output.pin;
    PORTS[output.port].bsrr().write_value(Bsrr(if on { pin } else { pin << 16 }));
}

/// Off, whatever the board is: where nothing will decide any more. A board without it has nothing here.
#[inline(always)]
pub(crate) fn off() {
    let pin = PIN.load(Relaxed);
    if let Some(port) = PORTS.get(usize::from(pin / 16)) {
        port.bsrr().write_value(Bsrr(1 << (16 + pin % 16)));
    }
}
