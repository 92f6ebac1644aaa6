//! The current of the phase whose lower transistor does not conduct long enough for it to be sampled. With long voltage
//! vectors that is the one with the highest compare value, and what comes out of its amplifier means nothing.

use super::{Drive, Route, Sample};
use crate::board::{Legs, Output};

/// Samples that a compare value has a share in: it takes effect in one valley and ends in the next.
const SAMPLES: u8 = 2;

/// Which current is not sampled, in how many samples from now on, and whether the present one lacks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ThirdCurrent {
    phase: u8,
    left: u8,
    now: bool,
}

impl ThirdCurrent {
    /// All three are sampled.
    pub const NONE: Self = Self { phase: 0, left: 0, now: false };

    /// Where flash is scarce, all three always are.
    pub const MAY_MISS: bool = !cfg!(feature = "small");

    /// Samples from the next one on that lack one.
    #[inline(always)]
    pub const fn left(self) -> u8 {
        if Self::MAY_MISS { self.left } else { 0 }
    }

    /// Whether the next sample lacks one.
    #[inline(always)]
    pub const fn is_missing(self) -> bool {
        self.left() != 0
    }

    /// Whether the present sample lacks one: then the sum of the three tells nothing.
    #[inline(always)]
    pub const fn is_missing_now(self) -> bool {
        Self::MAY_MISS && self.now
    }

    /// The next sample has all three, unless it is told otherwise.
    pub const fn end_step(&mut self) {
        self.now = false;
    }

    /// Of compare values of which the lowest is below zero: that one, and the highest that is allowed, so far apart as the
    /// highest of them is. While another phase is still missing, the highest has to wait within what is `sampled`: two
    /// currents do not follow from one.
    fn leave_out(&mut self, [a, b, c]: [i32; 3], sampled: u16) -> [i32; 2] {
        let (lowest, highest) = (a.min(b).min(c), a.max(b).max(c));
        let phase = if a == highest { 0 } else { 1 + u8::from(b != highest) };
        if self.is_missing() && self.phase != phase {
            return [lowest, lowest + i32::from(sampled)];
        }
        (self.phase, self.left) = (phase, SAMPLES);
        [lowest, highest]
    }
}

impl Drive {
    /// What the legs do for compare values of which the lowest is below zero: all raised until it is zero. The next steps are
    /// general ones. Four arguments come in registers, an array does not.
    #[cold]
    #[inline(never)]
    pub(super) fn leave_out(&mut self, a: i16, b: i16, c: i16) -> u64 {
        self.route = Route::General;
        let counts = [i32::from(a), i32::from(b), i32::from(c)];
        let [lowest, highest] = self.third_current.leave_out(counts, self.config.limits.high());
        let raised = |count: i16| (i32::from(count).min(highest) - lowest) as u16;
        Output { compare: [raised(a), raised(b), raised(c)], legs: Legs::ALL }.pack()
    }

    /// A sample with the missing current in its place: the three add up to what their amplifiers show without a current. A
    /// sum that no code can be is an over-current.
    #[cold]
    #[inline(never)]
    pub(super) fn completed(&mut self, sample: &Sample) -> Sample {
        let missing = &mut self.third_current;
        (missing.left, missing.now) = (missing.left - 1, true);
        let mut sample = *sample;
        let currents = &mut sample.currents;
        if let (Some(control), Some(current)) = (&self.config.control, currents.get_mut(usize::from(missing.phase))) {
            *current = 0;
            let others = currents.iter().fold(0_u16, |sum, code| sum.wrapping_add(*code));
            currents[usize::from(missing.phase)] = self.servo.protection.currents.sum(control).wrapping_sub(others);
        }
        sample
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time() {
        let mut third = ThirdCurrent::NONE;
        for (compare, phase) in
            [([1700, -200, 1500], 0), ([-1, 1900, 1700], 1), ([-30, 1700, 1900], 2), ([9, -9, 9], 0)]
        {
            let mut fresh = ThirdCurrent::NONE;
            let [lowest, highest] = fresh.leave_out(compare, 1716);
            assert!(compare.contains(&lowest) && compare.iter().all(|count| (lowest..=highest).contains(count)));
            assert_eq!((fresh, compare[usize::from(phase)]), (ThirdCurrent { phase, left: 2, now: false }, highest));
        }
        assert_eq!(third.leave_out([1800, -100, 1600], 1716), [-100, 1800]);
        third.left = 1;
        // Another has to wait, the same goes on.
        assert_eq!(third.leave_out([1550, -100, 1700], 1716), [-100, 1616]);
        assert_eq!(third.leave_out([1701, -100, 1600], 1716), [-100, 1701]);
        assert_eq!(third, ThirdCurrent { phase: 0, left: 2, now: false });
        third.left = 0;
        assert_eq!(third.leave_out([1550, -100, 1700], 1716), [-100, 1700]);
        assert_eq!(third, ThirdCurrent { phase: 2, left: 2, now: false });
    }
}
