//! The sample of the latest control period: the control interrupt fills it, the tasks look at what changes slowly.

use core::cell::UnsafeCell;
use core::ptr::addr_of;
use hallservo::board::{LostPeriods, Sample, TemperatureCode};
use hallservo_app::Readings;

/// A sample and when it was taken.
struct Latest(UnsafeCell<(Sample, u32)>);

// SAFETY: written by the control interrupt alone; the tasks read single halves and words of it, each in one access.
unsafe impl Sync for Latest {}

static LATEST: Latest = Latest(UnsafeCell::new((
    Sample {
        halls: [0; 3],
        currents: [0; 3],
        bus: 0,
        temperatures: [TemperatureCode::MISSING; 2],
        lost: LostPeriods::NOT_COUNTED,
    },
    0,
)));

/// The place of the sample and of its cycle.
///
/// # Safety
/// For the control interrupt alone, which drops them before it ends.
#[inline(always)]
pub(crate) unsafe fn place() -> (&'static mut Sample, &'static mut u32) {
    // SAFETY: there is one control interrupt, and it does not interrupt itself.
    let (sample, cycle) = unsafe { &mut *LATEST.0.get() };
    (sample, cycle)
}

/// What the tasks look at.
pub(crate) fn readings() -> Readings {
    let latest = LATEST.0.get();
    // SAFETY: a pointer to the static, at which the interrupt writes valid values; each is read in one access.
    unsafe {
        Readings {
            periods: addr_of!((*latest).1).read_volatile(),
            bus: addr_of!((*latest).0.bus).read_volatile(),
            temperatures: [
                addr_of!((*latest).0.temperatures[0]).read_volatile(),
                addr_of!((*latest).0.temperatures[1]).read_volatile(),
            ],
        }
    }
}
