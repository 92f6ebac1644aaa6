//! embassy-time on the dual timer, in the motor's time.
//!
//! The emulated core is slow and computes the motor besides, so its clock does not run in the motor's time: one control
//! period, 25 µs of the motor's life, is stretched to [`PERIOD`] ticks of the timers. Tasks see the motor's time, so
//! that a task that runs every millisecond runs every 40 control periods, as on a board.

use crate::device::Interrupt;
use crate::timers::{ALARM, CLOCK, Slow};
use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::task::Waker;
use cortex_m::peripheral::NVIC;
use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

/// Control interrupts a second, in the motor's time.
pub const CONTROL_HZ: u32 = 40_000;
/// Ticks of the 25 MHz timers in a control period.
pub const PERIOD: u32 = Slow::DIVIDER * CLOCK_TICKS_A_MICROSECOND * (1_000_000 / CONTROL_HZ);

const CLOCK_TICKS_A_MICROSECOND: u32 = 64;
const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000);

struct DualTimer {
    wraps: AtomicU32,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static DRIVER: DualTimer = DualTimer {
    wraps: AtomicU32::new(0),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the clock at zero.
pub(crate) fn init() {
    CLOCK.run();
    // SAFETY: no critical section is open that this interrupt's being masked would have protected.
    unsafe { NVIC::unmask(Interrupt::DualTimer) };
}

impl Driver for DualTimer {
    fn now(&self) -> u64 {
        let ticks = critical_section::with(|_| {
            let before = CLOCK.elapsed();
            // Within the critical section a wrap stays requested until the handler counts it.
            if CLOCK.requests() {
                (u64::from(self.wraps.load(Relaxed)) + 1) << 32 | u64::from(CLOCK.elapsed())
            } else {
                u64::from(self.wraps.load(Relaxed)) << 32 | u64::from(before)
            }
        });
        ticks / u64::from(CLOCK_TICKS_A_MICROSECOND)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|section| {
            let mut queue = self.queue.borrow_ref_mut(section);
            if queue.schedule_wake(at, waker) {
                self.set_alarm(&mut queue);
            }
        });
    }
}

impl DualTimer {
    /// Wakes whose time has come and sets the alarm for the next. An alarm too far away comes early and does it again.
    fn set_alarm(&self, queue: &mut Queue) {
        let now = self.now();
        let next = queue.next_expiration(now);
        if next == u64::MAX {
            return;
        }
        let ticks = next.saturating_sub(now).saturating_mul(CLOCK_TICKS_A_MICROSECOND.into());
        ALARM.once(u32::try_from(ticks).unwrap_or(u32::MAX).max(1));
    }

    fn interrupt(&self, section: CriticalSection) {
        if CLOCK.requests() {
            CLOCK.clear();
            self.wraps.store(self.wraps.load(Relaxed) + 1, Relaxed);
        }
        if ALARM.requests() {
            ALARM.clear();
            self.set_alarm(&mut self.queue.borrow_ref_mut(section));
        }
    }
}

#[unsafe(no_mangle)]
extern "C" fn DUALTIMER() {
    critical_section::with(|section| DRIVER.interrupt(section));
}
