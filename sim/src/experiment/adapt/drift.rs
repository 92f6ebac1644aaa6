//! A temperature ramp: the sensors change while the motor turns.

use super::trial::{self, ACCELERATION_NOISE, LSB_V, Motion, PERIOD_S, Start, Trial};
use crate::report::Series;
use crate::statistics::Statistics;
use anyhow::Result;
use hallservo::angle::ElectricalAngle;
use hallservo::hall::adapt::Status;
use hallservo::hall::estimate::Estimator;
use hallservo::hall::model::Model;
use plant::HallParameters;
use std::f64::consts::TAU;

/// Length of the ramp.
pub const RAMP_S: f64 = 60.0;
/// Over the ramp.
const AMPLITUDE: f64 = -0.20;
/// Over the ramp, relative to the amplitude.
const OFFSET: f64 = 0.05;
/// Each sensor's share of the drift: alike in all, it would hardly reach the angle.
const SHARES: [f64; 3] = [1.0, 0.75, 0.5];
/// What the ramp warms by.
const KELVIN: f64 = 60.0;

/// What came of it, electrical degrees.
#[derive(Clone, Debug)]
pub struct Drift {
    /// The filter's angle.
    pub adapted: Statistics,
    /// The angle of the untouched calibration's estimator, tracked with the same bandwidth.
    pub untouched: Statistics,
    /// What the interrupt's estimator makes of codes without noise at the end, from the last model published.
    pub bias_adapted: Statistics,
    /// The same from the calibration.
    pub bias_untouched: Statistics,
    /// Whether something went wrong.
    pub diverged: bool,
    /// Both errors over time.
    pub plot: [Vec<(f64, f64)>; 2],
}

/// Sensors that drift.
fn drifting(seed: u64) -> [HallParameters; 3] {
    let mut halls = trial::halls(seed);
    for (hall, share) in halls.iter_mut().zip(SHARES) {
        hall.amplitude_drift_k = AMPLITUDE * share / KELVIN;
        hall.offset_drift_v_k = OFFSET * share * hall.amplitude_v / KELVIN;
    }
    halls
}

/// The sensors as they are when so warm.
fn at(halls: &[HallParameters; 3], kelvin: f64) -> [HallParameters; 3] {
    halls.map(|hall| HallParameters {
        amplitude_v: hall.amplitude_v * (1.0 + hall.amplitude_drift_k * kelvin),
        offset_v: hall.offset_v + hall.offset_drift_v_k * kelvin,
        ..hall
    })
}

/// One motor at constant speed.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn run(seed: u64, hz: f64) -> Result<Drift> {
    let halls = drifting(seed);
    let calibration = trial::exact_model(&halls);
    let mut trial = Trial::new(seed, halls, Motion::Constant(hz), Start::Calibrated)?;
    let untouched = Estimator::new(&calibration, 12)?;
    let mut tracker = SteadyKalman::new(trial.hall_rad(), TAU * hz);
    let mut drift = Drift {
        adapted: Statistics::default(),
        untouched: Statistics::default(),
        bias_adapted: Statistics::default(),
        bias_untouched: Statistics::default(),
        diverged: false,
        plot: [Vec::new(), Vec::new()],
    };
    while trial.time_s() < RAMP_S {
        let kelvin = KELVIN * trial.time_s() / RAMP_S;
        trial.bench.set_temperature(25.0 + kelvin);
        let step = trial.step();
        let angle = untouched.angle(&step.codes).ok().map(|angle| f64::from(angle.to_radians()));
        let without = trial::wrapped_deg(tracker.step(angle) - trial.hall_rad());
        drift.diverged |= matches!(step.outcome, Status::Failed(_));
        if trial.time_s() > 1.0 {
            drift.adapted.push(step.error_deg);
            drift.untouched.push(without);
            drift.plot[0].push((trial.time_s(), without));
            drift.plot[1].push((trial.time_s(), step.error_deg));
        }
    }
    let warm = at(&halls, KELVIN);
    drift.bias_adapted = bias(trial.adapter.model(), &warm)?;
    drift.bias_untouched = bias(&calibration, &warm)?;
    Ok(drift)
}

/// Errors of the interrupt's estimator over the turn, for a model of such sensors.
pub fn bias(model: &Model, halls: &[HallParameters; 3]) -> Result<Statistics> {
    let estimator = Estimator::new(model, 12)?;
    let mut bias = Statistics::default();
    for k in 0..3600 {
        let hall_rad = TAU * f64::from(k) / 3600.0;
        let codes = halls.map(|hall| {
            let x = hall_rad + halls[0].placement_rad - hall.placement_rad;
            let wave = x.sin() + hall.third * (3.0 * x).sin() + hall.fifth * (5.0 * x).sin();
            ((hall.offset_v + hall.amplitude_v * wave) / LSB_V).round() as u16
        });
        if let Ok(angle) = estimator.angle(&codes) {
            bias.push(trial::wrapped_deg(f64::from(ElectricalAngle::to_radians(angle)) - hall_rad));
        }
    }
    Ok(bias)
}

/// The steady-state Kalman filter of angle and speed for known sensors with one per cent of noise.
struct SteadyKalman {
    angle: f64,
    speed: f64,
    gains: [f64; 2],
}

impl SteadyKalman {
    fn new(angle: f64, speed: f64) -> Self {
        let noise = 1e-4 * 2.0 / 3.0;
        let q = ACCELERATION_NOISE * ACCELERATION_NOISE * PERIOD_S;
        let (mut p, mut gains) = ([1.0, 0.0, 1e4], [0.0; 2]);
        for _ in 0..10_000 {
            let [a, c, s] = p;
            let a = a + PERIOD_S * (2.0 * c + PERIOD_S * (s + 0.25 * q));
            let c = c + PERIOD_S * (s + 0.5 * q);
            let s = s + q;
            gains = [a / (a + noise), c / (a + noise)];
            p = [a * (1.0 - gains[0]), c * (1.0 - gains[0]), s - gains[1] * c];
        }
        Self { angle, speed, gains }
    }

    fn step(&mut self, measured: Option<f64>) -> f64 {
        self.angle += PERIOD_S * self.speed;
        if let Some(measured) = measured {
            let error = trial::wrapped_deg(measured - self.angle).to_radians();
            self.angle += self.gains[0] * error;
            self.speed += self.gains[1] * error;
        }
        self.angle
    }
}

impl Drift {
    /// Curves of the errors.
    pub fn series(&self) -> Vec<Series> {
        ["without adaptation", "adapted"]
            .into_iter()
            .zip(&self.plot)
            .map(|(name, points)| Series::new(name, points.iter().copied()))
            .collect()
    }
}
