//! The idle path: the bridge is off, so the current amplifiers show their zeros.

use crate::board::Sample;
use crate::control::config::Config;

/// Middle of the range of a code of 16 bits, in 2⁻⁸ codes.
const MIDDLE: i32 = 32_768 << 8;

/// What is measured while the bridge is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Idle {
    /// Code of each amplifier without a current, for a full scale of 2¹⁶, in 2⁻⁸; averaged over 256 steps.
    zeros: [i32; 3],
    /// Whether a sample was seen: the average begins with the first, so that a drive that is commanded at once has
    /// zeros.
    seen: bool,
    /// Steps until the currents that flowed while the bridge was on have died.
    dying: u32,
}

/// Time for that, steps: currents die against the bus voltage.
const DYING: u32 = 64;

impl Idle {
    /// Amplifiers as they should be: zero in the middle of the range.
    pub const fn new() -> Self {
        Self { zeros: [MIDDLE; 3], seen: false, dying: 0 }
    }

    /// A step with the bridge on.
    pub fn drives(&mut self) {
        self.dying = DYING;
    }

    /// A step with the bridge off.
    pub fn step(&mut self, config: &Config, sample: &Sample) {
        if self.dying > 0 {
            self.dying -= 1;
            return;
        }
        for (zero, code) in self.zeros.iter_mut().zip(sample.currents) {
            let off = (i32::from(code) << (config.shift + 8)) - *zero;
            *zero += if self.seen { off >> 8 } else { off };
        }
        self.seen = true;
    }

    /// Code of each amplifier without a current, for a full scale of 2¹⁶, in 2⁻⁸.
    pub const fn zeros(&self) -> [i32; 3] {
        self.zeros
    }

    /// Whether every zero is within `offset_a` of the middle of the range.
    pub fn zeros_are_plausible(&self, config: &Config) -> bool {
        self.zeros.iter().all(|zero| (zero - MIDDLE).abs() >> 8 <= config.guard.offset)
    }

    /// Phase currents in 2⁻¹⁵ of the full scale.
    #[inline(always)]
    pub fn phases(&self, config: &Config, sample: &Sample) -> [i32; 3] {
        let phase = |k: usize| (i32::from(sample.currents[k]) << config.shift) - (self.zeros[k] >> 8);
        [phase(0), phase(1), phase(2)]
    }
}
