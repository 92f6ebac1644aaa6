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
//! An update works in one scalar: the mean of three successive samples of one sensor, and the next two updates those of the
//! others, so that every sample of every sensor is used once. That costs half of what three scalars a sample cost, and angle
//! and speed are known a sample later. The work at a turn's end is spread over two updates. On a Cortex-M4F an
//! update takes some 900 instructions; the most that were counted, over gaps, outliers, pushes and a lost sensor, are less
//! than 1500. A sample with an outlier is looked at with all three sensors, which are then worked in as one measurement of
//! the angle. Without a lost sensor, its turns are left out.
//!
//! The field of the windings turns with the current, and along q it is a shift of the whole turn, 1.15° electrical for 2 % of
//! the magnet's field, which no Hall can tell from a turned rotor; nor is it learnt here. What differs from sensor to sensor
//! goes into their parameters.
//!
//! What keeps it safe:
//! - Parameters move only above [`Settings::slowest_hz`]; below, only angle and speed follow.
//! - A model comes out only when all of the turn has been seen since the last.
//! - Parameters are brought back into a box around the calibration at every eighth of a turn, and no model leaves it. One found at the edge of
//!   the box twice is a [`Fault::Drifted`].
//! - A measurement more than five standard deviations off is not believed, unless all three together say that the rotor
//!   has been pushed. A sensor that is not believed for a fifth of a turn is a [`Fault::Lost`]; angle and speed go on from
//!   the other two.
//! - Parameters' uncertainty grows by their drift only for the time between turns that were seen whole, and never beyond
//!   where it started. At rest nothing grows.
//!
//! A load that is not told is found by integrating what the speed is corrected by.

mod acquire;
mod deviations;
mod doubt;
mod fault;
mod filter;
mod learn;
mod observe;
mod settings;
mod window;

use crate::angle::ElectricalAngle;
use crate::hall::Codes;
use crate::hall::estimate::{self, BadModel};
use crate::hall::model::Model;
use core::f32::consts::TAU;
pub use deviations::Deviations;
use doubt::{Doubts, Sample, condense};
pub use fault::{Fault, Parameter};
use filter::{ANGLE, Covariance, Measurement, OFFSET, SPEED, STATES, State, THIRD, Vector, radians};
use observe::Fixed;
pub use settings::{Config, OutOfRange, Settings, Spread};
use window::Window;

/// Squared number of standard deviations beyond which a measurement is an outlier.
const GATE: f32 = 25.0;
/// Most samples that may be missing in a row for the speed to be believed.
const LONGEST_GAP: u16 = 20;
/// Squared number of deviations by which the rotor must turn to be learnt from.
const CERTAIN: f32 = 9.0;
/// Radians within which samples are alike to the parameters.
const ALIKE: f32 = 0.25;
/// Radians between observations for which the derivatives are good.
const FARTHEST: f32 = 1.5;
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
    window: Window,
    /// Eighths of the turn seen since the last model, and samples learnt from and passed since then.
    seen: u8,
    learnt: u32,
    since: u32,
    paused: u32,
    /// Whether all of a turn has been seen, and the model is still to be made.
    turned: bool,
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
            window: Window::default(),
            seen: 0,
            learnt: 0,
            since: 0,
            paused: 0,
            turned: false,
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
        self.since = self.since.saturating_add(u32::from(observation.elapsed));
        if self.is_doubtful(&observation.codes) || self.phase != Phase::Tracking || !self.is_near(observation.elapsed) {
            return self.work_in_alone(observation);
        }
        let (sensor, mean) = self.window.push(&observation.codes, observation.elapsed);
        if self.doubts.is_lost(sensor) {
            self.predict(observation);
            return self.follow();
        }
        if self.turned {
            // A sensor's turn is left out: once in a turn of the rotor that is nothing.
            self.predict(observation);
            return self.whole_turn();
        }
        let Some(mean) = mean else { return self.work_in_one(sensor, observation) };
        // The state is that of the sample before, the middle one of the three.
        let learn = self.may_learn();
        let bend = self.bend(sensor, learn, 3.0);
        let measurement = self.fixed[sensor].measure_mean(sensor, &self.state, mean, bend);
        let believed = self.work_in(sensor, &measurement, learn);
        self.predict(observation);
        if !believed {
            return self.doubt();
        }
        if learn { self.learn() } else { self.follow() }
    }

    /// Whether the derivatives are good from the last observation to this one, or for a window of three.
    #[inline(always)]
    fn is_near(&self, elapsed: u16) -> bool {
        elapsed <= LONGEST_GAP && self.state.speed.abs() * f32::from(elapsed) <= FARTHEST
    }

    /// After a gap there is no mean: one sensor of one sample.
    #[cold]
    fn work_in_one(&mut self, sensor: usize, observation: &Observation) -> Outcome {
        self.predict(observation);
        let learn = self.may_learn();
        let bend = self.bend(sensor, learn, 1.0);
        let measurement = self.fixed[sensor].measure(sensor, &self.state, observation.codes[sensor], bend);
        if !self.work_in(sensor, &measurement, learn) {
            return self.doubt();
        }
        if learn { self.learn() } else { self.follow() }
    }

    /// Works in a sample with which something is wrong: its three sensors, and no other sample.
    #[cold]
    fn work_in_alone(&mut self, observation: &Observation) -> Outcome {
        let Some(useless) = self.useless(&observation.codes) else { return Outcome::Acquiring };
        // A quarter of the longest gap is too long where something is wrong, too; that also bounds the work.
        let long = observation.elapsed > LONGEST_GAP / 4;
        let lost = observation.elapsed > 1 && (long || !self.is_near(observation.elapsed));
        if self.phase != Phase::Tracking || lost {
            self.load = if lost { 0.0 } else { self.load };
            return self.acquire(observation, useless);
        }
        self.predict(observation);
        self.window.clear();
        let mut sample = Sample::new(self.measure(&observation.codes, useless), &self.covariance);
        self.reconcile(f32::from(observation.elapsed), &mut sample)
    }

    /// Angle and speed at an observation, as the equation of motion has them.
    #[inline(always)]
    fn predict(&mut self, observation: &Observation) {
        let state = &mut self.state;
        let pushed = self.config.per_nm * observation.torque_nm + self.load;
        let mut turned = 0.0;
        for _ in 0..observation.elapsed {
            let gained = pushed - self.config.damping * state.speed;
            turned += state.speed + 0.5 * gained;
            state.speed += gained;
        }
        state.angle += radians(turned);
        self.covariance.advance(self.config.acceleration, f32::from(observation.elapsed));
    }

    /// The sensors of a sample against their prediction, but for the useless ones, to follow.
    fn measure(&self, codes: &Codes, useless: [bool; 3]) -> [Measurement; 3] {
        [0, 1, 2].map(|k| match useless[k] {
            true => Measurement::NONE,
            false => self.fixed[k].measure(k, &self.state, codes[k], self.bend(k, false, 1.0)),
        })
    }

    /// What the derivatives at the predicted state leave out of a signal, as a variance: the sine's curvature over an
    /// uncertain angle, and the product of uncertain angle and amplitude. To the parameters it is alike from sample to sample
    /// until the rotor has turned by a quarter of a radian, so all samples within together must not count for more than one.
    #[inline(always)]
    fn bend(&self, sensor: usize, learn: bool, samples: f32) -> f32 {
        let amplitude = OFFSET[sensor] + 1;
        let angle = self.covariance.get(ANGLE, ANGLE);
        let times = if learn { 1.0 + ALIKE / (samples * self.state.speed.abs()) } else { 1.0 };
        angle * (0.5 * angle + self.covariance.get(amplitude, amplitude)) * times
    }

    /// Corrects by a sensor, unless that is an outlier.
    #[inline(always)]
    fn work_in(&mut self, sensor: usize, measurement: &Measurement, learn: bool) -> bool {
        let relation = measurement.relation(sensor, &self.covariance);
        if measurement.is_outlier(&relation, GATE) {
            return false;
        }
        let speed = self.state.speed;
        self.covariance.work_in(measurement, &relation, &mut self.state, learn);
        self.find_load(speed);
        true
    }

    /// Angle and speed by a sample of three sensors.
    fn follow_all(&mut self, measurements: &[Measurement; 3]) {
        let (measurement, relation) = condense(measurements, &self.covariance);
        let speed = self.state.speed;
        self.covariance.work_in(&measurement, &relation, &mut self.state, false);
        self.find_load(speed);
    }

    /// What corrects the speed again and again is a load.
    #[inline(always)]
    fn find_load(&mut self, speed: f32) {
        if self.covariance.get(ANGLE, ANGLE) < self.settled {
            self.load += self.load_gain * (self.state.speed - speed);
        }
    }

    #[inline(always)]
    fn may_learn(&self) -> bool {
        let speed = self.state.speed.abs();
        let certain = speed * speed > CERTAIN * self.covariance.get(SPEED, SPEED);
        self.fault.is_none() && speed >= self.config.slowest && speed <= FASTEST && certain
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

#[cfg(test)]
mod tests;
