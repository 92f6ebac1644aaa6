//! The control interrupt, and the motor that it controls.
//!
//! A timer at top priority stands for the ADC's end of conversion. What a board's peripherals and its motor would do by
//! themselves, the interrupt does before and after the drive's step; only the step in between is the product.

use crate::device::Interrupt;
use crate::time::PERIOD;
use crate::timers::{CLOCK, PWM, Slow};
use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{NVIC, SYST};
use hallservo::mode::Mode;
use heapless::spsc::{Consumer, Producer, Queue};
use twin::{CHECKPOINT, Twin};

/// Ticks of a timer in instructions: the runner makes an instruction 3.2 ticks long.
pub const fn instructions(ticks: u32) -> u32 {
    (ticks as u64 * 5 / 16) as u32
}

/// What the interrupt tells the tasks, beside the drive's own queues.
pub struct Statistics {
    /// Periods done.
    pub periods: AtomicU32,
    /// Periods whose interrupt never came.
    pub lost: AtomicU32,
    /// Largest time from a period's begin to its interrupt, in ticks.
    pub latest: AtomicU32,
    /// Steps of the running drive.
    pub steps: AtomicU32,
    /// Their ticks, all together.
    pub step_ticks: AtomicU32,
    /// Ticks of the longest of them, which is one that obeyed a command.
    pub longest_step: AtomicU32,
}

/// Filled by the interrupt.
pub static STATISTICS: Statistics = Statistics {
    periods: AtomicU32::new(0),
    lost: AtomicU32::new(0),
    latest: AtomicU32::new(0),
    steps: AtomicU32::new(0),
    step_ticks: AtomicU32::new(0),
    longest_step: AtomicU32::new(0),
};

/// Periods done and the digest of all so far.
pub type Checkpoint = (u32, u64);

type Checkpoints = Queue<Checkpoint, 8>;

struct Control {
    twin: Twin,
    /// Clock at the begin of the first period.
    start: u32,
    checkpoints: Producer<'static, Checkpoint, 8>,
}

/// Owned by whom `RUNNING` says: by the interrupt while it is set, by [`stop`] and [`start`] otherwise.
struct Owned(UnsafeCell<Option<Control>>);
// SAFETY: see `RUNNING`; one core.
unsafe impl Sync for Owned {}

static CONTROL: Owned = Owned(UnsafeCell::new(None));
static RUNNING: AtomicBool = AtomicBool::new(false);

/// Starts the control interrupt; returns where the digests come out, one every [`CHECKPOINT`] periods.
///
/// # Panics
/// When called twice.
pub fn start(twin: Twin, systick: &mut SYST) -> Consumer<'static, Checkpoint, 8> {
    static QUEUE: static_cell::StaticCell<Checkpoints> = static_cell::StaticCell::new();
    let (checkpoints, out) = QUEUE.init(Queue::new()).split();
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(0xFF_FFFF);
    systick.enable_counter();
    let start = CLOCK.elapsed();
    // SAFETY: the interrupt is not enabled yet.
    unsafe { *CONTROL.0.get() = Some(Control { twin, start, checkpoints }) };
    RUNNING.store(true, Relaxed);
    PWM.start(PERIOD);
    // SAFETY: no critical section relies on this interrupt's being masked; it could not mask it.
    unsafe { NVIC::unmask(Interrupt::Timer0) };
    out
}

/// Stops the control interrupt and hands over what it worked on. `None` if it was not running.
pub fn stop() -> Option<&'static Twin> {
    NVIC::mask(Interrupt::Timer0);
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    PWM.stop();
    // SAFETY: the interrupt is masked for good and not active, because this runs at a lower priority.
    let control = unsafe { (*CONTROL.0.get()).as_ref() };
    control.filter(|_| RUNNING.swap(false, Relaxed)).map(|control| &control.twin)
}

#[unsafe(no_mangle)]
extern "C" fn TIMER0() {
    let late = PWM.elapsed();
    let now = CLOCK.elapsed();
    PWM.clear();
    // SAFETY: enabled by `start`, which has filled it, until `stop`; an interrupt does not interrupt itself.
    if let Some(control) = unsafe { (*CONTROL.0.get()).as_mut() } {
        control.period(late, now);
    }
}

impl Control {
    fn period(&mut self, late: u32, now: u32) {
        let begun = now.wrapping_sub(self.start) / (PERIOD / Slow::DIVIDER);
        let before = self.twin.periods();
        STATISTICS.lost.store(begun.saturating_sub(before + 1), Relaxed);
        STATISTICS.latest.fetch_max(late, Relaxed);

        let sample = self.twin.sample();
        let begin = SYST::get_current();
        let output = self.twin.drive().step(&sample);
        let ticks = begin.wrapping_sub(SYST::get_current()) & 0xFF_FFFF;
        self.twin.actuate(&sample, &output);

        if self.twin.drive().mode() == Mode::Running {
            STATISTICS.steps.fetch_add(1, Relaxed);
            STATISTICS.step_ticks.fetch_add(ticks, Relaxed);
            STATISTICS.longest_step.fetch_max(ticks, Relaxed);
        }
        let done = self.twin.periods();
        STATISTICS.periods.store(done, Relaxed);
        if done.is_multiple_of(CHECKPOINT) {
            // A checkpoint that nobody has taken is one fewer.
            let _ = self.checkpoints.enqueue((done, self.twin.digest()));
        }
    }
}
