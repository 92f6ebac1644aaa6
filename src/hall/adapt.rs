//! Keeps the sensors true while the motor runs: an extended Kalman filter over angle, speed and the sensors'
//! parameters.
//!
//! Simpkins and Todorov, section III.C, with the errata: offset and amplitude (their α and β) are estimated, too, and
//! the joint covariance of angle and parameters is carried, for that is what tells a misplaced sensor from a turned
//! rotor. φ cannot be seen by the Halls and stays as aligned. Beyond the paper, the third harmonic of the magnet is a
//! state: left out, it would bend the other parameters. The motor's equation of motion, eq. (11), predicts the speed
//! from the torque.
//!
//! The filter runs in a task, at about 1 kHz, on samples that the control interrupt queues; some may be missing. What
//! it has learnt comes out as a [`Model`] ([`Adapter::model`]) from which the fast path's tables are made anew.
//!
//! An update works in one scalar: the mean of three successive samples of one sensor, and the next two updates those of
//! the others, so that every sample of every sensor is used once. That costs half of what three scalars a sample cost,
//! and angle and speed are known a sample later. The work at a turn's end is spread over two updates. On a Cortex-M4F
//! an update takes some 1050 instructions; the most that were counted, over gaps, outliers, pushes and a lost sensor,
//! are less than 2200. A sample with an outlier is looked at with all three sensors, which are then worked in as one
//! measurement of the angle. Without a lost sensor, its turns are left out.
//!
//! The field of the windings turns with the current, and along q it is a shift of the whole turn, 1.15° electrical for
//! 2 % of the magnet's field, which no Hall can tell from a turned rotor; nor is it learnt here. What differs from
//! sensor to sensor goes into their parameters.
//!
//! Of two sensors without a third, offsets, amplitudes, the angle between them and the third harmonic are seen as well: they
//! bend the ellipse that the two draw, whatever the rotor does. Neither is blamed for what does not fit, for no third one
//! tells which it is: nothing is learnt of it, and where it lasts the calibration is to be made anew. The sensor that is not
//! there has its turns left out.
//!
//! What keeps it safe:
//! - Parameters move only above [`Settings::slowest_hz`]; below, only angle and speed follow.
//! - A model comes out only when every eighth of the turn was covered since the last.
//! - Parameters are cut to [`Settings::limits`] around the calibration at every eighth of a turn, so no model is beyond
//!   them. A parameter at its limit for two models in a row is a [`Fault::Drifted`].
//! - What the rotor leaves unexplained at each sensor is learnt while it turns, and counts as noise. Where that is more
//!   than 1 % no model comes out. Where it stays so for some turns, its magnets are uneven; then nothing else is learnt
//!   and the calibration is used ([`Adapter::doubts`]), until a trial after some more turns.
//! - Inertia, friction and torque constant are known roughly: the part of an acceleration that is not known counts as
//!   noise, too.
//! - A measurement more than five standard deviations off is an outlier. Up to what uneven magnets can produce it
//!   counts little; beyond, it is not used, unless an unexpected torque explains all three sensors. A sensor that is
//!   such an outlier for 15 % of a turn, and differs from what the other two show without any prediction, is a
//!   [`Fault::Lost`]; angle and speed are tracked on by the other two. Where all three agree with each other, something
//!   turned the rotor: angle and speed are acquired anew, and that speaks against no parameter.
//! - The parameters' variances grow by [`Settings::drift`] only for the time between covered turns, and never beyond
//!   where they started. At rest nothing grows.
//!
//! An unknown load torque is estimated by integrating the corrections of the speed.

mod acquire;
mod agree;
mod deviations;
mod doubt;
mod fault;
mod filter;
mod isolate;
mod learn;
mod observe;
mod sample;
mod settings;
mod start;
mod suspicion;
mod window;

use crate::angle::ElectricalAngle;
use crate::hall::model::{Model, Sensor};
use crate::hall::{Channel, Codes};
use core::f32::consts::{PI, TAU};
pub use deviations::Deviations;
use doubt::Doubt;
pub use fault::{Fault, Parameter};
use filter::{ANGLE, Covariance, Measurement, OFFSET, SPEED, State, Vector, radians};
use observe::CalibratedSensor;
use sample::{GATE, Sample, combine};
pub use settings::{Config, OutOfRange, Settings, Spread};
use suspicion::Suspicions;
use window::Window;

/// Variance of an acceleration, over its square: inertia, torque and friction are known to a third, and wrong for some
/// ten samples in a row.
const UNKNOWN_SHARE: f32 = 1.0;
/// Most samples that may be missing in a row; after more, angle and speed are acquired anew.
const LONGEST_GAP: u16 = 20;
/// Square of the speed over its variance, above which the rotor surely turns and parameters are adapted.
const CERTAIN_SPEED: f32 = 9.0;
/// Variance of the angle, rad², below which innovations tell of the rotor's unevenness.
const CERTAIN_ANGLE: f32 = 2e-3;
/// Angle, rad, within which the linearisation errors of samples are correlated.
const CORRELATED_ANGLE: f32 = 0.25;
/// Largest angle between observations, rad, for which the derivatives are good.
const LARGEST_ANGLE_STEP: f32 = 1.5;
/// Fastest speed to learn at, rad a sample: five samples a turn.
const FASTEST_SPEED: f32 = TAU / 5.0;

/// A sample for the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Observation {
    /// ADC codes of the three Halls.
    pub codes: Codes,
    /// Sample periods since the last observation: one, or more where samples were lost.
    pub elapsed: u16,
    /// Torque in the direction of the Hall angle as far as it is known, N·m, mean since the last observation.
    pub torque_nm: f32,
}

/// What came of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Status {
    /// Angle and speed are being acquired.
    Acquiring,
    /// Angle and speed are tracked, parameters are not adapted: too slow, a sensor under suspicion, or a fault.
    Tracking,
    /// Angle and speed are tracked and parameters adapted.
    Adapting,
    /// All of the turn was covered: [`Adapter::model`] is new.
    ModelReady,
    /// A fault was found by this observation; [`Adapter::fault`] keeps it.
    Failed(Fault),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Nothing is known of the angle.
    Unknown,
    /// The angle is known, the speed is not.
    AngleKnown,
    Tracking,
}

/// The adaptation of one drive; at most 800 bytes.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Adapter {
    phase: Phase,
    /// Eighths of the turn covered since the last model, a bit each.
    seen_eighths: u8,
    /// Eighths of the turn followed since something was last not understood.
    followed_eighths: u8,
    /// Whether all of the turn was covered, and the next update makes the model.
    model_due: bool,
    /// Whether it started from a calibration, to which it may return.
    calibrated: bool,
    /// Samples adapted from since the last model, 255 at most.
    learnt_samples: u8,
    /// Whether the rotor is too uneven to learn parameters from.
    doubt: Doubt,
    /// Whether the fault has been reported.
    fault_reported: bool,
    /// The parameter at its limit at the last model.
    last_limit: Option<Fault>,
    fault: Option<Fault>,
    /// Sample periods since the drift was added to the variances.
    samples_since_drift: u32,
    /// Observations in a row without adaptation of the parameters.
    paused: u32,
    /// Natural frequency of the tracking, rad a sample.
    natural_frequency: f32,
    /// Variance of the angle, rad², below which corrections of the speed are integrated into `load`.
    settled_variance: f32,
    /// Gain of that integration, 1/sample.
    load_gain: f32,
    /// Acceleration by the estimated load torque, rad/sample².
    load: f32,
    state: State,
    window: Window,
    suspicions: Suspicions,
    config: Config,
    sensors: [CalibratedSensor; 3],
    covariance: Covariance,
    /// Variances of the parameters at the start.
    start: Vector,
    /// Variances that they gain in a sample.
    drift: Vector,
    model: Model,
}

impl Adapter {
    /// Update by a sample.
    pub fn update(&mut self, observation: &Observation) -> Status {
        let outcome = self.process(observation);
        match self.fault {
            Some(fault) if !self.fault_reported => {
                self.fault_reported = true;
                Status::Failed(fault)
            }
            _ => outcome,
        }
    }

    #[inline]
    fn process(&mut self, observation: &Observation) -> Status {
        self.samples_since_drift = self.samples_since_drift.saturating_add(u32::from(observation.elapsed));
        if self.needs_check(&observation.codes) || self.phase != Phase::Tracking || !self.is_near(observation.elapsed) {
            return self.update_all(observation);
        }
        let (sensor, mean) = self.window.push(&observation.codes, observation.elapsed);
        let lost = self.suspicions.is_lost(sensor);
        if lost | self.model_due {
            // For a model a sensor's turn is left out: once in a turn of the rotor that is nothing.
            self.predict(observation);
            return if lost { Status::Tracking } else { self.publish_model() };
        }
        let Some(mean) = mean else { return self.update_single(sensor, observation) };
        // The state is that of the sample before, the middle one of the three.
        let learn = self.may_learn();
        let nonlinearity = self.nonlinearity(sensor, learn, 3.0);
        let measurement = self.sensors[sensor].measure_mean(sensor, &self.state, mean, nonlinearity);
        let accepted = self.update_by(sensor, &measurement, learn, 3.0);
        self.predict(observation);
        if !accepted {
            return self.flag_outlier();
        }
        if learn { self.learn() } else { self.follow() }
    }

    /// Whether the derivatives are good over the angle that the rotor turned since the last observation.
    #[inline]
    fn is_near(&self, elapsed: u16) -> bool {
        elapsed <= LONGEST_GAP && self.state.speed.abs() * f32::from(elapsed) <= LARGEST_ANGLE_STEP
    }

    /// After a gap there is no mean of three samples: update by one sensor of one sample.
    #[cold]
    fn update_single(&mut self, sensor: usize, observation: &Observation) -> Status {
        self.predict(observation);
        let learn = self.may_learn();
        let nonlinearity = self.nonlinearity(sensor, learn, 1.0);
        let measurement = self.sensors[sensor].measure(sensor, &self.state, observation.codes[sensor], nonlinearity);
        if !self.update_by(sensor, &measurement, learn, 1.0) {
            return self.flag_outlier();
        }
        if learn { self.learn() } else { self.follow() }
    }

    /// Update by the three sensors of a sample with which something is wrong.
    #[cold]
    fn update_all(&mut self, observation: &Observation) -> Status {
        let Some(unusable) = self.unusable(&observation.codes) else { return Status::Acquiring };
        // A quarter of the longest gap is too long where something is wrong, too; that also bounds the work.
        let long = observation.elapsed > LONGEST_GAP / 4;
        let lost = observation.elapsed > 1 && (long || !self.is_near(observation.elapsed));
        if self.phase != Phase::Tracking || lost {
            // No other load comes in a few samples. A fast rotor, whose angle has to be acquired anew after each that
            // is missing, would never be taken for as fast as it is.
            self.load = if long { 0.0 } else { self.load };
            return self.acquire(observation, unusable);
        }
        self.predict(observation);
        self.window.clear();
        let mut sample = Sample::new(self.measure(&observation.codes, unusable), &self.covariance);
        self.isolate_outlier(observation, &mut sample)
    }

    /// Prediction of angle and speed by the equation of motion, Simpkins and Todorov, eq. (11).
    #[inline]
    fn predict(&mut self, observation: &Observation) {
        let state = &mut self.state;
        let disturbed = self.config.per_nm * observation.torque_nm + self.load;
        let (mut angle, mut gained) = (0.0, 0.0);
        for _ in 0..observation.elapsed {
            gained = disturbed - self.config.damping * state.speed;
            angle += state.speed + 0.5 * gained;
            state.speed += gained;
        }
        state.angle += radians(angle);
        let noise = self.config.acceleration + UNKNOWN_SHARE * gained * gained;
        self.covariance.advance(noise, f32::from(observation.elapsed));
    }

    /// The usable sensors of a sample against their prediction, without adaptation of parameters.
    fn measure(&self, codes: &Codes, unusable: [bool; 3]) -> [Measurement; 3] {
        core::array::from_fn(|k| match unusable[k] {
            true => Measurement::NONE,
            false => self.sensors[k].measure(k, &self.state, codes[k], self.nonlinearity(k, false, 1.0)),
        })
    }

    /// Variance of the linearisation error of a signal: the sine's curvature over an uncertain angle, and the product
    /// of uncertain angle and amplitude. For the parameters this error is correlated until the rotor has turned by a
    /// quarter of a radian, so all samples within that angle together must not weigh more than one.
    #[inline]
    fn nonlinearity(&self, sensor: usize, learn: bool, samples: f32) -> f32 {
        let amplitude = OFFSET[sensor] + 1;
        let angle = self.covariance.get(ANGLE, ANGLE);
        let times = if learn { 1.0 + CORRELATED_ANGLE / (samples * self.state.speed.abs()) } else { 1.0 };
        angle * (0.5 * angle + self.covariance.get(amplitude, amplitude)) * times
    }

    /// Whether it works without a sensor, which was lost or is not there.
    #[inline]
    const fn works_with_two(&self) -> bool {
        self.suspicions.lost.is_some()
    }

    /// Which sensors it works with.
    fn sensors_in_use(&self) -> impl Iterator<Item = usize> + use<> {
        let lost = self.suspicions.lost;
        (0..3).filter(move |&k| lost != Some(Channel(k as u8)))
    }

    /// The mean over these.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn mean(&self, of: fn(&CalibratedSensor) -> f32) -> f32 {
        let sum: f32 = self.sensors_in_use().map(|k| of(&self.sensors[k])).sum();
        sum * if self.works_with_two() { 1.0 / 2.0 } else { 1.0 / 3.0 }
    }

    /// Update by one sensor, unless it is an outlier; whether it was used. What the rotor leaves unexplained is alike
    /// over a pole, so the parameters learn of all samples there together no more than of one.
    #[inline]
    fn update_by(&mut self, sensor: usize, measurement: &Measurement, learn: bool, samples: f32) -> bool {
        let cross = measurement.cross(sensor, &self.covariance);
        if measurement.is_outlier(&cross, GATE) {
            return false;
        }
        let speed = self.state.speed;
        let angle = samples * speed.abs();
        let mut share = 0.0;
        if self.calibrated && self.covariance.get(ANGLE, ANGLE) < CERTAIN_ANGLE {
            let sensor = &mut self.sensors[sensor];
            sensor.learn_unexplained(measurement, cross.variance + measurement.noise, angle);
        }
        if learn {
            let once = angle * measurement.noise;
            share = once / (once + PI * self.sensors[sensor].excess());
        }
        self.covariance.update_by(measurement, &cross, &mut self.state, share);
        self.integrate_load(speed);
        true
    }

    /// Update of angle and speed by a sample of three sensors.
    fn track_all(&mut self, measurements: &[Measurement; 3]) {
        let (measurement, cross) = combine(measurements, &self.covariance);
        let speed = self.state.speed;
        self.covariance.update_by(&measurement, &cross, &mut self.state, 0.0);
        self.integrate_load(speed);
    }

    /// Integrates the correction of the speed into the load.
    #[inline]
    fn integrate_load(&mut self, speed: f32) {
        if self.covariance.get(ANGLE, ANGLE) < self.settled_variance {
            self.load += self.load_gain * (self.state.speed - speed);
        }
    }

    #[inline]
    fn may_learn(&self) -> bool {
        self.fault.is_none() && !self.doubt.exists && self.turns_well()
    }

    /// Whether the rotor surely turns, neither too slowly nor too fast to learn.
    #[cfg_attr(not(feature = "small"), inline)]
    #[cfg_attr(feature = "small", inline(never))]
    fn turns_well(&self) -> bool {
        let speed = self.state.speed.abs();
        let certain = speed * speed > CERTAIN_SPEED * self.covariance.get(SPEED, SPEED);
        speed >= self.config.slowest && !self.is_too_fast() && certain
    }

    /// Whether the rotor turns too fast for its sensors to be learnt, or its magnets to be judged: above a fifth of a turn
    /// from sample to sample. Angle and speed are followed.
    #[inline]
    pub fn is_too_fast(&self) -> bool {
        self.state.speed.abs() > FASTEST_SPEED
    }

    /// Whether the rotor leaves more unexplained than parameters can be learnt from: its magnets are uneven. Then
    /// those of the calibration are used, and only angle and speed are followed; after some turns it is tried again.
    pub const fn doubts(&self) -> bool {
        self.doubt.is_open()
    }

    /// What the rotor leaves unexplained at each sensor, share of the amplitude, RMS.
    pub fn unexplained(&self) -> [f32; 3] {
        self.sensors.map(|sensor| crate::float::root(sensor.unexplained))
    }

    /// The model at this moment, for diagnosis; [`Self::model`] is the one to use.
    pub fn current(&self) -> Model {
        let mut model = self.model;
        // One that is not there stays so.
        let present = |(_, sensor): &(usize, &mut Sensor)| sensor.amplitude != 0.0;
        for (k, sensor) in model.sensors.iter_mut().enumerate().filter(present) {
            let sensors = &self.sensors[k].sensor;
            sensor.offset = sensors.offset + self.state.offset[k] * sensors.amplitude;
            sensor.amplitude = sensors.amplitude * self.state.amplitude[k];
            sensor.placement = self.state.placement[k];
            sensor.third = sensors.third + self.state.third;
        }
        model
    }

    /// The model of the last covered turn; at first, the one it started from.
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

    /// How well the filter knows what it estimates.
    pub fn deviations(&self) -> Deviations {
        Deviations::of(&self.covariance)
    }

    /// Why parameters are not adapted any more.
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }
}

#[cfg(test)]
mod tests;
