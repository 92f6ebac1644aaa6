//! From cycles of a clock that changes to seconds, and back.

use bus::Cycle;

/// The time base.
#[derive(Clone, Copy, Debug)]
pub struct Time {
    base: Cycle,
    base_s: f64,
    hz: f64,
}

impl Time {
    /// From power-on, with HCLK as reset leaves it.
    pub const fn new(hz: f64) -> Self {
        Self { base: 0, base_s: 0.0, hz }
    }

    /// HCLK, Hz.
    pub const fn hz(&self) -> f64 {
        self.hz
    }

    /// Seconds since power-on at a cycle, which may be a fraction of one.
    pub fn seconds(&self, at: f64) -> f64 {
        self.base_s + (at - self.base as f64) / self.hz
    }

    /// The cycle of an instant.
    pub fn cycle(&self, at_s: f64) -> f64 {
        self.base as f64 + (at_s - self.base_s) * self.hz
    }

    /// The first cycle that [`Self::seconds`] does not place before an instant; never for infinity.
    pub fn first_cycle(&self, at_s: f64) -> Cycle {
        let cycle = ceiling(self.cycle(at_s));
        // There and back is rounded twice, and what is due at a cycle must not be in its future: it would be due for
        // ever.
        cycle.saturating_add(Cycle::from(self.seconds(cycle as f64) < at_s))
    }

    /// HCLK is another from now on.
    pub fn change(&mut self, now: Cycle, hz: f64) {
        *self = Self { base: now, base_s: self.seconds(now as f64), hz };
    }
}

/// The first whole cycle not before a fractional one; never for infinity.
pub fn ceiling(at: f64) -> Cycle {
    let whole = at as Cycle;
    whole.saturating_add(Cycle::from((whole as f64) < at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_add_up_over_a_change_of_the_clock() {
        let mut time = Time::new(16e6);
        time.change(16_000, 170e6);
        assert!((time.seconds(16_000.0 + 170_000.0) - 2e-3).abs() < 1e-15);
        assert!((time.cycle(2e-3) - 186_000.0).abs() < 1e-6);
    }
    #[test]
    fn what_is_due_at_a_cycle_is_not_in_its_future() {
        let mut time = Time::new(16e6);
        time.change(16_123, 170e6);
        for k in 0..1_000_000 {
            let at_s = 2e-3 + f64::from(k) * 1.234_567_8e-5;
            let cycle = time.first_cycle(at_s);
            assert!(time.seconds(cycle as f64) >= at_s, "{at_s}");
            assert!(time.seconds(cycle as f64) < at_s + 1.5 / 170e6, "{at_s}");
        }
        assert_eq!(time.first_cycle(f64::INFINITY), Cycle::MAX);
    }
}
