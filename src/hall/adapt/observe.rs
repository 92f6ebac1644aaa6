//! One sensor as the filter sees it: signals relative to the calibration, and their derivatives.

use super::filter::{Measurement, State};
use crate::angle::ElectricalAngle;
use crate::hall::model::Sensor;
use crate::trig;

/// What the filter does not estimate of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fixed {
    /// The calibration, from which offset and amplitude are counted.
    pub sensor: Sensor,
    per_code: f32,
    /// The harmonics: 1 + 3h₃ + 5h₅, −4h₃ − 20h₅, 16h₅.
    series: [f32; 3],
    /// Variance of noise and quantisation, relative to the squared amplitude.
    pub noise: f32,
}

/// What the best model leaves unexplained, relative to the amplitude.
const UNEXPLAINED: f32 = 2e-3;

impl Fixed {
    pub fn new(sensor: &Sensor, noise_codes: f32) -> Self {
        let per_code = 1.0 / sensor.amplitude;
        let codes = noise_codes * noise_codes + 1.0 / 12.0;
        let (third, fifth) = (sensor.third, sensor.fifth);
        let series = [1.0 + 3.0 * third + 5.0 * fifth, -4.0 * third - 20.0 * fifth, 16.0 * fifth];
        Self { sensor: *sensor, per_code, series, noise: codes * per_code * per_code + UNEXPLAINED * UNEXPLAINED }
    }

    /// The signal: 0 at the calibrated offset, ±1 at the calibrated amplitude.
    #[inline(always)]
    pub fn signal(&self, code: u16) -> f32 {
        (f32::from(code) - self.sensor.offset) * self.per_code
    }

    /// Compares a code with what the state predicts.
    #[inline(always)]
    pub fn measure(&self, sensor: usize, state: &State, code: u16, curvature: f32) -> Measurement {
        let (sine, cosine) = sine_cosine(state.angle - state.placement[sensor]);
        // With h3 and h5: sin 3x = sin x · (3 − 4 sin² x), sin 5x = sin x · (5 − 20 sin² x + 16 sin⁴ x), and likewise the
        // cosines, so that wave = sin x · (a + q·(b + q·c)), slope = cos x · (a + q·(3b + 5q·c)) with q = sin² x.
        let square = sine * sine;
        let [a, b, c] = self.series;
        let (a, b, c) = (a + 3.0 * state.third, b - 4.0 * state.third, c * square);
        let wave = sine * (a + square * (b + c));
        let slope = cosine * (a + square * (3.0 * b + 5.0 * c));
        let amplitude = state.amplitude[sensor];
        Measurement {
            innovation: self.signal(code) - state.offset[sensor] - amplitude * wave,
            noise: self.noise + curvature,
            angle: amplitude * slope,
            amplitude: wave,
            third: amplitude * sine * (3.0 - 4.0 * square),
        }
    }
}

/// Sine and cosine from the table.
#[inline(always)]
pub fn sine_cosine(angle: ElectricalAngle) -> (f32, f32) {
    const ONE: f32 = 1.0 / (1_u32 << 30) as f32;
    (trig::sin(angle).to_bits() as f32 * ONE, trig::cos(angle).to_bits() as f32 * ONE)
}

/// The angle that explains three (or, ignoring some, two) signals best as sinusoids.
pub fn acquire(state: &State, signals: &[f32; 3], ignore: &[bool; 3]) -> ElectricalAngle {
    // Normal equations of signal = offset + amplitude · (sin θ · cos ψ − cos θ · sin ψ).
    let (mut cc, mut ss, mut cs, mut yc, mut ys) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for k in (0..3).filter(|&k| !ignore[k]) {
        let (sine, cosine) = sine_cosine(state.placement[k]);
        let (c, s) = (state.amplitude[k] * cosine, -state.amplitude[k] * sine);
        let y = signals[k] - state.offset[k];
        cc += c * c;
        ss += s * s;
        cs += c * s;
        yc += y * c;
        ys += y * s;
    }
    // The determinant is positive and does not turn the vector.
    ElectricalAngle::from_radians(libm::atan2f(yc * ss - ys * cs, ys * cc - yc * cs))
}
