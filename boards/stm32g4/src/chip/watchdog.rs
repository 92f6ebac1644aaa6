//! The independent watchdog.

use crate::registers::watchdog::{FEED, START, UNLOCK, reload};
use embassy_stm32::pac::IWDG;
use embassy_stm32::pac::iwdg::regs::{Kr, Pr, Rlr};

/// A calibration's fit and a save keep the tasks from feeding it, which a test of the virtual boards times; and it may
/// come early by as much as its oscillator is fast, 5 %.
const MILLISECONDS: u32 = 600;

/// Starts it, for good.
pub(crate) fn start() {
    let (prescaler, counts) = const { reload(MILLISECONDS).unwrap() };
    IWDG.kr().write_value(Kr(START));
    IWDG.kr().write_value(Kr(UNLOCK));
    IWDG.pr().write_value(Pr(prescaler));
    IWDG.rlr().write_value(Rlr(counts));
    while IWDG.sr().read().0 != 0 {}
    feed();
}

/// Lets it start over.
pub(crate) fn feed() {
    IWDG.kr().write_value(Kr(FEED));
}
