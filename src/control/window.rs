//! The range that protections leave to the current along q.

use crate::fault::Limits;

/// Lowest and highest current along q, in 2⁻¹⁵ of the full scale: lowest ≤ 0 ≤ highest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    /// Not positive.
    pub lowest: i32,
    /// Not negative.
    pub highest: i32,
    /// What has made it narrower than ± `max_current_a`, from below and from above.
    pub narrowed: [Limits; 2],
}

impl Window {
    /// No current at all.
    pub const ZERO: Self = Self::symmetric(0);

    /// From −`most` to `most`, which is not negative.
    #[inline(always)]
    pub const fn symmetric(most: i32) -> Self {
        Self { lowest: -most, highest: most, narrowed: [Limits::NONE; 2] }
    }

    /// Narrowed from below, to a limit that is not positive, for a reason.
    #[inline(always)]
    pub const fn from_below(&mut self, lowest: i32, reason: Limits) {
        if lowest > self.lowest {
            self.lowest = lowest;
            self.narrowed[0] = reason;
        }
    }

    /// Narrowed from above, to a limit that is not negative, for a reason.
    #[inline(always)]
    pub const fn from_above(&mut self, highest: i32, reason: Limits) {
        if highest < self.highest {
            self.highest = highest;
            self.narrowed[1] = reason;
        }
    }

    /// Why a current is cut, if it is.
    #[inline(always)]
    pub const fn reasons(&self, current: i32) -> Limits {
        if current < self.lowest {
            self.narrowed[0].with(Limits::CURRENT)
        } else if current > self.highest {
            self.narrowed[1].with(Limits::CURRENT)
        } else {
            Limits::NONE
        }
    }

    /// A current, cut to the window.
    #[inline(always)]
    pub const fn cut(&self, current: i32) -> i32 {
        let current = if current < self.highest { current } else { self.highest };
        if current > self.lowest { current } else { self.lowest }
    }

    /// Whether a current is at an end of the window; an end at zero counts only where the window is nothing else.
    #[inline(always)]
    pub const fn is_end(&self, current: i32) -> bool {
        (current == self.lowest || current == self.highest) && (current != 0 || self.lowest == self.highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_narrowed_from_either_side_and_tells_why() {
        let mut window = Window::symmetric(100);
        window.from_below(-200, Limits::HEAT);
        window.from_above(100, Limits::HEAT);
        assert_eq!(window, Window::symmetric(100));
        window.from_below(-30, Limits::SUPPLY);
        assert_eq!((window.cut(-100), window.cut(-30), window.cut(7), window.cut(200)), (-30, -30, 7, 100));
        assert_eq!(window.reasons(-100), Limits::SUPPLY.with(Limits::CURRENT));
        assert_eq!(window.reasons(200), Limits::CURRENT);
        assert_eq!(window.reasons(7), Limits::NONE);
        window.from_above(50, Limits::HEAT);
        assert_eq!(window.cut(60), 50);
        assert_eq!(window.reasons(60), Limits::HEAT.with(Limits::CURRENT));
    }

    #[test]
    fn nothing_asked_for_is_no_end_of_a_window_to_one_side() {
        let mut window = Window::symmetric(100);
        window.from_below(0, Limits::SUPPLY);
        assert!(!window.is_end(0) && window.is_end(100));
        assert!(Window::ZERO.is_end(0));
    }
}
