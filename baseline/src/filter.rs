//! The diagonal filter of Simpkins and Todorov, eq. (11) to (15), with the least corrections that make it run.
//!
//! One variance a state, each gain computed as if the other states were known. Corrected against the print (see the
//! equations' numbers): the variance of θ grows by that of θ̇ and not by 2θ̇σ (11); measurement derivatives are without
//! the factor θ̇ and with the sign of the derivative (12); the innovation of ψᵢ uses rᵢ (14); the variance of θ̇ uses
//! its own state (14). As in the paper, φ is held constant, and α and β, though states, have neither dynamics nor gain:
//! they stay at what they start from.

use std::f64::consts::TAU;

/// Noises of the filter, electrical radians and seconds.
#[derive(Clone, Copy, Debug)]
pub struct Noises {
    /// Ω of θ, rad²/s.
    pub angle: f64,
    /// Ω of θ̇, rad²/s³.
    pub speed: f64,
    /// Ω of ψ, rad²/s.
    pub placement: f64,
    /// Ω of a normalised signal.
    pub signal: f64,
}

/// The filter; electrical angles.
#[derive(Clone, Debug)]
pub struct PaperFilter {
    noises: Noises,
    /// Minimum and maximum of each sensor, α and β.
    ranges: [(f64, f64); 3],
    /// θ, rad.
    pub angle: f64,
    /// θ̇, rad/s.
    pub speed: f64,
    /// ψ of each sensor, the first zero.
    pub placement: [f64; 3],
    /// σ of θ, θ̇, ψ₁ and ψ₂.
    pub variances: [f64; 4],
}

impl PaperFilter {
    /// From minima and maxima, an angle and a speed, and placements as the data sheet has them.
    pub fn new(ranges: [(f64, f64); 3], angle: f64, speed: f64, spacing: f64, noises: Noises) -> Self {
        Self {
            noises,
            ranges,
            angle,
            speed,
            placement: [0.0, spacing, 2.0 * spacing],
            variances: [0.1, 10.0, 0.02, 0.02],
        }
    }

    /// Eq. (2).
    fn normalized(&self, sensor: usize, code: u16) -> f64 {
        let (low, high) = self.ranges[sensor];
        2.0 * (f64::from(code) - low) / (high - low) - 1.0
    }

    /// A period under an acceleration that is known, with a decay of the speed, then a sample.
    pub fn step(&mut self, codes: [u16; 3], acceleration: f64, damping: f64, dt: f64) {
        let before = self.angle;
        self.angle += dt * self.speed;
        self.speed += dt * (acceleration - damping * self.speed);
        let [angle, speed, placements @ ..] = &mut self.variances;
        *angle += dt * dt * *speed + dt * self.noises.angle;
        *speed += dt * (self.noises.speed - 2.0 * damping * *speed);
        for placement in placements {
            *placement += dt * self.noises.placement;
        }
        let r = [0, 1, 2].map(|sensor| self.normalized(sensor, codes[sensor]));
        self.correct(r, before, dt);
        self.angle -= TAU * (self.angle / TAU).round();
    }

    /// Eq. (12) to (15).
    fn correct(&mut self, r: [f64; 3], before: f64, dt: f64) {
        let theta = self.angle;
        let gain = |variance: f64, slope: f64, noise: f64| variance * slope / (variance * slope * slope + noise);
        let noise = self.noises.signal;
        let slope = theta.cos();
        let k_angle = gain(self.variances[0], slope, noise);
        // r_k − r_{k−1} changes with the speed by dt · cos θ.
        let slope_speed = dt * before.cos();
        let k_speed = gain(self.variances[1], slope_speed, 2.0 * noise);
        self.angle += k_angle * (r[0] - theta.sin());
        self.speed += k_speed * (r[0] - before.sin() - dt * before.cos() * self.speed);
        self.variances[0] *= 1.0 - k_angle * slope;
        self.variances[1] *= 1.0 - k_speed * slope_speed;
        for sensor in [1, 2] {
            let phase = theta - self.placement[sensor];
            let k = gain(self.variances[sensor + 1], phase.cos(), 2.0 * noise);
            self.placement[sensor] += k * (r[0] - r[sensor] - (theta.sin() - phase.sin()));
            self.variances[sensor + 1] *= 1.0 - k * phase.cos();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ideal sensors at 10 Hz, the second 8° out of place.
    #[test]
    fn it_runs_and_finds_a_placement() {
        let noises = Noises { angle: 1e-4, speed: 16.0, placement: 1e-4, signal: 1e-4 };
        let mut filter = PaperFilter::new([(0.0, 4000.0); 3], 0.1, 50.0, TAU / 3.0, noises);
        let placement = [0.0, TAU / 3.0 + 0.14, 2.0 * TAU / 3.0];
        let mut angle: f64 = 0.0;
        for _ in 0..3000 {
            angle += 0.001 * 10.0 * TAU;
            let codes = placement.map(|psi| (2000.0 * (1.0 + (angle - psi).sin())).round() as u16);
            filter.step(codes, 0.0, 0.0, 1e-3);
        }
        let error = (filter.angle - angle).sin().asin();
        assert!(error.abs().to_degrees() < 1.0, "{error}");
        assert!((filter.placement[1] - placement[1]).abs().to_degrees() < 2.0, "{}", filter.placement[1]);
    }
}
