//! Pins: outputs, pulls, a button, the lock. In the end it writes to a locked pin, which is to be reported.
#![no_std]
#![no_main]

use chip_firmwares::{board, connect, done};
use cortex_m_rt::entry;
use stm32_metapac::gpio::regs::{Bsrr, Lckr, Odr};
use stm32_metapac::gpio::vals::{Moder, Ot, Pupdr};
use stm32_metapac::{GPIOB, GPIOC};

/// PB5 is wired to nothing on either board.
const PIN: usize = 5;

#[entry]
fn main() -> ! {
    // The clocks of the ports, and a pin with a function beside.
    connect(&board().serial[..1]);
    let level = || GPIOB.idr().read().0 >> PIN & 1;
    let mode = |mode| GPIOB.moder().modify(|moder| moder.set_moder(PIN, mode));
    let pull = |pull| GPIOB.pupdr().modify(|pupdr| pupdr.set_pupdr(PIN, pull));

    mode(Moder::OUTPUT);
    GPIOB.bsrr().write_value(Bsrr(1 << PIN));
    assert_eq!(level(), 1, "set");
    GPIOB.bsrr().write_value(Bsrr(1 << (PIN + 16)));
    assert_eq!(level(), 0, "reset");
    GPIOB.bsrr().write_value(Bsrr(1 << PIN | 1 << (PIN + 16)));
    assert_eq!(level(), 1, "setting goes before");

    GPIOB.otyper().modify(|otyper| otyper.set_ot(PIN, Ot::OPEN_DRAIN));
    pull(Pupdr::PULL_DOWN);
    assert_eq!(level(), 0, "an open drain drives no high");
    pull(Pupdr::PULL_UP);
    assert_eq!(level(), 1);
    GPIOB.odr().write_value(Odr(0));
    assert_eq!(level(), 0, "but low");

    mode(Moder::INPUT);
    assert_eq!(level(), 1, "the pull-up again");
    mode(Moder::ANALOG);
    assert_eq!(level(), 0, "the Schmitt trigger is off");

    // The board pulls its button's pin up: PC13 or PC10.
    GPIOC.moder().modify(|moder| [10, 13].map(|pin| moder.set_moder(pin, Moder::INPUT)));
    assert_ne!(GPIOC.idr().read().0 & (1 << 13 | 1 << 10), 0);

    for key in [1 << 16, 0, 1 << 16] {
        GPIOB.lckr().write_value(Lckr(key | 1 << PIN));
    }
    assert_ne!(GPIOB.lckr().read().0 & 1 << 16, 0, "locked");
    mode(Moder::OUTPUT);
    assert_eq!(GPIOB.moder().read().moder(PIN), Moder::ANALOG);
    done()
}
