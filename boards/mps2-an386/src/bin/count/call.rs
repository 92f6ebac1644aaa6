//! Calls a function and counts the instructions that it executes, exactly.
//!
//! QEMU's `-icount` makes virtual time a count of instructions, and the runner sets 128 ns for each. SysTick counts
//! 25 MHz, 3.2 ticks an instruction, so a difference of two readings gives the number without doubt.

use core::arch::naked_asm;
use cortex_m::peripheral::{SYST, syst::SystClkSource};

/// What a function of the C calling convention finds in its registers, and what it should make of it.
#[derive(Clone, Copy, Default)]
#[repr(C)]
pub struct Arguments {
    /// r0 to r3: integers and pointers.
    pub r: [u32; 4],
    /// s0 and s1: floats.
    pub s: [f32; 2],
    /// What the function should find, for the error: an angle in turns.
    pub turns: f64,
}

/// What it leaves there.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Results {
    /// r0.
    pub r0: u32,
    /// s0.
    pub s0: f32,
}

/// A function of any signature that fits [`Arguments`] and [`Results`].
pub type Function = unsafe extern "C" fn();

/// Counts from the first instruction of a function to its return, both included.
pub struct Counter {
    /// Ticks of the call itself.
    overhead: u32,
}

impl Counter {
    pub fn new(systick: &mut SYST) -> Self {
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(0xFF_FFFF);
        systick.clear_current();
        systick.enable_counter();
        // SAFETY: `nothing` has no arguments and no effect.
        let (_, ticks) = unsafe { ticks(nothing, Arguments::default()) };
        Self { overhead: ticks }
    }

    /// # Safety
    /// `function` must be callable with these arguments in the registers.
    pub unsafe fn call(&self, function: Function, arguments: Arguments) -> (Results, u32) {
        // SAFETY: the caller's promise.
        let (results, ticks) = unsafe { ticks(function, arguments) };
        // `nothing` is one instruction. 16/5 ticks each, rounded.
        (results, 1 + ((ticks - self.overhead) * 5 + 8) / 16)
    }
}

/// Returns at once: one instruction.
#[unsafe(naked)]
unsafe extern "C" fn nothing() {
    naked_asm!("bx lr")
}

/// Calls with the clock read directly before and after; returns the ticks between, at most 2²⁴ − 1.
///
/// # Safety
/// As for [`Counter::call`].
unsafe fn ticks(function: Function, arguments: Arguments) -> (Results, u32) {
    let mut results = Results { r0: 0, s0: 0.0 };
    // SAFETY: reads a clock register without side effects; the caller vouches for the call.
    let ticks = unsafe { call_between_readings(function, &arguments, &mut results, SYST::PTR.byte_add(8).cast()) };
    (results, ticks & 0xFF_FFFF)
}

#[unsafe(naked)]
unsafe extern "C" fn call_between_readings(
    function: Function,
    arguments: &Arguments,
    results: &mut Results,
    clock: *const u32,
) -> u32 {
    naked_asm!(
        "push {{r4-r8, lr}}",
        "mov r4, r3",
        "mov r6, r2",
        "mov r7, r0",
        "vldr s0, [r1, #16]",
        "vldr s1, [r1, #20]",
        "ldm r1, {{r0-r3}}",
        "ldr r5, [r4]",
        "blx r7",
        "ldr r4, [r4]",
        "str r0, [r6]",
        "vstr s0, [r6, #4]",
        // SysTick counts down.
        "sub r0, r5, r4",
        "pop {{r4-r8, pc}}",
    )
}
