//! The last things that a firmware does: whatever went wrong, the bridge is off first.
//!
//! The independent watchdog is not fed any more, so the chip starts over within its time, with the bridge off. The window
//! watchdog would be sooner, before a probe has read the log.

use crate::chip::{bridge, chopper, storage, watchdog};
use core::arch::{asm, naked_asm};
use core::panic::PanicInfo;
use core::ptr::addr_of;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use cortex_m_rt::exception;

/// TIM1_BDTR.
const BDTR: usize = 0x4001_2C00 + 0x44;

/// Return addresses that a panic tells.
const DEPTH: usize = 6;

/// Tells where, but not what: texts, file names and what formats them would take a fifth of a small chip's flash. The
/// addresses that the latest calls return to, the innermost first, are lines of the source to `addr2line -ife FIRMWARE
/// ADDRESS…`.
#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    bridge::off();
    chopper::off();
    // The log itself may have been what panicked.
    static ONCE: AtomicBool = AtomicBool::new(false);
    if !ONCE.load(Relaxed) {
        ONCE.store(true, Relaxed);
        defmt::error!("panic, called from {=[?; 6]:#010x}; the bridge is off", callers());
    }
    cortex_m::asm::udf()
}

/// Every function of this target keeps a frame in r7: the caller's r7, and the address to return to.
#[inline(always)]
fn callers() -> [u32; DEPTH] {
    unsafe extern "C" {
        static _stack_end: u8;
        static _stack_start: u8;
    }
    let stack = addr_of!(_stack_end) as u32..addr_of!(_stack_start) as u32 - 7;
    let mut frame: u32;
    // SAFETY: looks at a register.
    unsafe { asm!("mov {}, r7", out(reg) frame, options(nomem, nostack, preserves_flags)) };
    let mut callers = [0; DEPTH];
    for caller in &mut callers {
        if !stack.contains(&frame) || !frame.is_multiple_of(4) {
            break;
        }
        // SAFETY: two aligned words within the memory of the stack.
        let [outer, back] = unsafe { core::ptr::read_volatile(frame as *const [u32; 2]) };
        *caller = back & !1;
        frame = outer;
    }
    callers
}

/// Nothing, if it comes from a record that a power cut has left half written.
#[exception]
unsafe fn NonMaskableInt() {
    if !storage::is_torn_record() {
        unexpected(-14);
    }
}

/// An interrupt that nobody expects.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    unexpected(number)
}

#[inline(never)]
fn unexpected(number: i16) -> ! {
    bridge::off();
    chopper::off();
    defmt::error!("interrupt {=i16} is not expected; the bridge is off", number);
    panic!()
}

/// Clears MOE before it uses the stack, for the stack may be what failed: it ends at the begin of the RAM. Where the
/// fault's own frame finds no room either, the core locks up instead, which is a break of TIM1. Then gets a stack to
/// tell of it.
///
/// # Safety
/// Called by the hardware.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn HardFault() -> ! {
    naked_asm!(
        "cpsid i",
        "movw r0, #{bdtr_low}",
        "movt r0, #{bdtr_high}",
        "ldr r1, [r0]",
        "bic r1, #0x8000",
        "str r1, [r0]",
        "mov r0, sp",
        "movw r1, #:lower16:_stack_end",
        "movt r1, #:upper16:_stack_end",
        "cmp r0, r1",
        "bhs 1f",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "mov sp, r1",
        "movs r0, #0",
        "1: b {fallen}",
        bdtr_low = const BDTR & 0xFFFF,
        bdtr_high = const BDTR >> 16,
        fallen = sym fallen,
    )
}

/// `frame`: what the exception pushed, null when there was no stack left for it.
unsafe extern "C" fn fallen(frame: *const [u32; 8]) -> ! {
    chopper::off();
    static ONCE: AtomicBool = AtomicBool::new(false);
    if !ONCE.load(Relaxed) {
        ONCE.store(true, Relaxed);
        // SAFETY: an exception frame lies where the stack pointer pointed when it was taken; null is looked at first.
        match unsafe { frame.as_ref() } {
            Some([.., pc, _]) => defmt::error!("hard fault at {=u32:#010x}; the bridge is off", *pc),
            None => defmt::error!("stack overflow; the bridge is off"),
        }
    }
    watchdog::start_window();
    loop {
        watchdog::refresh();
    }
}
