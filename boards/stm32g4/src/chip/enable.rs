//! The enable input: off by wire, in the next control period.

use crate::wiring::EnableInput;
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Moder, Pupdr};
use embassy_stm32::pac::{GPIOA, GPIOB, GPIOC};

const PORTS: [Gpio; 3] = [GPIOA, GPIOB, GPIOC];

/// Makes it an input that is low unless something is wired to it.
pub(crate) fn start(input: EnableInput) {
    let port = PORTS[input.port];
    port.pupdr().modify(|pull| pull.set_pupdr(input.pin, Pupdr::PULL_DOWN));
    port.moder().modify(|mode| mode.set_moder(input.pin, Moder::INPUT));
}

/// Whether the bridge may be on.
#[inline(always)]
pub(crate) fn is_closed(input: EnableInput) -> bool {
    PORTS[input.port].idr().read().0 >> input.pin & 1 != 0
}
