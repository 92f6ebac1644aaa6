//! Time for the tasks: TIM2 counts microseconds with 32 bits, and interrupts when somebody is to be woken.

use crate::registers::clock::{HCLK_HZ, prescaler};
use core::cell::RefCell;
use core::task::Waker;
use cortex_m::peripheral::NVIC;
use critical_section::Mutex;
use embassy_stm32::interrupt;
use embassy_stm32::pac::timer::regs::SrGp16;
use embassy_stm32::pac::{Interrupt, RCC, TIM2};
use embassy_time::TICK_HZ;
use embassy_time_driver::{Driver, time_driver_impl};
use embassy_time_queue_utils::Queue;

struct Time(Mutex<RefCell<Kept>>);

struct Kept {
    now: u64,
    queue: Queue,
}

time_driver_impl!(static TIME: Time = Time(Mutex::new(RefCell::new(Kept { now: 0, queue: Queue::new() }))));

/// Starts to count, once the clocks run.
pub(crate) fn start() {
    RCC.apb1enr1().modify(|enable| enable.set_tim2en(true));
    TIM2.psc().write_value(const { prescaler(HCLK_HZ, TICK_HZ as u32) });
    TIM2.egr().write(|egr| egr.set_ug(true));
    TIM2.dier().write(|dier| dier.set_ccie(0, true));
    TIM2.cr1().write(|cr1| cr1.set_cen(true));
    // SAFETY: what it shares with the tasks is behind critical sections, whose ceiling is its priority.
    unsafe { NVIC::unmask(Interrupt::TIM2) };
}

#[interrupt]
fn TIM2() {
    TIM2.sr().write_value(SrGp16(0));
    TIME.with(Kept::wake);
}

impl Time {
    #[inline]
    fn with<T>(&self, act: impl FnOnce(&mut Kept) -> T) -> T {
        critical_section::with(|section| act(&mut self.0.borrow_ref_mut(section)))
    }
}

impl Driver for Time {
    fn now(&self) -> u64 {
        self.with(Kept::now)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.with(|kept| {
            if kept.queue.schedule_wake(at, waker) {
                kept.wake();
            }
        });
    }
}

impl Kept {
    /// The tasks ask every millisecond, where the counter overflows after 71 minutes.
    fn now(&mut self) -> u64 {
        self.now += u64::from(TIM2.cnt().read().wrapping_sub(self.now as u32));
        self.now
    }

    /// Wakes who is due, and sets the time of the next interrupt. One that comes early does no harm.
    #[inline(never)]
    fn wake(&mut self) {
        loop {
            let now = self.now();
            let next = self.queue.next_expiration(now);
            TIM2.ccr(0).write_value(next as u32);
            // Otherwise the counter may have been there before the register had it.
            if next > self.now() {
                break;
            }
        }
    }
}
