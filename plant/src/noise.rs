//! Seeded randomness that is the same on every machine.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

/// A stream of uniform and Gaussian numbers, a function of its seed alone.
#[derive(Clone, Debug)]
pub struct Noise {
    source: Pcg32,
    spare: Option<f64>,
}

impl Noise {
    /// The stream of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { source: Pcg32::seed_from_u64(seed), spare: None }
    }

    /// Uniform, from -1 to just below 1, in steps of 2⁻³¹.
    pub fn uniform(&mut self) -> f64 {
        f64::from(self.source.next_u32().cast_signed()) * (1.0 / 2_147_483_648.0)
    }

    /// Gaussian with mean 0 and standard deviation 1.
    ///
    /// Marsaglia's polar method: one logarithm and one root for two numbers, no sine.
    pub fn gaussian(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (x, y) = (self.uniform(), self.uniform());
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                let scale = libm::sqrt(-2.0 * libm::log(square) / square);
                self.spare = Some(y * scale);
                return x * scale;
            }
        }
    }

    /// Gaussian with this standard deviation; draws nothing where it is zero.
    pub fn scaled(&mut self, deviation: f64) -> f64 {
        if deviation == 0.0 {
            return 0.0;
        }
        self.gaussian() * deviation
    }
}
