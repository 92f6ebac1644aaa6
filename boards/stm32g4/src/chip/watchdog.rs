//! The watchdogs. The independent one finds a task that hangs; the window watchdog a control interrupt that does not
//! come or does not end, and the chip's reset switches the bridge off: its pins float.

use crate::chip::bridge;
use crate::registers::clock::PCLK1_HZ;
use crate::registers::watchdog::{FEED, START, UNLOCK, WINDOW_LONG, WINDOW_SHORT, reload, window};
use embassy_stm32::pac::iwdg::regs::{Kr, Pr, Rlr};
use embassy_stm32::pac::wwdg::regs::{Cfr, Cr};
use embassy_stm32::pac::{IWDG, RCC, WWDG};

/// A calibration's fit and a save keep the tasks from feeding it, which a test of the virtual boards times; and it may
/// come early by as much as its oscillator is fast, 5 %.
const MILLISECONDS: u32 = 600;

/// Starts it, for good.
// Not inlined, it is compiled for size.
#[inline(never)]
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

/// Longest time from one control interrupt to the next, microseconds; off within 1 ms is promised. 128 times that is
/// more than the erase of a page takes, 25 ms.
const CONTROL_US: u32 = 500;

/// Starts the window watchdog, for good: it resets the chip [`CONTROL_US`] after the last [`refresh`].
pub(crate) fn start_window() {
    RCC.apb1enr1().modify(|enable| enable.set_wwdgen(true));
    WWDG.cfr().write_value(Cfr(WINDOW_SHORT));
    refresh();
}

/// Every control interrupt.
#[inline(always)]
pub(crate) fn refresh() {
    WWDG.cr().write_value(Cr(const { window(PCLK1_HZ, CONTROL_US).unwrap() }));
}

/// Does what may stall the core, with time for it, while the bridge is off; `None` if it is on. The bridge is not
/// switched on before that time is over ([`has_time`]), whatever the tasks have sent.
pub(crate) fn stalled<R>(operation: impl FnOnce() -> R) -> Option<R> {
    WWDG.cfr().write_value(Cfr(WINDOW_LONG));
    refresh();
    // Looked at after the above: from here on the control interrupt refuses.
    let done = if bridge::is_on() { None } else { Some(operation()) };
    refresh();
    WWDG.cfr().write_value(Cfr(WINDOW_SHORT));
    done
}

/// Whether the window watchdog has time for a stall.
pub(crate) fn has_time() -> bool {
    WWDG.cfr().read().0 & WINDOW_LONG != WINDOW_SHORT
}
