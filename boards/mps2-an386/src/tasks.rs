//! Two executors for tasks, each in an interrupt of its own that only software requests; the thread mode idles.
//!
//! It idles without sleeping. QEMU takes the WFE of embassy's thread executor for a pause that costs a microsecond of
//! the host's time, and lets virtual time jump where WFI stops the core, once too far.

use crate::device::Interrupt;
use cortex_m::peripheral::NVIC;
use embassy_executor::{InterruptExecutor, SendSpawner};
use shared::priority;

static SERVICE: InterruptExecutor = InterruptExecutor::new();
static BACKGROUND: InterruptExecutor = InterruptExecutor::new();

/// Starts both: for tasks that must not wait for others, and for the others.
pub fn start(nvic: &mut NVIC) -> [SendSpawner; 2] {
    // SAFETY: below the ceiling of critical sections, and not enabled yet.
    unsafe {
        nvic.set_priority(Interrupt::Timer1, priority::SERVICE);
        nvic.set_priority(Interrupt::Uart0, priority::BACKGROUND);
    }
    [SERVICE.start(Interrupt::Timer1), BACKGROUND.start(Interrupt::Uart0)]
}

/// Leaves the thread mode idle; everything else happens in interrupts.
pub fn idle() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}

#[unsafe(no_mangle)]
extern "C" fn TIMER1() {
    // SAFETY: called from the interrupt that this executor was started with, only.
    unsafe { SERVICE.on_interrupt() }
}

#[unsafe(no_mangle)]
extern "C" fn UART0() {
    // SAFETY: called from the interrupt that this executor was started with, only.
    unsafe { BACKGROUND.on_interrupt() }
}
