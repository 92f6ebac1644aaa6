//! When measurements are not where they were predicted: has the rotor been pushed, or is a sensor wrong?

use super::filter::{ANGLE, Covariance, Measurement, Relation, SPEED};
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
/// Largest push, in radians, that the derivatives of the signals are good for.
const LARGEST: f32 = 0.15;
/// Samples in a row that nothing explains, after which the angle is sought anew.
const STRANGE: u32 = 4;
/// Times that the angle may be sought anew within a turn, after which all parameters are doubted.
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
    strange: u32,
    jolts: u32,
    restarts: u32,
    /// The sensor that is done without.
    lost: Option<Channel>,
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

    /// All that was doubted is understood.
    pub fn clear(&mut self) {
        *self = Self { lost: self.lost, ..Self::default() };
    }

    /// Whether it is done without a sensor.
    #[inline(always)]
    pub fn is_lost(&self, sensor: usize) -> bool {
        self.lost == Some(Channel(sensor as u8))
    }
}

impl Adapter {
    /// Whether a sensor is at the rail, or in doubt.
    #[inline(always)]
    pub(super) fn is_doubtful(&self, codes: &Codes) -> bool {
        let at_rail = |k: usize| self.config.is_at_rail(codes[k]);
        self.doubts.any | at_rail(0) | at_rail(1) | at_rail(2) && !self.is_known(codes)
    }

    /// Whether all that is wrong with a sample is a sensor that is done without.
    #[cold]
    fn is_known(&self, codes: &Codes) -> bool {
        !self.doubts.any && (0..3).all(|k| self.doubts.is_lost(k) || !self.config.is_at_rail(codes[k]))
    }

    /// Sensors that cannot be used, of a sample with something wrong; `None` if only one can.
    #[cold]
    pub(super) fn useless(&mut self, codes: &Codes) -> Option<[bool; 3]> {
        let mut useless = [false; 3];
        let mut stays = None;
        for (k, useless) in useless.iter_mut().enumerate() {
            let lost = self.doubts.is_lost(k);
            let at_rail = self.config.is_at_rail(codes[k]);
            *useless = lost | at_rail;
            let doubt = &mut self.doubts.sensors[k];
            doubt.at_rail = if at_rail & !lost { doubt.at_rail.saturating_add(1) } else { 0 };
            if doubt.at_rail >= FEWEST {
                stays = stays.or(Some(k));
            }
        }
        self.doubts.any = self.doubts.strange > 0 || self.doubts.sensors.iter().any(Doubt::exists);
        if let (None, Some(k)) = (self.fault, stays) {
            self.fail(Fault::AtRail(Channel(k as u8)));
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

    /// Works in a sample with an outlier, or with a sensor that was one, or without one.
    pub(super) fn reconcile(&mut self, elapsed: f32, sample: &mut Sample) -> Outcome {
        let outliers = sample.outliers();
        let doubted = self.doubts.sensors.iter().position(|doubt| doubt.turns > 0.0);
        if doubted.is_none() && outliers == [false; 3] {
            return self.believe(sample);
        }
        let suspect = doubted.unwrap_or_else(|| sample.farthest());
        let others_fit = (0..3).all(|k| k == suspect || !outliers[k]);
        let others = sample.squares.iter().sum::<f32>() - sample.squares[suspect];
        let alternative = match self.doubts.lost {
            // A sensor in doubt goes on contradicting sooner than the rotor is pushed just then.
            None if doubted.is_some() && others < PUSHED => 0.0,
            None => others,
            // Of two sensors, neither is the suspect.
            Some(_) => f32::INFINITY,
        };
        if outliers != [false; 3] && self.push(sample, alternative) {
            return self.believe(sample);
        }
        sample.discard(suspect);
        if !others_fit {
            return self.jolt();
        }
        // A suspect is watched, but not believed until it is forgiven.
        let turns = self.turns(elapsed);
        if outliers[suspect] {
            self.suspect(suspect, turns);
        } else {
            self.doubts.sensors[suspect].forgive(turns);
        }
        self.believe(sample)
    }

    /// Something does not fit: the next sample is looked at as a whole.
    #[cold]
    pub(super) fn doubt(&mut self) -> Outcome {
        self.doubts.any = true;
        self.follow()
    }

    /// If a push explains the sample, and better than the alternative: the rotor is elsewhere, and has got there by a
    /// speed that was not known.
    fn push(&mut self, sample: &mut Sample, alternative: f32) -> bool {
        let (by, remaining) = sample.as_a_push();
        let pushed = by.abs() < LARGEST && remaining < PUSHED && remaining < alternative;
        if pushed {
            // An unknown acceleration makes the tracking lag by itself over the square of the pace: half of it, to be careful.
            self.load += 0.5 * by * self.pace * self.pace;
            self.covariance.widen(ANGLE, by * by, f32::MAX);
            sample.widen(by * by);
            self.covariance.widen(SPEED, by * by * self.pace * self.pace, f32::MAX);
        }
        pushed
    }

    /// Angle and speed from a sample as it is, unless what is not discarded has an outlier still.
    fn believe(&mut self, sample: &mut Sample) -> Outcome {
        if sample.outliers() != [false; 3] {
            return self.jolt();
        }
        self.doubts.strange = 0;
        self.follow_all(&sample.measurements);
        self.follow()
    }

    /// One sensor contradicts the other two.
    fn suspect(&mut self, sensor: usize, turns: f32) {
        let doubt = &mut self.doubts.sensors[sensor];
        doubt.turns += turns;
        doubt.times += 1;
        self.doubts.any = true;
        if doubt.turns > LIMIT_TURNS && doubt.times >= FEWEST && self.fault.is_none() {
            self.fail(Fault::Lost(Channel(sensor as u8)));
        }
    }

    /// Nothing fits. A sample or two may be disturbed and are passed over; if more are, the angle is sought anew, and if that
    /// does not help, the parameters.
    fn jolt(&mut self) -> Outcome {
        self.doubts.any = true;
        self.doubts.strange += 1;
        if self.doubts.strange < STRANGE {
            return self.follow();
        }
        self.doubts.strange = 0;
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
        self.turned = false;
        self.doubts = Doubts { lost: fault.lost(), ..Doubts::default() };
    }
}

/// The three sensors of a sample.
pub struct Sample {
    pub measurements: [Measurement; 3],
    /// Of their innovations, noise included.
    variances: [f32; 3],
    /// Innovations in squared deviations.
    squares: [f32; 3],
}

impl Sample {
    pub fn new(measurements: [Measurement; 3], p: &Covariance) -> Self {
        let variances = [0, 1, 2].map(|k| measurements[k].variance(k, p) + measurements[k].noise);
        let mut sample = Self { measurements, variances, squares: [0.0; 3] };
        sample.widen(0.0);
        sample
    }

    /// The angle's variance is larger by so much.
    fn widen(&mut self, by: f32) {
        for (k, m) in self.measurements.iter().enumerate() {
            self.variances[k] += by * m.angle * m.angle;
            self.squares[k] = m.innovation * m.innovation / self.variances[k];
        }
    }

    /// Sensors farther from their prediction than is believed.
    fn outliers(&self) -> [bool; 3] {
        self.squares.map(|square| square > GATE)
    }

    fn discard(&mut self, sensor: usize) {
        self.measurements[sensor] = Measurement::NONE;
        self.squares[sensor] = 0.0;
    }

    /// By how much a pushed rotor would explain the innovations best, and what remains then, in squared deviations.
    fn as_a_push(&self) -> (f32, f32) {
        let (by, _) = common(&self.measurements);
        let rests = self.measurements.iter().zip(&self.variances).map(|(m, variance)| {
            let rest = m.innovation - m.angle * by;
            rest * rest / variance
        });
        (by, rests.sum())
    }

    /// The sensor farthest from its prediction.
    fn farthest(&self) -> usize {
        largest(&self.squares)
    }
}

/// By how much a turned rotor would explain the innovations best, and how certain that is: one over its variance, as far as
/// that comes from noise.
fn common(measurements: &[Measurement; 3]) -> (f32, f32) {
    let (mut certainty, mut product) = (f32::MIN_POSITIVE, 0.0);
    for m in measurements {
        let weight = m.angle / m.noise;
        certainty += m.angle * weight;
        product += m.innovation * weight;
    }
    (product / certainty, certainty)
}

/// What all of them tell of the angle, as one measurement, and its relation to the states.
pub fn condense(measurements: &[Measurement; 3], p: &Covariance) -> (Measurement, Relation) {
    let (by, certainty) = common(measurements);
    let noise = 1.0 / certainty;
    let weights = measurements.each_ref().map(|m| noise * m.angle / m.noise);
    let relation = Relation::of_all(measurements, &weights, p);
    (Measurement { innovation: by, noise, ..Measurement::NONE }, relation)
}

/// Which of three is the largest.
fn largest([a, b, c]: &[f32; 3]) -> usize {
    if a >= b && a >= c {
        0
    } else if b >= c {
        1
    } else {
        2
    }
}
