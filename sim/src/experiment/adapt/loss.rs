//! One sensor fails while the motor turns.

use super::trial::{self, Motion, PERIOD_S, Start, Trial};
use crate::statistics::Statistics;
use anyhow::Result;
use hallservo::hall::adapt::Status;
use hallservo::hall::estimate::Estimator;
use plant::{HallFault, Rail};
use std::f64::consts::TAU;

/// How a sensor fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The output stays where it happens to be.
    Stuck,
    /// A broken wire.
    Open,
    /// Shorted to the supply, or saturated.
    Saturated,
    /// The supply of the sensor is gone, and a divider holds the output in the middle.
    Middle,
}

impl Failure {
    /// The kind of a seed's failure.
    pub fn of(seed: u64) -> Self {
        [Self::Stuck, Self::Open, Self::Saturated, Self::Middle][(seed % 4) as usize]
    }
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Loss {
    /// Turns from the failure to its detection; `None` if it was not found.
    pub detected_turns: Option<f64>,
    /// Whether the right sensor was named.
    pub named: bool,
    /// Error of the filter's angle from the failure on, degrees.
    pub error: Statistics,
    /// Error of the two-sensor estimator from the detection on, degrees, without tracking.
    pub two_sensors: Statistics,
    /// The filter's error over time.
    pub plot: Vec<(f64, f64)>,
}

/// A calibrated motor at constant speed loses a sensor at some time.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn run(seed: u64, hz: f64) -> Result<Loss> {
    let halls = trial::halls(seed);
    let mut trial = Trial::new(seed, halls, Motion::Constant(hz), Start::Calibrated)?;
    let sensor = (seed / 4 % 3) as usize;
    let at_s = 0.5 + 0.37 * (seed as f64 * 0.754_877_666).fract();
    let mut loss = Loss {
        detected_turns: None,
        named: false,
        error: Statistics::default(),
        two_sensors: Statistics::default(),
        plot: Vec::new(),
    };
    let (mut turned, mut failed) = (0.0, false);
    let mut two: Option<Estimator> = None;
    while trial.time_s() < at_s + 6.0 / hz {
        let step = trial.step();
        if failed {
            turned += trial.bench.speed_rad_s().abs() * PERIOD_S / TAU;
            loss.error.push(step.error_deg);
        } else if trial.time_s() >= at_s {
            failed = true;
            let volts = match Failure::of(seed) {
                Failure::Stuck => HallFault::StuckAt(f64::from(step.codes[sensor]) * trial::LSB_V),
                Failure::Open => HallFault::Open(Rail::Low),
                Failure::Saturated => HallFault::Open(Rail::High),
                Failure::Middle => HallFault::StuckAt(1.65),
            };
            trial.bench.set_fault(sensor, Some(volts));
        }
        loss.plot.push((trial.time_s() - at_s, step.error_deg));
        if let Status::Failed(fault) = step.outcome {
            loss.detected_turns = failed.then_some(turned);
            if let Some(lost) = fault.lost() {
                loss.named = usize::from(lost.0) == sensor;
                two = Some(Estimator::without(lost, trial.adapter.model(), 12)?);
            }
        }
        if let Some(angle) = two.as_ref().and_then(|two| two.angle(&step.codes).ok()) {
            loss.two_sensors.push(trial::wrapped_deg(f64::from(angle.to_radians()) - trial.hall_rad()));
        }
    }
    Ok(loss)
}
