//! Seeded randomness that is the same on every machine.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

/// Gaussian numbers that are made at once, in pairs: a processor overlaps the work on several.
const PAIRS: usize = 8;

/// A stream of uniform and Gaussian numbers, a function of its seed and of which of the two are asked for in turn.
#[derive(Clone, Debug)]
pub struct Noise {
    source: Pcg32,
    /// Gaussian numbers, of which those from `next` on are still to be given.
    ready: [f64; 2 * PAIRS],
    next: usize,
}

impl Noise {
    /// The stream of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { source: Pcg32::seed_from_u64(seed), ready: [0.0; 2 * PAIRS], next: 2 * PAIRS }
    }

    /// Uniform, from -1 to just below 1, in steps of 2⁻³¹.
    pub fn uniform(&mut self) -> f64 {
        f64::from(self.source.next_u32().cast_signed()) * (1.0 / 2_147_483_648.0)
    }

    /// Gaussian with mean 0 and standard deviation 1.
    #[inline]
    pub fn gaussian(&mut self) -> f64 {
        if self.next == self.ready.len() {
            self.prepare();
        }
        let number = self.ready[self.next];
        self.next += 1;
        number
    }

    /// Marsaglia's polar method: one logarithm and one root for two numbers, no sine.
    #[inline(never)]
    fn prepare(&mut self) {
        // What is refused is written, too, and the next is written over it: no branch depends on the draw.
        let mut points = [(0.0, 0.0, 0.5); PAIRS];
        let mut found = 0;
        while found < PAIRS {
            let (x, y) = (self.uniform(), self.uniform());
            let square = x * x + y * y;
            points[found] = (x, y, square);
            found += usize::from(square > 0.0 && square < 1.0);
        }
        for (pair, (x, y, square)) in self.ready.chunks_exact_mut(2).zip(points) {
            let scale = libm::sqrt(-2.0 * libm::log(square) / square);
            (pair[0], pair[1]) = (x * scale, y * scale);
        }
        self.next = 0;
    }

    /// Gaussian with this standard deviation; draws nothing where it is zero.
    pub fn scaled(&mut self, deviation: f64) -> f64 {
        if deviation == 0.0 {
            return 0.0;
        }
        self.gaussian() * deviation
    }
}
