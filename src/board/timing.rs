//! When a board samples, notices that it was late, and enables its outputs.

use crate::board::{Legs, LostPeriods, Output};
use core::num::NonZeroU32;

/// From the valley to where an input is held, s: the ADCs are triggered `lead` timer ticks before the valley and hold it
/// `held` ticks after the trigger.
pub const fn held_s(lead: u32, held: u32, timer_hz: f32) -> f32 {
    (held as f32 - lead as f32) / timer_hz
}

/// Counts the periods that passed without an interrupt, by a free-running counter.
#[derive(Clone, Copy, Debug)]
pub struct PeriodCounter {
    /// Ticks of the counter in a control period.
    period: NonZeroU32,
    /// The count at the last interrupt.
    last: u32,
    /// From so many ticks on since the last interrupt there is something to look at: one and a half periods, or none
    /// before the first.
    most: u32,
}

impl PeriodCounter {
    /// For a control period of so many ticks of a counter that wraps at 2³².
    pub const fn new(period: NonZeroU32) -> Self {
        Self { period, last: 0, most: 0 }
    }

    /// Periods lost before this interrupt, at a count; the first one has lost none. Half a period late is still in
    /// time.
    #[inline(always)]
    pub fn lost(&mut self, now: u32) -> LostPeriods {
        let elapsed = now.wrapping_sub(core::mem::replace(&mut self.last, now));
        if elapsed < self.most { LostPeriods::counted(0) } else { self.look(elapsed) }
    }

    #[cold]
    #[inline(never)]
    fn look(&mut self, elapsed: u32) -> LostPeriods {
        let half = self.period.get() / 2;
        let first = core::mem::replace(&mut self.most, half.saturating_add(self.period.get())) == 0;
        let late = if first { 0 } else { elapsed.saturating_sub(half) };
        LostPeriods::counted((late / self.period).min(255) as u8)
    }
}

/// When the outputs may be enabled. The compare registers are preloaded: what the first step writes is in the timer at
/// the next valley only, so the outputs come on with the step after it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutputEnable {
    /// The timer has compare values of the running drive.
    prepared: bool,
    /// Enabled, and not off since.
    on: bool,
}

/// What a board does with the enable of its outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enable {
    /// Off, at once.
    Off,
    /// Still off: the compare values are not in the timer yet.
    Wait,
    /// On, now.
    On,
    /// They are on.
    Stay,
}

impl OutputEnable {
    /// Off.
    pub const fn new() -> Self {
        Self { prepared: false, on: false }
    }

    /// To be asked with the output of every step.
    #[inline(always)]
    pub fn step(&mut self, output: &Output) -> Enable {
        if output.legs == Legs::NONE {
            *self = Self::new();
            return Enable::Off;
        }
        let enable = match (self.prepared, self.on) {
            (false, _) => Enable::Wait,
            (true, false) => Enable::On,
            (true, true) => Enable::Stay,
        };
        self.on = self.prepared;
        self.prepared = true;
        enable
    }

    /// Whether the outputs have been enabled. A timer whose outputs are off then was switched off by its hardware.
    #[inline(always)]
    pub const fn is_on(&self) -> bool {
        self.on
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_held_after_the_valley_or_before_it() {
        assert_eq!(held_s(100, 100, 170e6), 0.0);
        assert_eq!((held_s(0, 17, 170e6), held_s(34, 0, 170e6)), (100e-9, -200e-9));
    }

    #[test]
    fn lost_periods() {
        let mut counter = PeriodCounter::new(NonZeroU32::new(1000).unwrap());
        let mut now = u32::MAX - 2500;
        assert_eq!(counter.lost(now), LostPeriods::counted(0));
        for (elapsed, lost) in [(1000, 0), (1400, 0), (600, 0), (2000, 1), (2400, 1), (3000, 2), (1, 0), (700_000, 255)]
        {
            now = now.wrapping_add(elapsed);
            assert_eq!(counter.lost(now), LostPeriods::counted(lost), "{elapsed}");
        }
    }

    #[test]
    fn the_outputs_come_on_with_the_second_step_and_off_with_the_first() {
        let on = Output { compare: [1000; 3], legs: Legs::ALL };
        let mut enable = OutputEnable::new();
        for _ in 0..2 {
            assert_eq!([(); 3].map(|()| enable.step(&on)), [Enable::Wait, Enable::On, Enable::Stay]);
            assert!(enable.is_on());
            assert_eq!((enable.step(&Output::OFF), enable.is_on()), (Enable::Off, false));
        }
        // An open leg is no reason to be off.
        enable.step(&on);
        assert_eq!(enable.step(&Output { legs: Legs::without(1), ..on }), Enable::On);
    }
}
