//! When measurements are not where they were predicted: has the rotor been pushed, or is a sensor wrong?

use super::filter::{ANGLE, Measurement, SPEED, Sample};
use super::{Adapter, Fault, GATE, Outcome, Phase};
use crate::hall::{Channel, Codes};
use core::f32::consts::TAU;

/// Turns for which a sensor may contradict the others.
const LIMIT_TURNS: f32 = 0.2;
/// Turns of doubt that a believed turn takes back.
const FORGIVENESS: f32 = 0.25;
/// Fewest samples in a row at the ADC's rail, and fewest contradictions, of a lost sensor.
const FEWEST: u32 = 4;
/// Squared deviations that may remain when an outlier is explained by the rotor's having been pushed.
const PUSHED: f32 = 9.0;
/// Samples that no angle explains, after which all parameters are doubted.
const JOLTS: u32 = 6;
/// Times that all parameters may be doubted before one turn is understood.
const RESTARTS: u32 = 4;

/// What speaks against a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Doubt {
    turns: f32,
    times: u32,
    at_rail: u32,
}

/// What speaks against the sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Doubts {
    sensors: [Doubt; 3],
    /// Whether anything does.
    any: bool,
    jolts: u32,
    restarts: u32,
}

impl Doubt {
    fn exists(&self) -> bool {
        self.turns > 0.0 || self.at_rail > 0
    }

    /// Turns that fit take doubt back.
    fn forgive(&mut self, turns: f32) {
        self.turns -= FORGIVENESS * turns;
        if self.turns <= 0.0 {
            (self.turns, self.times) = (0.0, 0);
        }
    }
}

impl Doubts {
    /// Sensors in doubt.
    pub fn sensors(&self) -> [bool; 3] {
        self.sensors.map(|doubt| doubt.turns > 0.0)
    }

    /// Whether any sensor is.
    pub fn exist(&self) -> bool {
        self.any
    }

    /// All that was doubted is understood.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

impl Adapter {
    /// Whether a sensor is at the rail, or was, or is lost.
    #[inline(always)]
    pub(super) fn is_railed(&self, codes: &Codes) -> bool {
        let at_rail = |code| self.config.is_at_rail(code);
        self.doubts.any | at_rail(codes[0]) | at_rail(codes[1]) | at_rail(codes[2])
    }

    /// Sensors that cannot be used, of a sample with something wrong; `None` if only one can.
    #[cold]
    pub(super) fn useless(&mut self, codes: &Codes) -> Option<[bool; 3]> {
        let mut useless = codes.map(|code| self.config.is_at_rail(code));
        for (doubt, at_rail) in self.doubts.sensors.iter_mut().zip(useless) {
            doubt.at_rail = if at_rail { doubt.at_rail.saturating_add(1) } else { 0 };
        }
        if self.fault.is_none() {
            if let Some(k) = self.doubts.sensors.iter().position(|doubt| doubt.at_rail >= FEWEST) {
                self.fail(Fault::AtRail(Channel(k as u8)));
            }
        }
        self.doubts.any = self.fault.is_some() || self.doubts.sensors.iter().any(Doubt::exists);
        if let Some(lost) = self.fault.and_then(Fault::lost) {
            useless[usize::from(lost.0)] = true;
        }
        if useless.iter().filter(|&&useless| useless).count() > 1 {
            self.phase = Phase::Blind;
            return None;
        }
        Some(useless)
    }

    /// Turns in so many samples; none where the rotor may be at rest.
    fn turns(&self, samples: f32) -> f32 {
        let speed = self.state.speed.abs();
        if speed >= self.config.slowest { speed * samples / TAU } else { 0.0 }
    }

    /// Works in a sample with an outlier, or with a sensor that was one.
    #[cold]
    pub(super) fn reconcile(&mut self, elapsed: f32, measurements: &mut [Measurement; 3]) -> Outcome {
        let sample = Sample::new(measurements, &self.covariance);
        let outliers = [0, 1, 2].map(|k| sample.is_outlier(k, GATE));
        let turns = self.turns(elapsed);
        let doubted = self.doubts.sensors.iter().position(|doubt| doubt.turns > 0.0);
        match (doubted, outliers) {
            (Some(k), _) => {
                // It is watched, but not believed until it is forgiven.
                let outlier = outliers[k];
                measurements[k].discard();
                let doubt = &mut self.doubts.sensors[k];
                if outlier {
                    self.suspect(k, turns, measurements)
                } else {
                    doubt.forgive(turns);
                    self.believe(measurements)
                }
            }
            (None, [false, false, false]) => self.believe(measurements),
            (None, [true, false, false]) => self.pushed_or_wrong(0, turns, measurements),
            (None, [false, true, false]) => self.pushed_or_wrong(1, turns, measurements),
            (None, [false, false, true]) => self.pushed_or_wrong(2, turns, measurements),
            (None, _) => match self.push(&Sample::new(measurements, &self.covariance), f32::MAX) {
                true => self.believe(measurements),
                false => self.jolt(),
            },
        }
    }

    /// One outlier: whichever explains the sample better.
    fn pushed_or_wrong(&mut self, sensor: usize, turns: f32, measurements: &mut [Measurement; 3]) -> Outcome {
        let sample = Sample::new(measurements, &self.covariance);
        let others = (0..3).filter(|&k| k != sensor).map(|k| sample.squared(k)).sum();
        if self.push(&sample, others) {
            return self.believe(measurements);
        }
        measurements[sensor].discard();
        self.suspect(sensor, turns, measurements)
    }

    /// If a push explains the sample, and better than the alternative: the rotor is elsewhere, and has got there by a
    /// speed that was not known.
    fn push(&mut self, sample: &Sample, alternative: f32) -> bool {
        let (by, remaining) = sample.as_a_push();
        let pushed = remaining < PUSHED && remaining < alternative;
        if pushed {
            self.covariance.widen(ANGLE, by * by, f32::MAX);
            self.covariance.widen(SPEED, by * by * self.pace * self.pace, f32::MAX);
        }
        pushed
    }

    /// Angle and speed from a sample as it is, unless what is not discarded has an outlier still.
    fn believe(&mut self, measurements: &[Measurement; 3]) -> Outcome {
        let sample = Sample::new(measurements, &self.covariance);
        if [0, 1, 2].iter().any(|&k| sample.is_outlier(k, GATE)) {
            if !self.push(&sample, f32::MAX) {
                return self.jolt();
            }
        }
        let sample = Sample::new(measurements, &self.covariance);
        self.work_in(sample, false);
        self.follow()
    }

    /// One sensor, discarded, contradicts the other two.
    fn suspect(&mut self, sensor: usize, turns: f32, measurements: &[Measurement; 3]) -> Outcome {
        let doubt = &mut self.doubts.sensors[sensor];
        doubt.turns += turns;
        doubt.times += 1;
        self.doubts.any = true;
        if doubt.turns > LIMIT_TURNS && doubt.times >= FEWEST && self.fault.is_none() {
            self.fail(Fault::Lost(Channel(sensor as u8)));
        }
        self.believe(measurements)
    }

    /// Nothing fits: the angle is sought anew, and if that does not help, the parameters.
    fn jolt(&mut self) -> Outcome {
        self.phase = Phase::Blind;
        self.doubts.jolts += 1;
        if self.doubts.jolts < JOLTS || self.fault.is_some() {
            return Outcome::Acquiring;
        }
        self.doubts = Doubts { restarts: self.doubts.restarts + 1, ..Doubts::default() };
        if self.doubts.restarts > RESTARTS {
            self.fail(Fault::Contradiction);
        } else {
            self.restart();
        }
        Outcome::Acquiring
    }

    /// Ends learning; angle and speed go on.
    pub(super) fn fail(&mut self, fault: Fault) {
        self.fault = Some(fault);
        self.doubts.any = true;
    }
}

impl Sample<'_> {
    /// By how much a pushed rotor would explain the innovations best, and what remains then, in squared deviations.
    fn as_a_push(&self) -> (f32, f32) {
        let (mut slopes, mut product) = (f32::MIN_POSITIVE, 0.0);
        for m in self.measurements {
            slopes += m.angle * m.angle / m.noise;
            product += m.angle * m.innovation / m.noise;
        }
        let by = product / slopes;
        let rests = self.measurements.iter().zip(&self.variances).map(|(m, variance)| {
            let rest = m.innovation - m.angle * by;
            rest * rest / (variance + m.noise)
        });
        (by, rests.sum())
    }

    /// A measurement's innovation in squared deviations.
    fn squared(&self, sensor: usize) -> f32 {
        let m = &self.measurements[sensor];
        m.innovation * m.innovation / (self.variances[sensor] + m.noise)
    }
}
