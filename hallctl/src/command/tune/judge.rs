//! Which of the trials is good, and which swings by itself.

use super::trial::{Noise, Trial};
use crate::command::chirp::load::SWINGS;
use crate::response::Step;

/// Largest overshoot, per cent.
const OVERSHOOT_PCT: f64 = 10.0;
/// Largest noise of the current, as a share of the largest current.
const NOISE: f64 = 0.05;
/// Noise of the speed that is none, as a share of the step; and in that of the calmest trial.
const CALM: f64 = 0.01;
const LOUD: f64 = 2.0;
/// Noise of the speed while the motor turns, in that while it stands, from which on something turns with it.
const TURNING: f64 = 3.0;
/// From a bandwidth that is proposed to one that swings, at least: the gain margin, 6 dB.
const MARGIN: f32 = 2.0;

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judge {
    pub max_current_a: f64,
    /// Step of the speed, rad/s.
    pub size_rad_s: f64,
}

/// Whether a step is what it should be.
pub(super) fn follows(step: &Step) -> bool {
    step.settling_s.is_some() && step.overshoot_pct <= OVERSHOOT_PCT
}

impl Judge {
    /// Whether a loop swings by itself: the drive switched off, or the current does, or the speed beside that of the
    /// calmest.
    pub fn swings(&self, trial: &Trial, trials: &[Trial]) -> bool {
        let loud = |noise: fn(&Trial) -> Noise| {
            let Noise { speed_rad_s, current_a } = noise(trial);
            let calmest = trials.iter().map(|trial| noise(trial).speed_rad_s).fold(speed_rad_s, f64::min);
            current_a > SWINGS * self.max_current_a || speed_rad_s > (LOUD * calmest).max(CALM * self.size_rad_s)
        };
        trial.switched_off || loud(|trial| trial.turning) || loud(|trial| trial.standing)
    }

    /// Whether the speed swings while the motor turns and not while it stands, at the slowest bandwidth as well: by
    /// magnets, and no loop.
    pub fn swings_by_turning(&self, trials: &[Trial]) -> bool {
        let slowest = trials.iter().min_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz));
        slowest.is_some_and(|Trial { turning, standing, .. }| {
            turning.speed_rad_s > (TURNING * standing.speed_rad_s).max(CALM * self.size_rad_s)
        })
    }

    /// Whether the noise of the sensors makes too much current; one that is not a number is not measured.
    pub fn is_noisy(&self, trial: &Trial) -> bool {
        trial.turning.current_a.max(trial.standing.current_a) > NOISE * self.max_current_a
    }

    /// The lowest bandwidth that swings.
    pub fn lowest_swinging<'a>(&self, trials: &'a [Trial]) -> Option<&'a Trial> {
        let swinging = trials.iter().filter(|trial| self.swings(trial, trials));
        swinging.min_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz))
    }

    /// Trials that are far enough from any that swings.
    fn calm<'a>(&self, trials: &'a [Trial]) -> impl Iterator<Item = &'a Trial> {
        let most_hz = self.lowest_swinging(trials).map_or(f32::MAX, |trial| 1.01 * trial.bandwidth_hz / MARGIN);
        trials.iter().filter(move |trial| trial.bandwidth_hz <= most_hz)
    }

    /// The fastest good one.
    pub fn best<'a>(&self, trials: &'a [Trial]) -> Option<&'a Trial> {
        let good = self.calm(trials).filter(|trial| follows(&trial.step) && !self.is_noisy(trial));
        good.max_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz))
    }

    /// The fastest calm one, good or not.
    pub fn calmest<'a>(&self, trials: &'a [Trial]) -> Option<&'a Trial> {
        self.calm(trials).max_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz))
    }
}
