//! What the small firmwares share: text by semihosting, and interrupt vectors.
#![no_std]

use core::arch::asm;
use core::fmt::{self, Write};

/// Interrupt lines with vectors.
pub const LINES: usize = 8;

/// A semihosting call (SYS_WRITE0 4, SYS_EXIT 0x18).
///
/// # Safety
/// `argument` must be what the operation asks for.
unsafe fn call(operation: u32, argument: usize) {
    // SAFETY: the debugger, or what stands in for it, reads the argument only.
    unsafe { asm!("bkpt 0xAB", inout("r0") operation => _, in("r1") argument, options(nostack)) }
}

/// Prints through the debugger.
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut buffer = [0; 64];
        for chunk in text.as_bytes().chunks(buffer.len() - 1) {
            buffer[..chunk.len()].copy_from_slice(chunk);
            buffer[chunk.len()] = 0;
            // SAFETY: SYS_WRITE0 takes a zero-terminated string.
            unsafe { call(4, buffer.as_ptr() as usize) };
        }
        Ok(())
    }
}

/// `println!` of a host.
#[macro_export]
macro_rules! say {
    ($($argument:tt)*) => {{
        use core::fmt::Write;
        writeln!($crate::Console, $($argument)*).ok();
    }};
}

/// Ends the run.
pub fn exit() -> ! {
    // SAFETY: SYS_EXIT with ADP_Stopped_ApplicationExit.
    unsafe { call(0x18, 0x2_0026) };
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    say!("{info}");
    exit()
}
