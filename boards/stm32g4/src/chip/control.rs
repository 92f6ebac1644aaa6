//! The control interrupt.

use crate::Adc;
use crate::chip::bridge::Bridge;
use crate::chip::encoder::{OwnDrive, own, period};
use crate::chip::{Board, STOP, chopper, converters, enable, latest, watchdog};
use crate::registers::timer;
use crate::wiring::EnableInput;
use core::cell::UnsafeCell;
use cortex_m::peripheral::{DWT, NVIC};
use embassy_stm32::pac::Interrupt;
use hallservo::board::timing::PeriodCounter;
use hallservo::board::{Interlock, Sample};
#[cfg(feature = "scope")]
use hallservo::scope::Recorder;

/// What the control interrupt of a board owns: a static of the board, filled by [`run`](crate::run).
pub struct Control<B>(UnsafeCell<Option<Owned<B>>>);

// SAFETY: written before the interrupt is enabled, and from then on used by the interrupt alone.
unsafe impl<B: Send> Sync for Control<B> {}

struct Owned<B> {
    board: B,
    drive: &'static mut OwnDrive,
    bridge: Bridge,
    periods: PeriodCounter,
    #[cfg(feature = "scope")]
    recorder: Recorder,
}

impl<B: Board> Control<B> {
    /// Before the start.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Hands everything to the interrupt, and starts it.
    pub(crate) fn start(
        &'static self,
        board: B,
        drive: &'static mut OwnDrive,
        bridge: Bridge,
        #[cfg(feature = "scope")] recorder: Recorder,
    ) {
        let owned = Owned {
            board,
            drive,
            bridge,
            periods: PeriodCounter::new(const { B::BRIDGE.whole_period() }),
            #[cfg(feature = "scope")]
            recorder,
        };
        // SAFETY: the interrupt is not enabled, so nothing else looks at it.
        let owned = unsafe { (*self.0.get()).insert(owned) };
        begin(&owned.bridge);
    }

    /// One PWM period, from the end of the ADCs' sequences. It must be over before the next valley, which takes its
    /// compare values up; a period without one is counted, and a running drive fails at it.
    ///
    /// # Safety
    /// To be called by the interrupt ADC1_2 and by nothing else.
    #[inline(always)]
    pub unsafe fn interrupt(&self) {
        watchdog::refresh();
        converters::acknowledge(&B::CONVERTERS[0].adc);
        // SAFETY: the interrupt owns both and does not interrupt itself. It was enabled once there was an owner.
        let (owned, (sample, cycle)) = unsafe { ((*self.0.get()).as_mut().unwrap_unchecked(), latest::place()) };
        owned.bridge.commutate();
        owned.board.sample(sample);
        *cycle = DWT::cycle_count();
        sample.lost = owned.periods.lost(*cycle);
        if owned.bridge.has_tripped() {
            show_tripped(sample);
        }
        let interlock = interlock(const { B::BRIDGE.enable });
        let output = period(&mut owned.board, owned.drive, sample, interlock);
        if owned.bridge.apply(output, || own(owned.drive).period()) {
            owned.retime();
        }
        if let Some(output) = const { B::BRIDGE.chopper }
            && let Some(on) = owned.drive.chopper(sample)
        {
            chopper::set(output, on);
        }
        #[cfg(feature = "scope")]
        owned.recorder.take(own(owned.drive), sample, &output);
    }
}

impl<B: Board> Owned<B> {
    /// The drive has another period: its settings have changed, or are not the board's own from the start.
    #[cold]
    #[inline(never)]
    fn retime(&mut self) {
        let period = timer::whole(own(self.drive).period());
        self.periods = PeriodCounter::new(period);
        self.board.retime(period);
    }
}

#[cold]
#[inline(never)]
fn show_tripped(sample: &mut Sample) {
    Adc::show_tripped(sample);
}

/// From here on the interrupt comes. Not generic, so that it is compiled for size.
#[inline(never)]
fn begin(bridge: &Bridge) {
    watchdog::start_window();
    bridge.start();
    // SAFETY: no critical section relies on this interrupt's being masked; it could not mask it.
    unsafe { NVIC::unmask(Interrupt::ADC1_2) };
}

/// What keeps the bridge off in this period.
#[inline(always)]
fn interlock(enable: Option<EnableInput>) -> Option<Interlock> {
    if enable.is_some_and(|input| !enable::is_closed(input)) {
        return Some(Interlock::Disabled);
    }
    STOP.holds().then_some(Interlock::Stop)
}

impl<B: Board> Default for Control<B> {
    fn default() -> Self {
        Self::new()
    }
}
