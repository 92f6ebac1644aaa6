//! Bit timing (RM0440, 44.3.2 and 44.4.3, 44.4.7): how long a bit is, and whose bits a node still understands.

/// One of the two bit rates of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rate {
    /// A time quantum, s.
    pub quantum_s: f64,
    /// Quanta before the sample point, without the first.
    pub before: u32,
    /// Quanta after it.
    pub after: u32,
    /// By how many of them an edge moves it.
    pub jump: u32,
}

impl Rate {
    /// Of a clock, Hz, divided by a number.
    pub fn new(clock_hz: f64, prescaler: u32, [before, after, jump]: [u32; 3]) -> Self {
        Self { quantum_s: f64::from(prescaler) / clock_hz, before, after, jump }
    }

    fn quanta(&self) -> u32 {
        1 + self.before + self.after
    }

    /// A bit, s.
    pub fn bit_s(&self) -> f64 {
        f64::from(self.quanta()) * self.quantum_s
    }

    /// From the begin of a bit to its sample point, s.
    pub fn sample_s(&self) -> f64 {
        f64::from(1 + self.before) * self.quantum_s
    }

    /// How far another's clock may be off: edges are ten bits apart at most, and move the sample point by a jump
    /// (ISO 11898-1, 11.3.2.4).
    fn tolerance(&self) -> f64 {
        f64::from(self.jump.min(self.after)) / f64::from(10 * self.quanta())
    }

    /// The same where there are error flags: thirteen bits without an edge.
    fn tolerance_at_flags(&self) -> f64 {
        let bits = f64::from(13 * self.quanta() - self.after);
        self.tolerance().min(f64::from(self.before.min(self.after)) / bits)
    }

    fn off(&self, other: &Rate) -> f64 {
        (self.bit_s() / other.bit_s() - 1.0).abs()
    }
}

/// Both rates of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// Of arbitration.
    pub nominal: Rate,
    /// Of the data phase.
    pub data: Rate,
}

impl Timing {
    /// 1 Mbit/s and 5 Mbit/s of an 80 MHz clock, sampled at two thirds: what an adapter has.
    pub fn fast() -> Self {
        Self { nominal: Rate::new(80e6, 1, [52, 27, 27]), data: Rate::new(80e6, 1, [9, 6, 6]) }
    }

    /// The same of a clock that is off by this share.
    #[must_use]
    pub fn off_by(mut self, share: f64) -> Self {
        self.nominal.quantum_s *= 1.0 + share;
        self.data.quantum_s *= 1.0 + share;
        self
    }

    /// Whether it understands what another sends at its nominal rate.
    pub fn hears(&self, other: &Timing) -> bool {
        self.nominal.off(&other.nominal) <= self.nominal.tolerance_at_flags()
    }

    /// Whether it understands what another sends at its data rate.
    pub fn hears_data(&self, other: &Timing) -> bool {
        self.data.off(&other.data) <= self.data.tolerance()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates() {
        let Timing { nominal, data } = Timing::fast();
        assert!((nominal.bit_s() - 1e-6).abs() < 1e-15 && (data.bit_s() - 200e-9).abs() < 1e-15);
        assert!((nominal.sample_s() / nominal.bit_s() - 0.6625).abs() < 1e-9);
    }

    #[test]
    fn a_clock_two_percent_off_is_understood_and_four_are_not() {
        let own = Timing::fast();
        for (share, heard) in [(0.0, true), (0.02, true), (-0.02, true), (0.04, false), (-0.04, false)] {
            assert_eq!(own.hears(&own.off_by(share)), heard, "{share}");
        }
        assert!(own.hears_data(&own.off_by(0.02)) && !own.hears_data(&own.off_by(0.05)));
        let narrow = Timing { nominal: Rate::new(80e6, 1, [69, 10, 1]), ..own };
        assert!(!narrow.hears(&own.off_by(0.005)), "a jump of one quantum of 80 makes up for 1/800");
    }
}
