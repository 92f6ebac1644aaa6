//! `critical-section` by BASEPRI: masks everything but the control interrupt.
//!
//! The usual implementation sets PRIMASK, which masks every interrupt. A single log line under it delays the sample of
//! the motor by as long as the frame takes to write, whatever priority the control interrupt has.
//!
//! Sound as long as two rules hold. All interrupts that use data behind a critical section have a priority of
//! [`CEILING`] or below: [`crate::priority::init`] sees to it. The control interrupt at priority 0 neither takes a
//! critical section nor touches data behind one, which a mask cannot enforce: it shares data with the tasks by
//! lock-free means only. That `Drive::step` takes none is proven at link time by the `fast-path` image, which has no
//! implementation of critical sections to link with.

use crate::priority::CEILING;
use core::arch::asm;
use critical_section::{Impl, RawRestoreState};

struct BasePriority;
critical_section::set_impl!(BasePriority);

// SAFETY: one core; between `acquire` and `release` no handler of priority CEILING or below starts, so the section is
// not interrupted by anything that could enter another, by the rules above. Threads do not exist: executors are
// handlers themselves or the one thread mode, which cannot preempt.
unsafe impl Impl for BasePriority {
    unsafe fn acquire() -> RawRestoreState {
        let before: u8;
        // SAFETY: reads and writes a mask register only. Not `nomem`, so the compiler keeps the section's memory
        // accesses inside. BASEPRI_MAX only ever raises the mask, so sections nest, also in handlers. The core takes
        // no newly masked interrupt after the instruction, without a barrier (Armv7-M manual, B5.2.3).
        unsafe {
            asm!(
                "mrs {before}, BASEPRI",
                "msr BASEPRI_MAX, {ceiling}",
                before = out(reg) before,
                ceiling = in(reg) CEILING as u32,
                options(nostack, preserves_flags),
            );
        }
        before
    }

    unsafe fn release(before: RawRestoreState) {
        // SAFETY: restores what the matching `acquire` found; the outer section, if any, stays in force.
        unsafe {
            asm!("msr BASEPRI, {}", in(reg) before as u32, options(nostack, preserves_flags));
        }
    }
}
