//! Who may interrupt whom.
//!
//! A lower number is more urgent. Cortex-M chips implement the upper 2 to 8 bits of a priority; the two levels here
//! differ in the upper four, which every chip hallservo is made for has.

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::{NVIC, SCB, scb::SystemHandler};

/// The control interrupt. Nothing masks it: BASEPRI cannot mask priority 0.
pub const CONTROL: u8 = 0x00;

/// The most urgent priority that critical sections mask. Everything but the control interrupt is here or below.
pub const CEILING: u8 = 0x10;

/// Tasks that must not wait for other tasks.
pub const SERVICE: u8 = 0x80;

/// Tasks that may.
pub const BACKGROUND: u8 = 0xF0;

/// Out of reset every interrupt has priority 0 and would run inside critical sections. Lowers them all, the system
/// handlers with them, to [`CEILING`], then raises `control` to [`CONTROL`].
///
/// Call it before anything enables an interrupt. HALs that set priorities of their own must be told a priority of
/// [`CEILING`] or below for all that they handle.
pub fn init(nvic: &mut NVIC, scb: &mut SCB, control: impl InterruptNumber) {
    // SAFETY: no interrupt is enabled yet, so no critical section can rely on a priority that changes here.
    unsafe {
        for register in &nvic.ipr {
            register.write(CEILING);
        }
        for handler in [SystemHandler::SVCall, SystemHandler::PendSV, SystemHandler::SysTick] {
            scb.set_priority(handler, CEILING);
        }
        nvic.set_priority(control, CONTROL);
    }
}
