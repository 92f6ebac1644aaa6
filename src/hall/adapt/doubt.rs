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

impl Doubts {
    /// All that was doubted is understood.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

impl Adapter {
    /// Whether all three codes are off the rails and nothing is doubted.
    #[inline(always)]
    pub(super) fn is_healthy(&self, codes: &Codes) -> bool {
        let at_rail = |code| self.config.is_at_rail(code);
        !(self.doubts.any | at_rail(codes[0]) | at_rail(codes[1]) | at_rail(codes[2]))
    }

    /// The slow way through an observation with something wrong: discards what cannot be used. `Err` ends it.
    #[cold]
    pub(super) fn examine(&mut self, codes: &Codes) -> Result<[bool; 3], Outcome> {
        let mut useless = [false; 3];
        for (k, doubt) in self.doubts.sensors.iter_mut().enumerate() {
            useless[k] = self.config.is_at_rail(codes[k]);
            doubt.at_rail = if useless[k] { doubt.at_rail + 1 } else { 0 };
        }
        self.doubts.any = true;
        if self.fault.is_none() {
            self.forgive();
            if let Some(k) = self.doubts.sensors.iter().position(|doubt| doubt.at_rail >= FEWEST) {
                return Err(self.fail(Fault::AtRail(Channel(k as u8))));
            }
        }
        if let Some(lost) = self.fault.and_then(Fault::lost) {
            useless[lost.0 as usize] = true;
        }
        if useless.iter().filter(|&&useless| useless).count() > 1 {
            self.phase = Phase::Blind;
            return Err(Outcome::Acquiring);
        }
        Ok(useless)
    }

    /// Turns that pass take doubts back.
    fn forgive(&mut self) {
        let turns = FORGIVENESS * self.turns(1.0);
        let mut any = false;
        for doubt in &mut self.doubts.sensors {
            doubt.turns -= turns;
            if doubt.turns <= 0.0 {
                doubt.turns = 0.0;
                doubt.times = 0;
            }
            any |= doubt.turns > 0.0 || doubt.at_rail > 0;
        }
        self.doubts.any = any;
    }

    /// Turns in so many samples; none where the rotor may be at rest.
    fn turns(&self, samples: f32) -> f32 {
        let speed = self.state.speed.abs();
        if speed >= self.config.slowest { speed * samples / TAU } else { 0.0 }
    }

    /// Some measurement is an outlier.
    #[cold]
    pub(super) fn reconcile(&mut self, elapsed: f32, measurements: &mut [Measurement; 3]) -> Outcome {
        let sample = Sample::new(measurements, &self.covariance);
        let outliers = [0, 1, 2].map(|k| sample.is_outlier(k, GATE));
        let (pushed, remaining) = sample.as_a_push();
        if remaining < PUSHED {
            // The rotor is elsewhere, and has got there by a speed that was not known.
            let by = pushed * pushed;
            self.covariance.widen(ANGLE, by, f32::MAX);
            self.covariance.widen(SPEED, by * self.pace * self.pace, f32::MAX);
            return self.believe(measurements);
        }
        match outliers {
            [true, false, false] => self.suspect(0, elapsed, measurements),
            [false, true, false] => self.suspect(1, elapsed, measurements),
            [false, false, true] => self.suspect(2, elapsed, measurements),
            _ => self.jolt(),
        }
    }

    /// Angle and speed from what is left of the sample.
    fn believe(&mut self, measurements: &[Measurement; 3]) -> Outcome {
        let sample = Sample::new(measurements, &self.covariance);
        self.work_in(sample, false);
        self.follow()
    }

    /// One sensor contradicts the other two.
    fn suspect(&mut self, sensor: usize, elapsed: f32, measurements: &mut [Measurement; 3]) -> Outcome {
        let turns = self.turns(elapsed);
        let doubt = &mut self.doubts.sensors[sensor];
        doubt.turns += turns;
        doubt.times += 1;
        self.doubts.any = true;
        if doubt.turns > LIMIT_TURNS && doubt.times >= FEWEST && self.fault.is_none() {
            return self.fail(Fault::Lost(Channel(sensor as u8)));
        }
        measurements[sensor].discard();
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
            return self.fail(Fault::Contradiction);
        }
        self.restart();
        Outcome::Acquiring
    }

    pub(super) fn fail(&mut self, fault: Fault) -> Outcome {
        self.fault = Some(fault);
        self.doubts.any = true;
        Outcome::Failed(fault)
    }
}

impl Sample<'_> {
    /// By how much a pushed rotor would explain the innovations best, and what remains then, in squared deviations.
    fn as_a_push(&self) -> (f32, f32) {
        let (mut slopes, mut product) = (0.0, 0.0);
        for m in self.measurements {
            slopes += m.angle * m.angle / m.noise;
            product += m.angle * m.innovation / m.noise;
        }
        let by = product / slopes;
        let remaining = self.measurements.iter().zip(&self.variances).map(|(m, variance)| {
            let rest = m.innovation - m.angle * by;
            rest * rest / (variance + m.noise)
        });
        (by, remaining.sum())
    }
}
