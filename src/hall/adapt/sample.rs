//! A sample with something wrong: its three sensors against their prediction, together.

use super::filter::{Covariance, CrossCovariance, Measurement};

/// Squared number of standard deviations beyond which a measurement is an outlier.
pub const GATE: f32 = 25.0;

/// The three sensors of a sample against their prediction.
pub struct Sample {
    pub measurements: [Measurement; 3],
    /// Variances of the innovations, noise included.
    variances: [f32; 3],
    /// Squared innovations over their variances.
    pub squares: [f32; 3],
}

impl Sample {
    pub fn new(measurements: [Measurement; 3], p: &Covariance) -> Self {
        let variances: [f32; 3] = core::array::from_fn(|k| measurements[k].variance(k, p) + measurements[k].noise);
        let mut sample = Self { measurements, variances, squares: [0.0; 3] };
        sample.inflate(0.0);
        sample
    }

    /// Adds to the variance of the angle.
    pub fn inflate(&mut self, by: f32) {
        for (k, m) in self.measurements.iter().enumerate() {
            self.variances[k] += by * m.angle * m.angle;
            self.squares[k] = m.innovation * m.innovation / self.variances[k];
        }
    }

    /// Sensors whose squared innovation exceeds [`GATE`] variances.
    pub fn outliers(&self) -> [bool; 3] {
        self.squares.map(|square| square > GATE)
    }

    /// Takes an outlier as so uncertain that it is none.
    pub fn mistrust(&mut self, sensor: usize) {
        let m = &mut self.measurements[sensor];
        let more = m.innovation * m.innovation * (2.0 / GATE);
        m.noise += more;
        self.variances[sensor] += more;
        self.squares[sensor] = m.innovation * m.innovation / self.variances[sensor];
    }

    pub fn discard(&mut self, sensor: usize) {
        self.measurements[sensor] = Measurement::NONE;
        self.squares[sensor] = 0.0;
    }

    /// The displacement of the rotor, rad, that explains the innovations best, and the sum of squares that remains.
    pub fn as_disturbance(&self) -> (f32, f32) {
        let (by, _) = common_angle(&self.measurements);
        let rests = self.measurements.iter().zip(&self.variances).map(|(m, variance)| {
            let rest = m.innovation - m.angle * by;
            rest * rest / variance
        });
        (by, rests.sum())
    }

    /// The sensor with the largest squared innovation.
    pub fn farthest(&self) -> usize {
        largest(&self.squares)
    }
}

/// The displacement of the rotor, rad, that explains the innovations best, by weighted least squares, and one over its
/// variance by noise.
fn common_angle(measurements: &[Measurement; 3]) -> (f32, f32) {
    let (mut certainty, mut product) = (f32::MIN_POSITIVE, 0.0);
    for m in measurements {
        let weight = m.angle / m.noise;
        certainty += m.angle * weight;
        product += m.innovation * weight;
    }
    (product / certainty, certainty)
}

/// The three sensors combined into one measurement of the angle, and its covariance with the states.
pub fn combine(measurements: &[Measurement; 3], p: &Covariance) -> (Measurement, CrossCovariance) {
    let (by, certainty) = common_angle(measurements);
    let noise = 1.0 / certainty;
    let weights = core::array::from_fn(|k| noise * measurements[k].angle / measurements[k].noise);
    let cross = CrossCovariance::of_all(measurements, &weights, p);
    (Measurement { innovation: by, noise, ..Measurement::NONE }, cross)
}

/// Which of three is the largest.
fn largest([a, b, c]: &[f32; 3]) -> usize {
    if a >= b && a >= c {
        0
    } else if b >= c {
        1
    } else {
        2
    }
}
