//! What experiments say about many numbers.

/// Mean, RMS, extremes of numbers as they come.
#[derive(Clone, Copy, Debug, Default)]
pub struct Statistics {
    count: f64,
    sum: f64,
    squares: f64,
    max_abs: f64,
}

impl Statistics {
    /// Takes one more.
    pub fn push(&mut self, x: f64) {
        self.count += 1.0;
        self.sum += x;
        self.squares += x * x;
        self.max_abs = self.max_abs.max(x.abs());
    }

    /// How many.
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Mean; 0 of nothing.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }

    /// Root of the mean square.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1.0)).sqrt()
    }

    /// Mean square about the mean.
    pub fn variance(&self) -> f64 {
        (self.rms() * self.rms() - self.mean() * self.mean()).max(0.0)
    }

    /// Largest magnitude.
    pub fn max_abs(&self) -> f64 {
        self.max_abs
    }
}

impl FromIterator<f64> for Statistics {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        let mut statistics = Self::default();
        numbers.into_iter().for_each(|x| statistics.push(x));
        statistics
    }
}

/// Means over equal parts of the turn: what is left of an error when the noise is averaged away.
#[derive(Clone, Debug)]
pub struct ByAngle(Vec<Statistics>);

impl ByAngle {
    /// With so many parts.
    pub fn new(parts: usize) -> Self {
        Self(vec![Statistics::default(); parts])
    }

    /// Takes a number that belongs to an angle in degrees.
    pub fn push(&mut self, angle_deg: f64, x: f64) {
        let parts = self.0.len();
        let part = (angle_deg.rem_euclid(360.0) / 360.0 * parts as f64) as usize;
        self.0[part.min(parts - 1)].push(x);
    }

    /// The means of the parts that have at least `least` numbers.
    pub fn means(&self, least: f64) -> impl Iterator<Item = (f64, f64)> {
        let width = 360.0 / self.0.len() as f64;
        let filled = self.0.iter().enumerate().filter(move |(_, part)| part.count() >= least);
        filled.map(move |(k, part)| ((k as f64 + 0.5) * width, part.mean()))
    }
}

/// Peak to peak over the mean, in per cent.
pub fn ripple_pct(numbers: &[f64]) -> f64 {
    let (low, high) = numbers.iter().fold((f64::MAX, f64::MIN), |(low, high), &x| (low.min(x), high.max(x)));
    let mean = numbers.iter().sum::<f64>() / numbers.len() as f64;
    100.0 * (high - low) / mean.abs()
}
