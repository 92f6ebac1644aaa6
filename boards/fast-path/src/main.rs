//! [`Drive::step`] alone, linked. It never runs; that it links is the proof.
//!
//! Whatever the step needs must be here, and three things are not: a way to panic, a critical section and a logger. If
//! the optimised step can reach a panic, takes a critical section or logs, the link fails and names what is missing.
//! The size of the image is the size of the fast path with its tables; the sources of the drive's memory are not part
//! of it.
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use hallservo::board::{Output, Sample};
use hallservo::drive::Drive;

/// What the control interrupt calls.
#[unsafe(no_mangle)]
extern "C" fn step(drive: &mut Drive, sample: &Sample, output: &mut Output) {
    *output = drive.step(sample);
    #[cfg(feature = "index")]
    {
        output.compare[usize::from(sample.halls[0])] = 0;
    }
    #[cfg(feature = "lock")]
    critical_section::with(|_| output.compare[0] = 0);
    #[cfg(feature = "log")]
    defmt::error!("no");
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    unsafe extern "C" {
        fn the_step_can_panic() -> !;
    }
    // SAFETY: it does not exist, so this never runs: an image that can come here does not link.
    unsafe { the_step_can_panic() }
}
