//! The end of a firmware: how it came to it becomes the exit code of QEMU.

use core::panic::PanicInfo;
use cortex_m_rt::{ExceptionFrame, exception};
use semihosting::process;

/// Ends the emulation: all checks passed.
pub fn success() -> ! {
    process::exit(0)
}

/// Ends the emulation: a check failed and has been logged.
pub fn failure() -> ! {
    process::exit(1)
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    defmt::error!("{}", defmt::Display2Format(info));
    failure()
}

/// # Safety
/// Called by the hardware.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    defmt::error!("hard fault at {=u32:#010x}", frame.pc());
    failure()
}
