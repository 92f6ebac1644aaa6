//! Keeps the sensors true while the motor runs: an extended Kalman filter over angle, speed and the sensors' parameters.
//!
//! Simpkins and Todorov, section III.C, with the errata: offset and amplitude (their α and β) are estimated, too, and
//! the joint covariance of angle and parameters is carried, for that is what tells a misplaced sensor from a turned rotor. φ
//! cannot be seen by the Halls and stays as aligned. Beyond the paper, the third harmonic of the magnet is a state:
//! left out, it would bend the other parameters. The motor's equation of motion, eq. (11), predicts the speed from the
//! torque.
//!
//! The filter runs in a task, at about 1 kHz, on samples that the control interrupt queues; some may be missing. What
//! it has learnt comes out as a [`Model`] ([`Adapter::model`]) from which the fast path's tables are made anew.
//!
//! What keeps it safe:
//! - Parameters move only above [`Settings::slowest_hz`]; below, only angle and speed follow.
//! - A model comes out only when all of the turn has been seen since the last.
//! - Parameters stay in a box around the calibration. One found at the edge of the box twice is a [`Fault::Drifted`].
//! - A measurement more than five standard deviations off is not believed, unless all three together say that the rotor
//!   has been pushed. A sensor that is not believed for a fifth of a turn is a [`Fault::Lost`]; angle and speed go on from
//!   the other two.
//! - Parameters' uncertainty grows by their drift only for the time between turns that were seen whole, and never beyond
//!   where it started. At rest nothing grows.
//!
//! A load that is not told is found by integrating what the speed is corrected by.

mod doubt;
mod fault;
mod filter;
mod observe;
mod settings;

use crate::angle::ElectricalAngle;
use crate::hall::Codes;
use crate::hall::estimate::{self, BadModel};
use crate::hall::model::Model;
use core::f32::consts::TAU;
use doubt::Doubts;
pub use fault::{Fault, Parameter};
use filter::{ANGLE, Covariance, Measurement, OFFSET, SPEED, STATES, Sample, State, THIRD, Vector, radians};
use observe::Fixed;
pub use settings::{Config, OutOfRange, Settings, Spread};

/// Squared number of standard deviations beyond which a measurement is an outlier.
const GATE: f32 = 25.0;
/// Fewest samples of a turn seen whole.
const WHOLE: u32 = 64;
/// Most samples that may be missing in a row for the speed to be believed.
const LONGEST_GAP: u16 = 20;
/// Squared number of deviations by which the rotor must turn to be learnt from.
const CERTAIN: f32 = 9.0;
/// Fastest speed to learn at, rad a sample: five samples a turn.
const FASTEST: f32 = TAU / 5.0;

/// A sample for the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Observation {
    /// The Halls.
    pub codes: Codes,
    /// Sample periods since the last observation: one, or more where samples were lost.
    pub elapsed: u16,
    /// Torque in the direction of the Hall angle as far as it is known, N·m, mean since the last observation.
    pub torque_nm: f32,
}

/// What came of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// Looking for angle and speed.
    Acquiring,
    /// Too slow to learn, something is doubted, or a fault: angle and speed are followed.
    Following,
    /// Parameters are being learnt.
    Learning,
    /// A turn has been seen whole: [`Adapter::model`] is new.
    Learnt,
    /// A fault has been found, just now; [`Adapter::fault`] keeps it.
    Failed(Fault),
}

/// Standard deviations of the estimates; offset, amplitude and third harmonic relative to the calibrated amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deviations {
    /// Radians.
    pub angle: f32,
    /// Radians a sample.
    pub speed: f32,
    /// Third harmonic.
    pub third: f32,
    /// Of each sensor.
    pub offset: [f32; 3],
    /// Of each sensor.
    pub amplitude: [f32; 3],
    /// Radians; the first is the origin.
    pub placement: [f32; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Nothing is known of the angle.
    Blind,
    /// The angle is known, the speed is not.
    Still,
    Tracking,
}

/// The adaptation of one drive; at most 800 bytes.
#[derive(Clone, Debug)]
pub struct Adapter {
    config: Config,
    fixed: [Fixed; 3],
    state: State,
    covariance: Covariance,
    /// Variances at the start, and those gained in a sample.
    start: Vector,
    drift: Vector,
    /// Natural frequency of the tracking, rad a sample.
    pace: f32,
    /// Variance of the angle below which what the speed is corrected by is a load, and the share of it.
    settled: f32,
    load_gain: f32,
    /// Acceleration by what is not told, rad/sample².
    load: f32,
    phase: Phase,
    /// Eighths of the turn seen since the last model, and samples learnt from and passed since then.
    seen: u8,
    learnt: u32,
    since: u32,
    paused: u32,
    edge: Option<Fault>,
    doubts: Doubts,
    fault: Option<Fault>,
    /// Whether the fault has been reported.
    told: bool,
    model: Model,
}

impl Adapter {
    /// Starts from a calibration, or from a data sheet's model (with [`Settings::NOMINAL`] as `start`).
    ///
    /// # Errors
    /// [`BadModel`] where the fast path could not work with the model either.
    pub fn new(config: &Config, model: &Model) -> Result<Self, BadModel> {
        estimate::validate(model, config.adc_bits)?;
        let start = parameters(&config.start);
        let fixed = [0, 1, 2].map(|k| Fixed::new(&model.sensors[k], config.noise_codes[k]));
        // Of the angle from one sample: two thirds of the sensors' mean.
        let angle_noise = (fixed[0].noise + fixed[1].noise + fixed[2].noise) * (2.0 / 9.0);
        let pace = libm::sqrtf(libm::sqrtf(config.acceleration / angle_noise));
        Ok(Self {
            config: *config,
            fixed,
            state: State {
                angle: ElectricalAngle::ZERO,
                speed: 0.0,
                third: 0.0,
                offset: [0.0; 3],
                amplitude: [1.0; 3],
                placement: model.sensors.map(|sensor| sensor.placement),
            },
            covariance: Covariance::diagonal(&start),
            start,
            drift: parameters(&config.drift),
            pace,
            // Four times √2 · pace · noise, the variance of known sensors' tracked angle.
            settled: 5.7 * pace * angle_noise,
            // Slow enough to leave the tracking stable and hardly noisier.
            load_gain: 0.1 * pace,
            load: 0.0,
            phase: Phase::Blind,
            seen: 0,
            learnt: 0,
            since: 0,
            paused: 0,
            edge: None,
            doubts: Doubts::default(),
            fault: None,
            told: false,
            model: *model,
        })
    }

    /// Works in a sample.
    pub fn update(&mut self, observation: &Observation) -> Outcome {
        let outcome = self.process(observation);
        match self.fault {
            Some(fault) if !self.told => {
                self.told = true;
                Outcome::Failed(fault)
            }
            _ => outcome,
        }
    }

    #[inline(always)]
    fn process(&mut self, observation: &Observation) -> Outcome {
        let elapsed = u32::from(observation.elapsed);
        let samples = f32::from(observation.elapsed);
        self.since = self.since.saturating_add(elapsed);
        let mut useless = [false; 3];
        if self.is_railed(&observation.codes) {
            match self.useless(&observation.codes) {
                Some(which) => useless = which,
                None => return Outcome::Acquiring,
            }
        }
        let gap =
            observation.elapsed > 1 && (observation.elapsed > LONGEST_GAP || self.state.speed.abs() * samples > 1.5);
        if self.phase != Phase::Tracking || gap {
            self.load = if gap { 0.0 } else { self.load };
            return self.acquire(observation, useless);
        }
        for _ in 0..observation.elapsed {
            self.predict(observation.torque_nm);
        }
        let learn = self.may_learn();
        let mut measurements = self.measure(&observation.codes, learn);
        if self.doubts.exist() || useless != [false; 3] {
            discard(&mut measurements, useless);
            return self.reconcile(samples, &mut measurements);
        }
        let sample = Sample::new(&measurements, &self.covariance);
        if sample.is_outlier(0, GATE) | sample.is_outlier(1, GATE) | sample.is_outlier(2, GATE) {
            return self.reconcile(samples, &mut measurements);
        }
        self.work_in(sample, learn);
        if learn { self.learn() } else { self.follow() }
    }

    /// Finds the angle, and from two of them the speed.
    #[cold]
    fn acquire(&mut self, observation: &Observation, mut useless: [bool; 3]) -> Outcome {
        if useless == [false; 3] {
            useless = self.doubts.sensors();
        }
        let signals = [0, 1, 2].map(|k| self.fixed[k].signal(observation.codes[k]));
        let angle = observe::acquire(&self.state, &signals, &useless);
        let step = (angle - self.state.angle).to_radians();
        self.state.angle = angle;
        if self.phase != Phase::Still || observation.elapsed != 1 {
            self.phase = Phase::Still;
            return Outcome::Acquiring;
        }
        self.phase = Phase::Tracking;
        self.state.speed = step;
        // The parameters bend the angle, by some third of a radian a radian at worst.
        let deviation = 0.3 * libm::fabsf(step) + 0.04;
        self.covariance.forget(ANGLE, 0.15);
        self.covariance.forget(SPEED, deviation * deviation);
        let learn = self.may_learn();
        let mut measurements = self.measure(&observation.codes, learn);
        discard(&mut measurements, useless);
        self.work_in_rarely(&measurements, learn);
        Outcome::Acquiring
    }

    /// Angle and speed a sample later, as the equation of motion has them.
    #[inline(always)]
    fn predict(&mut self, torque_nm: f32) {
        let state = &mut self.state;
        let gained = self.config.per_nm * torque_nm + self.load - self.config.damping * state.speed;
        state.angle += radians(state.speed + 0.5 * gained);
        state.speed += gained;
        self.covariance.advance(self.config.acceleration);
    }

    /// All three sensors against their prediction, to learn from or only to follow.
    #[inline(always)]
    fn measure(&self, codes: &Codes, learn: bool) -> [Measurement; 3] {
        const ALIKE: f32 = 0.25;
        let times = if learn { 1.0 + ALIKE / self.state.speed.abs() } else { 1.0 };
        [
            self.fixed[0].measure(0, &self.state, codes[0], self.bend(0, times)),
            self.fixed[1].measure(1, &self.state, codes[1], self.bend(1, times)),
            self.fixed[2].measure(2, &self.state, codes[2], self.bend(2, times)),
        ]
    }

    /// What the derivatives at the predicted state leave out of a signal, as a variance: the sine's curvature over an
    /// uncertain angle, and the product of uncertain angle and amplitude. To the parameters it is alike from sample to sample
    /// until the rotor has turned by a quarter of a radian, so all samples within together must not count for more than one.
    #[inline(always)]
    fn bend(&self, sensor: usize, times: f32) -> f32 {
        let amplitude = OFFSET[sensor] + 1;
        let angle = self.covariance.get(ANGLE, ANGLE);
        angle * (0.5 * angle + self.covariance.get(amplitude, amplitude)) * times
    }

    /// Corrects.
    #[inline(always)]
    fn work_in(&mut self, sample: Sample, learn: bool) {
        let speed = self.state.speed;
        self.covariance.update(sample, &mut self.state, learn);
        if self.covariance.get(ANGLE, ANGLE) < self.settled {
            self.load += self.load_gain * (self.state.speed - speed);
        }
    }

    /// Corrects where nothing is in a hurry: once in the code, and not wherever that is.
    #[cold]
    #[inline(never)]
    fn work_in_rarely(&mut self, measurements: &[Measurement; 3], learn: bool) {
        self.work_in(Sample::outlined(measurements, &self.covariance), learn);
    }

    #[inline(always)]
    fn may_learn(&self) -> bool {
        let speed = self.state.speed.abs();
        let certain = speed * speed > CERTAIN * self.covariance.get(SPEED, SPEED);
        self.fault.is_none() && speed >= self.config.slowest && speed <= FASTEST && certain
    }

    fn follow(&mut self) -> Outcome {
        self.paused = self.paused.saturating_add(1);
        Outcome::Following
    }

    #[inline(always)]
    fn learn(&mut self) -> Outcome {
        if self.paused != 0 {
            self.resume();
        }
        self.learnt += 1;
        let eighth = 1 << (self.state.angle.to_bits() as u32 >> 29);
        if self.seen & eighth == 0 { self.new_eighth(eighth) } else { Outcome::Learning }
    }

    /// Learning has come to an eighth of the turn not seen since the last model.
    #[cold]
    fn new_eighth(&mut self, eighth: u8) -> Outcome {
        self.confine();
        self.seen |= eighth;
        if self.seen != u8::MAX {
            return Outcome::Learning;
        }
        self.seen = 0;
        if self.learnt < WHOLE { Outcome::Learning } else { self.whole_turn() }
    }

    /// Makes up for the drift while nothing was learnt.
    #[cold]
    fn resume(&mut self) {
        if self.paused >= self.config.pause {
            self.wander();
        }
        self.paused = 0;
    }

    /// The parameters may have drifted since the last time.
    fn wander(&mut self) {
        let samples = core::mem::take(&mut self.since) as f32;
        for state in THIRD..STATES {
            self.covariance.widen(state, self.drift[state] * samples, self.start[state]);
        }
    }

    /// Doubts all parameters as at the start.
    fn restart(&mut self) {
        self.covariance = Covariance::diagonal(&self.start);
        self.seen = 0;
        self.learnt = 0;
    }

    /// Keeps the parameters in the box.
    fn confine(&mut self) {
        let (limits, state) = (&self.config.limits, &mut self.state);
        let limit = radians(limits.placement_deg).to_bits();
        state.third = within(state.third, -limits.third, limits.third);
        for (k, fixed) in self.fixed.iter().enumerate() {
            state.offset[k] = within(state.offset[k], -limits.offset, limits.offset);
            state.amplitude[k] = within(state.amplitude[k], 1.0 - limits.amplitude, 1.0 + limits.amplitude);
            let middle = fixed.sensor.placement;
            let placement = (state.placement[k] - middle).to_bits().clamp(-limit, limit);
            state.placement[k] = middle + ElectricalAngle::from_bits(placement);
        }
    }

    /// The first parameter at the edge of the box.
    fn at_edge(&self) -> Option<Fault> {
        let (limits, state) = (&self.config.limits, &self.state);
        let reached = |value: f32, limit: f32| value.abs() >= 0.999 * limit;
        for k in 0..3 {
            let placement = (state.placement[k] - self.fixed[k].sensor.placement).to_radians();
            let parameter = if reached(state.offset[k], limits.offset) {
                Parameter::Offset
            } else if reached(state.amplitude[k] - 1.0, limits.amplitude) {
                Parameter::Amplitude
            } else if reached(placement, limits.placement_deg) {
                Parameter::Placement
            } else {
                continue;
            };
            return Some(Fault::Drifted(crate::hall::Channel(k as u8), parameter));
        }
        reached(state.third, limits.third).then_some(Fault::Distorted)
    }

    /// All of the turn has been seen.
    #[cold]
    fn whole_turn(&mut self) -> Outcome {
        self.learnt = 0;
        self.doubts.clear();
        self.wander();
        let edge = self.at_edge();
        if let Some(fault) = edge.filter(|_| edge == self.edge) {
            self.fail(fault);
            return Outcome::Following;
        }
        self.edge = edge;
        let model = self.current();
        if edge.is_some() || estimate::validate(&model, self.config.adc_bits).is_err() {
            return Outcome::Learning;
        }
        self.model = model;
        Outcome::Learnt
    }

    /// The model at this moment, to look at; [`Self::model`] is the one to use.
    pub fn current(&self) -> Model {
        let mut model = self.model;
        for (k, sensor) in model.sensors.iter_mut().enumerate() {
            let fixed = &self.fixed[k].sensor;
            sensor.offset = fixed.offset + self.state.offset[k] * fixed.amplitude;
            sensor.amplitude = fixed.amplitude * self.state.amplitude[k];
            sensor.placement = self.state.placement[k];
            sensor.third = fixed.third + self.state.third;
        }
        model
    }

    /// The model as of the last turn seen whole; at first, the one it started from.
    pub const fn model(&self) -> &Model {
        &self.model
    }

    /// Electrical angle at the last observation.
    pub fn angle(&self) -> ElectricalAngle {
        self.model.electrical(self.state.angle)
    }

    /// Hall angle at the last observation.
    pub const fn hall_angle(&self) -> ElectricalAngle {
        self.state.angle
    }

    /// Speed of the Hall angle, radians a sample.
    pub const fn speed(&self) -> f32 {
        self.state.speed
    }

    /// How well the filter believes to know what it estimates.
    pub fn deviations(&self) -> Deviations {
        let of = |state: usize| libm::sqrtf(self.covariance.get(state, state).max(0.0));
        Deviations {
            angle: of(ANGLE),
            speed: of(SPEED),
            third: of(THIRD),
            offset: OFFSET.map(of),
            amplitude: OFFSET.map(|own| of(own + 1)),
            placement: [0.0, of(OFFSET[1] + 2), of(OFFSET[2] + 2)],
        }
    }

    /// Why nothing is learnt any more.
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }
}

/// A spread as a vector over the states.
fn parameters(spread: &Spread) -> Vector {
    let mut vector = [0.0; STATES];
    vector[THIRD] = spread.third;
    for (k, own) in OFFSET.into_iter().enumerate() {
        vector[own] = spread.offset;
        vector[own + 1] = spread.amplitude;
        if k != 0 {
            vector[own + 2] = spread.placement_deg;
        }
    }
    vector
}

/// `value` within a range. `f32::clamp` says what is wrong with a range that is none, and brings all of the formatting of floats with
/// it into a firmware: 24 KiB.
fn within(value: f32, least: f32, most: f32) -> f32 {
    value.max(least).min(most)
}

fn discard(measurements: &mut [Measurement; 3], useless: [bool; 3]) {
    for (measurement, useless) in measurements.iter_mut().zip(useless) {
        if useless {
            measurement.discard();
        }
    }
}

#[cfg(test)]
mod tests;
