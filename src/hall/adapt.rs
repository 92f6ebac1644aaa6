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
//! - A measurement more than five standard deviations off is not believed. A sensor that is not believed for a fifth of a
//!   turn is a [`Fault::Lost`]; angle and speed go on from the other two.
//! - Parameters' uncertainty grows by their drift only for the time between turns that were seen whole, and never beyond
//!   where it started. At rest nothing grows.
//!
//! Range: 5 to 1000 samples an electrical turn while learning.

mod filter;
mod observe;
mod settings;

use crate::angle::ElectricalAngle;
use crate::hall::estimate::{self, BadModel};
use crate::hall::model::Model;
use crate::hall::{Channel, Codes};
use core::f32::consts::TAU;
use core::fmt;
use filter::{ANGLE, Covariance, Gate, OFFSET, SPEED, STATES, State, THIRD, Vector, radians};
use observe::Fixed;
pub use settings::{Config, OutOfRange, Settings, Spread};

/// Squared number of standard deviations beyond which a measurement is not believed.
const GATE: f32 = 25.0;
/// Turns that a sensor may contradict the others.
const DOUBT: f32 = 0.2;
/// Turns of doubt that a believed turn takes back.
const FORGIVENESS: f32 = 0.25;
/// Fewest samples in a row at the ADC's rail, and fewest contradictions, of a lost sensor.
const FEWEST: u32 = 4;
/// Fewest samples of a turn seen whole.
const WHOLE: u32 = 64;
/// Times that all parameters may be doubted before one turn is understood.
const RESTARTS: u32 = 4;
/// Samples in a row that no angle explains, after which the parameters are doubted.
const JOLTS: u32 = 6;
/// Most samples that may be missing in a row for the speed to be believed.
const LONGEST_GAP: u16 = 20;

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

/// What may run to the edge of the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Parameter {
    /// The signal's mean.
    Offset,
    /// The signal's size.
    Amplitude,
    /// The phase against the first sensor.
    Placement,
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Offset => "offset",
            Self::Amplitude => "amplitude",
            Self::Placement => "placement",
        })
    }
}

/// Why the adaptation has stopped learning, for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The sensor's code sits at the end of the ADC's range: open, shorted or saturated.
    AtRail(Channel),
    /// The sensor contradicts the other two: stuck, or its magnet or place has changed suddenly.
    Lost(Channel),
    /// The sensor has drifted to the edge of what is allowed around its calibration.
    Drifted(Channel, Parameter),
    /// The third harmonic has drifted to that edge.
    Distorted,
    /// No parameters near the calibration explain the three sensors.
    Contradiction,
}

impl Fault {
    /// The sensor to do without, where one is to blame and the others still give the angle.
    pub const fn lost(self) -> Option<Channel> {
        match self {
            Self::AtRail(channel) | Self::Lost(channel) => Some(channel),
            _ => None,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtRail(channel) => {
                write!(f, "{channel} stays at the end of the ADC's range: open, shorted or saturated")
            }
            Self::Lost(channel) => write!(f, "{channel} contradicts the other two: stuck or loose"),
            Self::Drifted(channel, parameter) => {
                write!(f, "the {parameter} of {channel} has drifted as far as allowed from its calibration")
            }
            Self::Distorted => write!(f, "the magnet's third harmonic has drifted as far as allowed"),
            Self::Contradiction => write!(f, "the Halls fit nothing near their calibration: calibrate again"),
        }
    }
}

impl core::error::Error for Fault {}

/// What came of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// Looking for angle and speed.
    Acquiring,
    /// Too slow to learn, or a fault: angle and speed are followed.
    Following,
    /// Parameters are being learnt.
    Learning,
    /// A turn has been seen whole: [`Adapter::model`] is new.
    Learnt,
    /// A fault has been found, just now; [`Adapter::fault`] keeps it.
    Failed(Fault),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Nothing is known of the angle.
    Blind,
    /// The angle is known, the speed is not.
    Still,
    Tracking,
}

/// What speaks against a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Doubt {
    turns: f32,
    times: u32,
    at_rail: u32,
}

/// The adaptation of one drive; 700 bytes.
#[derive(Clone, Debug)]
pub struct Adapter {
    config: Config,
    fixed: [Fixed; 3],
    state: State,
    covariance: Covariance,
    start: Vector,
    drift: Vector,
    phase: Phase,
    doubts: [Doubt; 3],
    jolts: u32,
    restarts: u32,
    /// Eighths of the turn seen since the last model, and samples learnt from and passed since then.
    seen: u8,
    learnt: u32,
    since: u32,
    paused: u32,
    edge: Option<Fault>,
    fault: Option<Fault>,
    model: Model,
}

impl Adapter {
    /// Starts from a calibration, or the nominal model (with [`Settings::NOMINAL`] as `start`).
    ///
    /// # Errors
    /// [`BadModel`] where the fast path could not work with the model either.
    pub fn new(config: &Config, model: &Model) -> Result<Self, BadModel> {
        estimate::validate(model, config.adc_bits)?;
        let vector = |spread: &Spread| {
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
        };
        let start = vector(&config.start);
        Ok(Self {
            config: *config,
            fixed: core::array::from_fn(|k| Fixed::new(&model.sensors[k], config.noise_codes[k])),
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
            drift: vector(&config.drift),
            phase: Phase::Blind,
            doubts: [Doubt::default(); 3],
            jolts: 0,
            restarts: 0,
            seen: 0,
            learnt: 0,
            since: 0,
            paused: 0,
            edge: None,
            fault: None,
            model: *model,
        })
    }

    /// Works in a sample.
    pub fn update(&mut self, observation: &Observation) -> Outcome {
        self.since = self.since.saturating_add(observation.elapsed.into());
        let mut ignore = self.at_rail(&observation.codes);
        if let Some(lost) = self.fault.and_then(Fault::lost) {
            ignore[lost.0 as usize] = true;
        }
        if observation.elapsed > LONGEST_GAP {
            self.phase = Phase::Blind;
        }
        match self.phase {
            Phase::Tracking => self.track(observation, ignore),
            _ => self.acquire(observation, ignore),
        }
    }

    /// Sensors at the rail of the ADC.
    #[inline(always)]
    fn at_rail(&mut self, codes: &Codes) -> [bool; 3] {
        let rail = (1_u32 << self.config.adc_bits) - 1;
        core::array::from_fn(|k| {
            // Code 0 wraps to the top.
            let at_rail = u32::from(codes[k]).wrapping_sub(1) >= rail - 1;
            self.doubts[k].at_rail = if at_rail { self.doubts[k].at_rail + 1 } else { 0 };
            at_rail
        })
    }

    /// Finds the angle, and from two of them the speed.
    #[cold]
    fn acquire(&mut self, observation: &Observation, ignore: [bool; 3]) -> Outcome {
        if let Some(outcome) = self.judge() {
            return outcome;
        }
        if ignore.iter().filter(|&&ignore| ignore).count() > 1 {
            self.phase = Phase::Blind;
            return Outcome::Acquiring;
        }
        let signals = core::array::from_fn(|k| self.fixed[k].signal(observation.codes[k]));
        let angle = observe::acquire(&self.state, &signals, &ignore);
        if self.phase == Phase::Still {
            let elapsed = f32::from(observation.elapsed.max(1));
            self.state.speed = (angle - self.state.angle).to_radians() / elapsed;
            // The parameters bend the angle, by some third of a radian a radian at worst.
            let deviation = 0.3 * libm::fabsf(self.state.speed) + 0.04 / elapsed;
            self.covariance.forget(ANGLE, 0.15);
            self.covariance.forget(SPEED, deviation * deviation);
            self.state.angle = angle;
            self.phase = Phase::Tracking;
            return self.work_in(observation, ignore);
        }
        self.state.angle = angle;
        self.phase = Phase::Still;
        Outcome::Acquiring
    }

    /// Predicts, then corrects.
    #[inline(always)]
    fn track(&mut self, observation: &Observation, ignore: [bool; 3]) -> Outcome {
        let samples = f32::from(observation.elapsed);
        let gained = samples * self.config.per_nm * observation.torque_nm;
        let decay = (1.0 - samples * self.config.damping).max(0.0);
        let state = &mut self.state;
        let speed = state.speed * decay + gained;
        state.angle += radians(0.5 * samples * (state.speed + speed));
        state.speed = speed;
        self.covariance.advance(samples, decay, self.config.acceleration);
        self.work_in(observation, ignore)
    }

    #[inline(always)]
    fn work_in(&mut self, observation: &Observation, ignore: [bool; 3]) -> Outcome {
        let turning = self.state.speed.abs() >= self.config.slowest;
        let learn = turning && self.fault.is_none();
        if learn {
            self.resume();
        } else {
            self.paused = self.paused.saturating_add(observation.elapsed.into());
        }
        let measurements =
            core::array::from_fn(|k| self.fixed[k].measure(k, &self.state, observation.codes[k], self.bend(k)));
        let update = self.covariance.update(&measurements, &Gate { squared: GATE, learn, ignore });
        self.state.correct(&update.correction);
        if update.refused != [false; 3] {
            self.refused(&update.refused, &ignore);
        }
        let turns = if turning { self.state.speed.abs() * f32::from(observation.elapsed) * (1.0 / TAU) } else { 0.0 };
        for k in 0..3 {
            let doubt = &mut self.doubts[k];
            if update.refused[k] {
                doubt.turns += turns;
                doubt.times += 1;
            } else if doubt.turns > 0.0 {
                doubt.turns -= FORGIVENESS * turns;
            } else {
                doubt.times = 0;
            }
        }
        if let Some(outcome) = self.judge() {
            return outcome;
        }
        if !learn {
            return Outcome::Following;
        }
        self.confine();
        self.learnt += 1;
        self.seen |= 1 << (self.state.angle.to_bits() as u32 >> 29);
        if self.seen == u8::MAX && self.learnt >= WHOLE { self.whole_turn() } else { Outcome::Learning }
    }

    /// What the derivatives at the predicted state leave out of a signal, as a variance: the sine's curvature over an
    /// uncertain angle, and the product of uncertain angle and amplitude. It is alike from sample to sample until
    /// the rotor has turned by a quarter of a radian, so all samples within together must not count for more than one.
    #[inline(always)]
    fn bend(&self, sensor: usize) -> f32 {
        const ALIKE: f32 = 0.25;
        let amplitude = OFFSET[sensor] + 1;
        let angle = self.covariance.get(ANGLE, ANGLE);
        let once = angle * (0.5 * angle + self.covariance.get(amplitude, amplitude));
        once * (1.0 + ALIKE / self.state.speed.abs().max(1e-3))
    }

    /// Makes up for the drift while nothing was learnt.
    #[inline(always)]
    fn resume(&mut self) {
        if self.paused >= self.config.pause {
            self.wander();
        }
        self.paused = 0;
    }

    /// The parameters may have drifted since the last time.
    #[cold]
    fn wander(&mut self) {
        let samples = core::mem::take(&mut self.since) as f32;
        for state in THIRD..STATES {
            self.covariance.widen(state, self.drift[state] * samples, self.start[state]);
        }
    }

    /// Some sensors were not believed. When it is more than one, the rotor is not where it was thought to be.
    #[cold]
    fn refused(&mut self, refused: &[bool; 3], ignore: &[bool; 3]) {
        let contradicting = (0..3).filter(|&k| refused[k] && !ignore[k]).count();
        if contradicting < 2 {
            return;
        }
        self.phase = Phase::Blind;
        self.doubts = [Doubt::default(); 3];
        self.jolts += 1;
        if self.jolts >= JOLTS {
            self.restart();
        }
    }

    /// Doubts all parameters as at the start.
    #[cold]
    fn restart(&mut self) {
        self.covariance = Covariance::diagonal(&self.start);
        self.phase = Phase::Blind;
        self.jolts = 0;
        self.restarts += 1;
        self.seen = 0;
        self.learnt = 0;
    }

    /// Whether there is a fault now.
    #[inline(always)]
    fn judge(&mut self) -> Option<Outcome> {
        if self.fault.is_some() {
            return None;
        }
        for (k, doubt) in self.doubts.iter().enumerate() {
            let channel = Channel(k as u8);
            if doubt.at_rail >= FEWEST {
                return Some(self.fail(Fault::AtRail(channel)));
            }
            if doubt.turns > DOUBT && doubt.times >= FEWEST {
                return Some(self.fail(Fault::Lost(channel)));
            }
        }
        if self.restarts > RESTARTS {
            return Some(self.fail(Fault::Contradiction));
        }
        None
    }

    #[cold]
    fn fail(&mut self, fault: Fault) -> Outcome {
        self.fault = Some(fault);
        Outcome::Failed(fault)
    }

    /// Keeps the parameters in the box.
    #[inline(always)]
    fn confine(&mut self) {
        let limits = &self.config.limits;
        let state = &mut self.state;
        state.third = state.third.clamp(-limits.third, limits.third);
        for k in 0..3 {
            state.offset[k] = state.offset[k].clamp(-limits.offset, limits.offset);
            state.amplitude[k] = state.amplitude[k].clamp(1.0 - limits.amplitude, 1.0 + limits.amplitude);
            let middle = self.fixed[k].sensor.placement;
            let limit = radians(limits.placement_deg).to_bits();
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
            return Some(Fault::Drifted(Channel(k as u8), parameter));
        }
        reached(state.third, limits.third).then_some(Fault::Distorted)
    }

    /// All of the turn has been seen.
    #[cold]
    fn whole_turn(&mut self) -> Outcome {
        self.seen = 0;
        self.learnt = 0;
        self.jolts = 0;
        self.restarts = 0;
        self.wander();
        let edge = self.at_edge();
        if let Some(fault) = edge.filter(|_| edge == self.edge) {
            return self.fail(fault);
        }
        self.edge = edge;
        let model = self.current();
        if edge.is_some() || estimate::validate(&model, self.config.adc_bits).is_err() {
            return Outcome::Learning;
        }
        self.model = model;
        Outcome::Learnt
    }

    /// The model at this moment.
    fn current(&self) -> Model {
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

    /// Standard deviation of the angle as the filter believes, radians.
    pub fn deviation(&self) -> f32 {
        libm::sqrtf(self.covariance.get(ANGLE, ANGLE).max(0.0))
    }

    /// Why nothing is learnt any more.
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }
}
