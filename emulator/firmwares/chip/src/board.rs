//! Which board this is, and how it is wired.

use stm32_metapac::gpio::{Gpio, vals::Moder};
use stm32_metapac::{DBGMCU, GPIOA, GPIOB, GPIOC, RCC};

/// Port, number, alternate function.
pub type Pin = (Gpio, usize, u8);

/// What a firmware has to know.
pub struct Board {
    /// CH1, CH1N to CH3, CH3N of TIM1 at the gate drivers.
    pub gates: [Pin; 6],
    /// The drivers' low-side inputs are inverted.
    pub low_inverted: bool,
    /// Channel of ADC1 and of ADC2 that has the bus voltage, divided.
    pub bus: u8,
    /// Channel of ADC1 that has the third Hall.
    pub hall: u8,
    /// TX and RX of USART2.
    pub serial: [Pin; 2],
}

const NUCLEO: Board = Board {
    gates: [(GPIOA, 8, 6), (GPIOA, 7, 6), (GPIOA, 9, 6), (GPIOB, 0, 6), (GPIOA, 10, 6), (GPIOB, 1, 6)],
    low_inverted: true,
    bus: 2,
    hall: 5,
    serial: [(GPIOA, 2, 7), (GPIOA, 3, 7)],
};

const ESC1: Board = Board {
    gates: [(GPIOA, 8, 6), (GPIOC, 13, 4), (GPIOA, 9, 6), (GPIOA, 12, 6), (GPIOA, 10, 6), (GPIOB, 15, 4)],
    low_inverted: false,
    bus: 1,
    hall: 14,
    serial: [(GPIOB, 3, 7), (GPIOB, 4, 7)],
};

/// By the chip: the Nucleo has an STM32G474.
pub fn board() -> &'static Board {
    // DEV_ID has 12 bits.
    if DBGMCU.idcode().read().0 & 0xfff == 0x469 { &NUCLEO } else { &ESC1 }
}

/// Gives pins to their alternate functions.
pub fn connect(pins: &[Pin]) {
    RCC.ahb2enr().modify(|enable| {
        enable.set_gpioaen(true);
        enable.set_gpioben(true);
        enable.set_gpiocen(true);
    });
    for &(port, pin, function) in pins {
        port.afr(pin / 8).modify(|afr| afr.set_afr(pin % 8, function));
        port.moder().modify(|moder| moder.set_moder(pin, Moder::ALTERNATE));
    }
}
