//! The adaptation at rotors that its model does not explain.

use super::trial::{self, Motion, PERIOD_S, Start, Trial};
use crate::statistics::Statistics;
use anyhow::Result;
use hallservo::angle::ElectricalAngle;
use hallservo::hall::adapt::{Fault, Settings, Status};
use hallservo::hall::calibrate::{Calibration, Collector, Sweep};
use plant::{HallFault, HallParameters, Magnets, Unevenness};
use std::f64::consts::TAU;

/// What came of a run.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Why the adaptation ended.
    pub fault: Option<Fault>,
    /// Electrical turns until then from the start of the fault that was made, if one was.
    pub turns: f64,
    /// Error of the filter's angle, less its mean, electrical degrees RMS.
    pub error_deg_rms: f64,
    /// Samples of which parameters were learnt, as a share.
    pub learning: f64,
}

/// What a calibration finds that turns the rotor eight times each way, in a field that it follows exactly.
///
/// # Errors
/// Parameters that plant or calibration refuse.
pub fn calibrated(seed: u64, halls: [HallParameters; 3], magnets: Magnets) -> Result<Calibration> {
    let mut collector = Collector::new(12);
    let mut sequence = 0;
    for sweep in [Sweep::Forward, Sweep::Backward] {
        let hz = if sweep == Sweep::Forward { 10.0 } else { -10.0 };
        let settings = Settings::default();
        let motion = Motion::Constant(hz);
        let mut trial = Trial::at(seed, halls, magnets, motion, &trial::nominal_model(), &settings)?;
        for _ in 0..3200 {
            trial.bench.set_speed(TAU * hz);
            let codes = trial.bench.step(0.0);
            let field = ElectricalAngle::from_radians(trial.bench.angle_rad() as f32);
            collector.push(sweep, field, &codes, sequence);
            sequence += 1;
        }
        sequence += 10;
    }
    Ok(collector.finish(trial::count(&halls), false)?)
}

/// A filter that starts from such a calibration.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn trial(seed: u64, unevenness: &Unevenness, motion: Motion, learns: bool) -> Result<Trial> {
    trial_of(trial::halls(seed), seed, unevenness, motion, learns)
}

/// The same with two sensors that are so far apart.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn trial_of_two(apart_deg: f64, seed: u64, unevenness: &Unevenness, motion: Motion, learns: bool) -> Result<Trial> {
    trial_of(trial::two_halls(apart_deg, seed), seed, unevenness, motion, learns)
}

/// The same with these sensors.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn trial_of(
    halls: [HallParameters; 3],
    seed: u64,
    unevenness: &Unevenness,
    motion: Motion,
    learns: bool,
) -> Result<Trial> {
    let halls = unevenness.halls(halls, 0.0, seed);
    let magnets = unevenness.magnets(seed);
    let calibration = calibrated(seed, halls, magnets)?;
    let settings = trial::settings(Start::Calibrated);
    // Above the largest speed, nothing is learnt.
    let settings = Settings { slowest_hz: if learns { settings.slowest_hz } else { 100.0 }, ..settings };
    Trial::at(seed, halls, magnets, motion, &calibration.model, &settings)
}

/// Breaks a sensor after some electrical turns; the turns until it is named, and what is named.
pub fn lose(mut trial: Trial, turns: f64, sensor: usize, fault: HallFault) -> Option<(f64, Fault)> {
    let mut turned = 0.0;
    while turned < turns + 3.0 {
        let broken = turned >= turns;
        trial.bench.set_fault(sensor, broken.then_some(fault));
        let step = trial.step();
        if let Status::Failed(found) = step.outcome {
            return Some((turned - turns, found));
        }
        turned += trial.bench.speed_rad_s().abs() * PERIOD_S / TAU;
    }
    None
}

/// Runs a trial for a time; the first two seconds do not count.
pub fn run(mut trial: Trial, seconds: f64) -> Outcome {
    let (mut errors, mut learning, mut samples, mut fault) = (Statistics::default(), 0.0, 0.0, None);
    let mut turned = 0.0;
    while trial.time_s() < seconds {
        let step = trial.step();
        turned += trial.bench.speed_rad_s().abs() * PERIOD_S / TAU;
        if let Status::Failed(found) = step.outcome {
            fault = Some(found);
            break;
        }
        samples += 1.0;
        learning += f64::from(u8::from(matches!(step.outcome, Status::Adapting | Status::ModelReady)));
        if trial.time_s() > 2.0 {
            errors.push(step.error_deg);
        }
    }
    let error_deg_rms = (errors.rms().powi(2) - errors.mean().powi(2)).max(0.0).sqrt();
    Outcome { fault, turns: turned, error_deg_rms, learning: learning / samples }
}
