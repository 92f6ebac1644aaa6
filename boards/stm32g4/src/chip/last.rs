//! The last things that a firmware does: whatever went wrong, the bridge is off first.
//!
//! The watchdog is not fed any more, so the chip starts over within its time, with the bridge off.

use crate::chip::bridge;
use core::arch::naked_asm;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use cortex_m_rt::exception;

/// TIM1_BDTR.
const BDTR: usize = 0x4001_2C44;
const _: () = assert!(BDTR == 0x4001_2C00 + 0x44);

/// Tells where, but not what: the texts and what formats them would take a fifth of a small chip's flash.
#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    bridge::off();
    // The log itself may have been what panicked.
    static ONCE: AtomicBool = AtomicBool::new(false);
    if !ONCE.load(Relaxed) {
        ONCE.store(true, Relaxed);
        let (file, line) = info.location().map_or(("", 0), |place| (place.file(), place.line()));
        defmt::error!("panic at {=str}:{=u32}; the bridge is off", file, line);
    }
    cortex_m::asm::udf()
}

/// An interrupt that nobody expects.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    bridge::off();
    defmt::error!("interrupt {=i16} is not expected; the bridge is off", number);
    panic!()
}

/// Clears MOE before it uses the stack, for the stack may be what failed: it ends at the begin of the RAM. Where the fault's own
/// frame finds no room either, the core locks up instead, which is a break of TIM1. Then gets a stack to tell of it.
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
    static ONCE: AtomicBool = AtomicBool::new(false);
    if !ONCE.load(Relaxed) {
        ONCE.store(true, Relaxed);
        // SAFETY: an exception frame lies where the stack pointer pointed when it was taken; null is looked at first.
        match unsafe { frame.as_ref() } {
            Some([.., pc, _]) => defmt::error!("hard fault at {=u32:#010x}; the bridge is off", *pc),
            None => defmt::error!("stack overflow; the bridge is off"),
        }
    }
    loop {
        cortex_m::asm::nop();
    }
}
