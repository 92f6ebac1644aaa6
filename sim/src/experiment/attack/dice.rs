//! What is drawn for a scenario, all of it from its seed.

use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A stream of random numbers.
pub(super) struct Dice(Pcg64);

impl Dice {
    /// One of several streams of a seed: what is drawn from one changes nothing in the others.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ stream.rotate_left(40)))
    }

    pub fn chance(&mut self, share: f64) -> bool {
        self.0.random_bool(share)
    }

    /// Evenly within a range.
    pub fn within(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.0.random_range(0.0..1.0)
    }

    /// Evenly in the logarithm.
    pub fn between(&mut self, least: f64, most: f64) -> f64 {
        least * (most / least).powf(self.0.random_range(0.0..1.0))
    }

    /// Up to so many times as large or as small.
    pub fn around(&mut self, times: f64) -> f64 {
        self.between(1.0 / times, times)
    }

    /// Of a magnitude up to 1.
    pub fn share(&mut self) -> f64 {
        self.within(-1.0, 1.0)
    }

    pub fn below(&mut self, count: usize) -> usize {
        self.0.random_range(0..count)
    }

    pub fn one_of<T: Copy>(&mut self, list: &[T]) -> T {
        *list.choose(&mut self.0).expect("a list that is not empty")
    }
}
