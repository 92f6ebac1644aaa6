//! Many motors: how fast and how well the filters find unknown sensors.

use super::trial::{self, ACCELERATION_NOISE, DAMPING_1_S, Motion, PERIOD_S, Start, Trial};
use crate::statistics::Statistics;
use anyhow::Result;
use baseline::filter::{Noises, PaperFilter};
use hallservo::hall::adapt::Status;
use std::f64::consts::TAU;

/// Parts of a turn over which errors of all motors are taken together.
pub const PARTS: usize = 8;
/// Turns of a run at constant speed.
pub const TURNS: usize = 8;
/// Turns after which an error counts as that of the steady state.
pub const STEADY_TURNS: usize = 4;
/// What is wanted, electrical degrees RMS.
pub const WANTED_DEG: f64 = 0.5;

/// Errors of one motor at constant speed, degrees: RMS over each part of a turn.
#[derive(Clone, Debug)]
pub struct Convergence {
    /// Of the filter.
    pub errors: Vec<Statistics>,
    /// Of the paper's.
    pub paper: Vec<Statistics>,
    /// The bound.
    pub bound: Vec<Statistics>,
    /// Every error in the steady state.
    pub steady: Vec<f64>,
    /// Whether something went wrong.
    pub diverged: bool,
}

/// One motor from its data sheet at constant speed.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn converge(seed: u64, hz: f64) -> Result<Convergence> {
    let hz = if seed.is_multiple_of(2) { hz } else { -hz };
    let mut trial = Trial::new(seed, trial::halls(seed), Motion::Constant(hz), Start::Nominal)?;
    let mut paper = paper_filter(&trial, hz);
    let part = 1.0 / (hz.abs() * PERIOD_S * PARTS as f64);
    let mut course = Convergence {
        errors: vec![Statistics::default(); PARTS * TURNS],
        paper: vec![Statistics::default(); PARTS * TURNS],
        bound: vec![Statistics::default(); PARTS * TURNS],
        steady: Vec::new(),
        diverged: false,
    };
    for k in 0..(part * (PARTS * TURNS) as f64) as usize {
        let step = trial.step();
        paper.step(step.codes, DAMPING_1_S * TAU * hz, DAMPING_1_S, PERIOD_S);
        let now = ((k as f64 / part) as usize).min(PARTS * TURNS - 1);
        course.errors[now].push(step.error_deg);
        course.bound[now].push(step.bound_deg);
        course.paper[now].push(trial::wrapped_deg(paper.angle - trial.hall_rad()));
        course.diverged |= matches!(step.outcome, Status::Failed(_)) || step.error_deg.is_nan();
        if now >= PARTS * STEADY_TURNS {
            course.steady.push(step.error_deg);
            course.diverged |= step.error_deg.abs() > 5.0;
        }
    }
    Ok(course)
}

/// The paper's filter with what its power-up routine finds, the true minima and maxima, at the true angle and speed.
pub fn paper_filter(trial: &Trial, hz: f64) -> PaperFilter {
    let ranges = trial.halls.map(|hall| {
        // A flattened sine's peak is lower than its fundamental's.
        let peak = hall.amplitude_v * (1.0 - hall.third + hall.fifth);
        ((hall.offset_v - peak) / trial::LSB_V, (hall.offset_v + peak) / trial::LSB_V)
    });
    let noises = Noises { angle: 1e-4, speed: ACCELERATION_NOISE * ACCELERATION_NOISE, placement: 1e-4, signal: 1e-4 };
    PaperFilter::new(ranges, trial.hall_rad(), TAU * hz, TAU / 3.0, noises)
}

/// RMS over all motors of each part of a turn.
pub fn over_time(courses: &[Convergence], of: impl Fn(&Convergence) -> &Vec<Statistics>) -> Vec<f64> {
    let power = |part: usize| {
        let (sum, count) = courses
            .iter()
            .map(|course| &of(course)[part])
            .fold((0.0, 0.0), |(sum, count), s| (sum + s.rms() * s.rms() * s.count(), count + s.count()));
        (sum / f64::max(count, 1.0)).sqrt()
    };
    (0..PARTS * TURNS).map(power).collect()
}

/// Turns after which an RMS stays below what is wanted; `None` if it never does.
pub fn convergence_turns(rms: &[f64]) -> Option<f64> {
    match rms.iter().rposition(|rms| !(*rms < WANTED_DEG)) {
        Some(last) if last + 1 == rms.len() => None,
        Some(last) => Some((last + 1) as f64 / PARTS as f64),
        None => Some(0.0),
    }
}

/// What came of a motion that is not constant.
#[derive(Clone, Copy, Debug)]
pub struct Tracking {
    /// After the first two turns, degrees.
    pub error: Statistics,
    /// The bound in the same time.
    pub bound: Statistics,
    /// Whether something went wrong.
    pub diverged: bool,
}

/// One motor from its data sheet over five seconds of a motion.
///
/// # Errors
/// Parameters that plant or filter refuse.
pub fn track(seed: u64, motion: Motion) -> Result<Tracking> {
    let mut trial = Trial::new(seed, trial::halls(seed), motion, Start::Nominal)?;
    let mut run = Tracking { error: Statistics::default(), bound: Statistics::default(), diverged: false };
    let mut turned = 0.0;
    while trial.time_s() < 5.0 {
        let step = trial.step();
        turned += trial.bench.speed_rad_s().abs() * PERIOD_S / TAU;
        run.diverged |= matches!(step.outcome, Status::Failed(_)) || step.error_deg.is_nan();
        if turned > 2.0 {
            run.error.push(step.error_deg);
            run.bound.push(step.bound_deg);
            run.diverged |= step.error_deg.abs() > 5.0;
        }
    }
    Ok(run)
}
