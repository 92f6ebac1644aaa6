//! The least error that any estimator can reach: the posterior Cramér–Rao bound of the angle from three Hall sensors.
//!
//! The recursion of Tichavský, Muravchik and Nehorai for the sensors' true model, along the true motion: the state is
//! angle, speed, the third harmonic that the sensors share, and offset, amplitude and placement of each, the first
//! placement being the origin of the angle. With additive Gaussian noise the recursion is the Riccati equation with
//! the derivatives taken at the truth.

use crate::hall::HallParameters;

const STATES: usize = 12;

/// Standard deviations before the first sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Angle, rad.
    pub angle_rad: f64,
    /// Speed, rad/s.
    pub speed_rad_s: f64,
    /// Third harmonic, relative to the fundamental.
    pub third: f64,
    /// Offsets, V.
    pub offset_v: f64,
    /// Amplitudes, V.
    pub amplitude_v: f64,
    /// Placements, rad.
    pub placement_rad: f64,
}

/// The bound at one instant.
#[derive(Clone, Debug)]
pub struct Bound {
    covariance: [[f64; STATES]; STATES],
}

impl Bound {
    /// Before the first sample.
    #[must_use]
    pub fn new(prior: &Prior) -> Self {
        let deviations = [
            [prior.angle_rad, prior.speed_rad_s, prior.third],
            [prior.offset_v, prior.amplitude_v, 0.0],
            [prior.offset_v, prior.amplitude_v, prior.placement_rad],
            [prior.offset_v, prior.amplitude_v, prior.placement_rad],
        ];
        let mut covariance = [[0.0; STATES]; STATES];
        for (k, deviation) in deviations.into_iter().flatten().enumerate() {
            covariance[k][k] = deviation * deviation;
        }
        Self { covariance }
    }

    /// Time passes: `damping_1_s` is the rate at which speed decays, `acceleration_noise` the density of an unknown
    /// acceleration, rad/s²/√Hz.
    pub fn advance(&mut self, period_s: f64, damping_1_s: f64, acceleration_noise: f64) {
        let p = &mut self.covariance;
        let decay = 1.0 - damping_1_s * period_s;
        let reach = period_s * (1.0 - 0.5 * damping_1_s * period_s);
        for k in 0..STATES {
            p[0][k] += reach * p[1][k];
            p[1][k] *= decay;
        }
        for row in p.iter_mut() {
            row[0] += reach * row[1];
            row[1] *= decay;
        }
        // The noise acts as the bench applies it: one acceleration throughout the period.
        let power = acceleration_noise * acceleration_noise * period_s;
        p[0][0] += 0.25 * period_s * period_s * power;
        p[0][1] += 0.5 * period_s * power;
        p[1][0] += 0.5 * period_s * power;
        p[1][1] += power;
    }

    /// A sample at an angle, with quantisation steps of `lsb_v`.
    pub fn observe(&mut self, halls: &[HallParameters; 3], angle_rad: f64, lsb_v: f64) {
        for (sensor, hall) in halls.iter().enumerate() {
            let x = angle_rad - hall.placement_rad;
            let wave = libm::sin(x) + hall.third * libm::sin(3.0 * x) + hall.fifth * libm::sin(5.0 * x);
            let slope = libm::cos(x) + 3.0 * hall.third * libm::cos(3.0 * x) + 5.0 * hall.fifth * libm::cos(5.0 * x);
            let mut row = [0.0; STATES];
            row[0] = hall.amplitude_v * slope;
            row[2] = hall.amplitude_v * libm::sin(3.0 * x);
            let own = 3 * (sensor + 1);
            (row[own], row[own + 1], row[own + 2]) = (1.0, wave, -row[0]);
            let own_noise_v = hall.noise * hall.amplitude_v;
            self.scalar(&row, own_noise_v * own_noise_v + lsb_v * lsb_v / 12.0);
        }
    }

    fn scalar(&mut self, row: &[f64; STATES], noise: f64) {
        let p = &mut self.covariance;
        let dot = |a: &[f64; STATES]| a.iter().zip(row).map(|(a, b)| a * b).sum::<f64>();
        let b: [f64; STATES] = core::array::from_fn(|k| dot(&p[k]));
        let s = dot(&b) + noise;
        for (row, bi) in p.iter_mut().zip(b) {
            for (entry, bj) in row.iter_mut().zip(b) {
                *entry -= bi * bj / s;
            }
        }
    }

    /// Least standard deviation of the angle, rad.
    #[must_use]
    pub fn angle_rad(&self) -> f64 {
        libm::sqrt(self.covariance[0][0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::PlantParameters;

    const UNKNOWN: Prior =
        Prior { angle_rad: 1.0, speed_rad_s: 1e3, third: 0.0, offset_v: 0.0, amplitude_v: 0.0, placement_rad: 0.0 };

    fn noisy() -> [HallParameters; 3] {
        PlantParameters::ideal().halls.map(|hall| HallParameters { noise: 0.01, ..hall })
    }

    #[test]
    fn one_sample_of_known_sensors_gives_the_bound_of_the_textbook() {
        for degrees in 0..360 {
            let mut bound = Bound::new(&UNKNOWN);
            bound.observe(&noisy(), f64::from(degrees).to_radians(), 0.0);
            // √(2/3) of the noise.
            assert!((bound.angle_rad().to_degrees() / 0.46783 - 1.0).abs() < 1e-3, "{}", bound.angle_rad());
        }
    }

    #[test]
    fn tracking_known_sensors_reaches_the_steady_state_of_theory() {
        let mut bound = Bound::new(&UNKNOWN);
        let period_s = 1e-4;
        for k in 0..100_000 {
            bound.advance(period_s, 0.0, 4.0);
            bound.observe(&noisy(), 2.0 * f64::from(k) * period_s, 0.0);
        }
        // √2 · q^¼ · r^¾ with the densities of acceleration, q, and of the measured angle, r, continuous in time.
        let r: f64 = 1e-4 * 2.0 / 3.0 * period_s;
        let theory = (2.0_f64.sqrt() * 16.0_f64.powf(0.25) * r.powf(0.75)).sqrt();
        assert!((bound.angle_rad() / theory - 1.0).abs() < 0.02, "{} {theory}", bound.angle_rad());
    }

    #[test]
    fn unknown_sensors_cost_until_the_rotor_has_turned() {
        let prior = Prior { third: 0.05, offset_v: 0.1, amplitude_v: 0.3, placement_rad: 0.1, ..UNKNOWN };
        let (mut known, mut unknown) = (Bound::new(&UNKNOWN), Bound::new(&prior));
        let mut ratio = [0.0; 3];
        for k in 0..300 {
            for bound in [&mut known, &mut unknown] {
                bound.advance(1e-3, 0.0, 4.0);
                bound.observe(&noisy(), 20.0 * 1e-3 * f64::from(k), 0.0);
            }
            ratio[k as usize / 100] = unknown.angle_rad() / known.angle_rad();
        }
        assert!(ratio[0] > 4.0 && ratio[0] > ratio[1] && ratio[1] > ratio[2] && ratio[2] > 1.0, "{ratio:?}");
    }
}
