//! One sensor as the filter sees it: signals relative to the calibration, and their derivatives.

use super::filter::{Measurement, State, radians};
use crate::hall::model::Sensor;
use crate::trig::sin_cos_f32;
use core::f32::consts::TAU;

/// A sensor as calibrated: what the filter does not estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibratedSensor {
    /// The calibration; offsets and amplitudes of the state are relative to it.
    pub sensor: Sensor,
    /// One over the calibrated amplitude, 1/codes.
    per_code: f32,
    /// Variance of noise and quantisation of one sample, relative to the squared amplitude.
    white: f32,
    /// Variance of what the rotor leaves unexplained, learnt while it turns; relative to the squared amplitude.
    pub unexplained: f32,
    /// What is known of it before, and the least that is taken for it: a slow rotor shows less, as its angle follows.
    known: f32,
    /// Means of the innovations over some turns: their constant part, and that in phase with the wave. That is what
    /// offset and amplitude have not caught up with, and no unevenness.
    behind: [f32; 2],
}

/// What the best model leaves unexplained of the best rotor, relative to the amplitude, squared.
const LEAST_UNEXPLAINED: f32 = 4e-6;
/// What is taken for it at first where there is a calibration: 0.55 % RMS. As on the best rotor, the first half turn would
/// bend the parameters by what its magnet differs, and from then on they would be taken for known.
const FIRST_UNEXPLAINED: f32 = 3e-5;
/// The same of the worst rotor: 15 % RMS.
const MOST_UNEXPLAINED: f32 = 0.0225;
/// Electrical turns over which it is averaged. The longer, the less a mean over it depends on where the poles differ.
const TURNS_OF_MEAN: f32 = 16.0;
/// The same for what the parameters have not caught up with.
const TURNS_BEHIND: f32 = 4.0;
/// Share of an outlier's square by which it is learnt at once, before the mean has it; and the most that it counts, for
/// a few may be disturbances.
const OUTLIER_SHARE: f32 = 0.01;
const MOST_OF_AN_OUTLIER: f32 = 3e-5;

/// Share of sin x, sin 3x and sin 5x that a mean of samples keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attenuation([f32; 3]);

impl Attenuation {
    /// A single sample keeps all.
    pub const NONE: Self = Self([1.0; 3]);

    /// The mean of three samples at this speed, rad a sample: (1 + 2·cos kω) / 3 of the k-th harmonic in the middle.
    #[inline]
    pub fn of_three(speed: f32) -> Self {
        let (_, c) = sin_cos_f32(radians(speed));
        let square = c * c;
        let cosines = [c, c * (4.0 * square - 3.0), c * (5.0 + square * (16.0 * square - 20.0))];
        Self(cosines.map(|cosine| (1.0 / 3.0) + (2.0 / 3.0) * cosine))
    }
}

impl CalibratedSensor {
    pub fn new(sensor: &Sensor, noise_codes: f32) -> Self {
        // Of a sensor that is not there, nothing.
        let per_code = if sensor.amplitude > 0.0 { 1.0 / sensor.amplitude } else { 0.0 };
        let white = (noise_codes * noise_codes + 1.0 / 12.0) * per_code * per_code;
        let known = LEAST_UNEXPLAINED;
        Self { sensor: *sensor, per_code, white, unexplained: known, known, behind: [0.0; 2] }
    }

    /// The rotor is known to leave so much unexplained, relative to the amplitude, RMS.
    pub fn expect_unexplained(&mut self, rms: f32) {
        self.known = (rms * rms).clamp(LEAST_UNEXPLAINED, MOST_UNEXPLAINED);
        self.unexplained = self.unexplained.max(self.known);
    }

    /// Starts from a calibration: nothing is known of the rotor yet.
    pub fn be_cautious(&mut self) {
        self.unexplained = FIRST_UNEXPLAINED;
    }

    /// Variance of one sample, relative to the squared amplitude.
    #[inline]
    pub fn noise(&self) -> f32 {
        self.white + self.unexplained
    }

    /// What the rotor leaves unexplained beyond what every rotor does, relative to the squared amplitude.
    #[inline]
    pub fn excess(&self) -> f32 {
        self.unexplained - LEAST_UNEXPLAINED
    }

    /// Learns what the rotor leaves unexplained from a measurement whose innovation has a variance, over an angle, rad.
    #[inline]
    pub fn learn_unexplained(&mut self, m: &Measurement, variance: f32, angle: f32) {
        let [constant, wave] = &mut self.behind;
        let rest = m.innovation - *constant - *wave * m.amplitude;
        let share = angle * (1.0 / (TAU * TURNS_BEHIND));
        *constant += share * rest;
        *wave += 2.0 * share * rest * m.amplitude;
        let excess = rest * rest - variance;
        let unexplained = self.unexplained + angle * (1.0 / (TAU * TURNS_OF_MEAN)) * excess;
        // Not `clamp`, which would look at the range as well.
        self.unexplained = if unexplained < self.known {
            self.known
        } else if unexplained > MOST_UNEXPLAINED {
            MOST_UNEXPLAINED
        } else {
            unexplained
        };
    }

    /// Learns it from an outlier that an uneven rotor may produce.
    pub fn learn_outlier(&mut self, innovation: f32) {
        let more = (OUTLIER_SHARE * innovation * innovation).min(MOST_OF_AN_OUTLIER);
        self.unexplained = (self.unexplained + more).min(MOST_UNEXPLAINED);
    }

    /// The signal: 0 at the calibrated offset, ±1 at the calibrated amplitude.
    #[inline]
    pub fn signal(&self, code: f32) -> f32 {
        (code - self.sensor.offset) * self.per_code
    }

    /// Compares a sample with what the state predicts.
    pub fn measure(&self, sensor: usize, state: &State, code: u16, curvature: f32) -> Measurement {
        self.compare(sensor, state, f32::from(code), Attenuation::NONE, self.noise() + curvature)
    }

    /// Compares the mean of three samples with what the state in the middle predicts.
    #[inline]
    pub fn measure_mean(&self, sensor: usize, state: &State, mean: f32, curvature: f32) -> Measurement {
        self.compare(
            sensor,
            state,
            mean,
            Attenuation::of_three(state.speed),
            self.white * (1.0 / 3.0) + self.unexplained + curvature,
        )
    }

    #[inline]
    fn compare(&self, sensor: usize, state: &State, code: f32, attenuation: Attenuation, noise: f32) -> Measurement {
        let (sine, cosine) = sin_cos_f32(state.angle - state.placement[sensor]);
        // sin 3x = sin x · (3 − 4 sin² x), sin 5x = sin x · (5 − 20 sin² x + 16 sin⁴ x), and likewise the cosines, so
        // that wave = sin x · (a + q·(b + q·c)), slope = cos x · (a + q·(3b + 5q·c)) with q = sin² x.
        let square = sine * sine;
        let Attenuation([first, third, fifth]) = attenuation;
        let h3 = third * (self.sensor.third + state.third);
        let h5 = fifth * self.sensor.fifth;
        let (a, b, c) = (first + 3.0 * h3 + 5.0 * h5, -4.0 * h3 - 20.0 * h5, 16.0 * h5 * square);
        let wave = sine * (a + square * (b + c));
        let slope = cosine * (a + square * (3.0 * b + 5.0 * c));
        let amplitude = state.amplitude[sensor];
        Measurement {
            innovation: self.signal(code) - state.offset[sensor] - amplitude * wave,
            noise,
            angle: amplitude * slope,
            amplitude: wave,
            third: amplitude * third * sine * (3.0 - 4.0 * square),
        }
    }
}
