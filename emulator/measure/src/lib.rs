//! What was seen of a figure: smallest, largest, how often. Core, chip and report all measure with it.

use serde::Serialize;

/// Smallest and largest of what was seen, and how many.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Range {
    /// Smallest; infinite as long as nothing was seen.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// How often.
    pub count: u64,
}

impl Default for Range {
    fn default() -> Self {
        Range { min: f64::INFINITY, max: f64::NEG_INFINITY, count: 0 }
    }
}

impl Range {
    /// Takes one more.
    pub fn add(&mut self, value: f64) {
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        self.count += 1;
    }
}
