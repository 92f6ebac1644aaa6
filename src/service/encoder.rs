//! Calibration of a vernier encoder as a procedure: the motor turns the shaft at a steady speed, or a hand does.
//!
//! The rings are calibrated and checked ([`Calibrator`]), then a last turn tells how the encoder sits on the rotor's
//! shaft ([`TurnFit`]). The procedure is stepped like any other, and is given every sample of the encoder besides.

use super::procedure::{self, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::angle::{MechanicalAngle, PolePairs};
use crate::config::Config;
use crate::control::Speed;
use crate::drive::absolute::SampleOf;
use crate::telemetry::Measurement;
use crate::vernier::calibrate::{self, Calibrator, Report};
use crate::vernier::encoder::{Calibration, Encoder};
use crate::vernier::fit::{Fitted, TurnFit, Unlike};
use crate::vernier::rings::{Ring, Rings};
use core::f32::consts::TAU;
use core::fmt;

/// Why there is no calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// The shaft could not be turned.
    Procedure(procedure::Error),
    /// The rings cannot be calibrated so.
    Rings(calibrate::Error),
    /// Halls and encoder do not turn alike.
    Mounting(Unlike),
    /// Samples of the encoder did not reach the tasks.
    SamplesLost,
    /// Nobody has turned the shaft, or not far enough.
    NotTurned,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Procedure(error) => error.fmt(f),
            Self::Rings(error) => error.fmt(f),
            Self::Mounting(error) => error.fmt(f),
            Self::SamplesLost => f.write_str("samples of the encoder were lost on their way to the tasks"),
            Self::NotTurned => f.write_str("the shaft was not turned far enough"),
        }
    }
}

impl core::error::Error for Error {}

/// What a calibration finds.
#[derive(Clone, Debug)]
pub struct Outcome<const HEADS: usize> {
    /// Of the rings.
    pub calibration: Calibration<HEADS>,
    /// What that is worth.
    pub report: Report,
    /// How the encoder sits on the rotor's shaft, for a drive that counts as this one does; `None` without Halls.
    pub fitted: Option<Fitted>,
}

/// Samples of the encoder to a pole pair of the finer ring.
const SAMPLES_A_PAIR: f32 = 110.0;
/// Time for the speed to settle, ms.
const SETTLING_MS: u32 = 700;
/// Longest time that the motor may take, as a multiple of what it needs, and beside that, ms.
const LONGEST: f32 = 2.0;
const MARGIN_MS: f32 = 3000.0;
/// Longest time for a hand, ms.
const BY_HAND_MS: u32 = 120_000;
/// Pole pairs of the reference ring that a hand has to turn the shaft by before it counts.
const BEGINS: u32 = 4;
/// Turns of the largest calibration, the one for the mounting included.
const fn turns(heads: usize) -> f32 {
    2.0 * heads as f32 + 3.0
}

/// What is being found.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to put the larger one on")]
enum Stage<const HEADS: usize> {
    /// Waits for a hand: the reading at first.
    Waiting(Option<(u16, u32)>),
    Rings(Calibrator<HEADS>),
    Mounting(Encoder<HEADS>, TurnFit),
    Over,
}

/// The procedure; 4.9 KiB.
#[derive(Clone, Debug)]
pub struct EncoderCalibration<const HEADS: usize> {
    /// `None`: by hand.
    sequence: Option<Sequence>,
    speed: Speed,
    rings: Rings,
    pole_pairs: PolePairs,
    /// Whether the Halls know the electrical angle.
    has_halls: bool,
    previous: Calibration<HEADS>,
    stage: Stage<HEADS>,
    number: Option<u32>,
    began_ms: Option<u32>,
    now_ms: u32,
    timeout_ms: u32,
    /// Whether the motor turns steadily.
    steady: bool,
    failure: Option<Error>,
    attempt: Option<Error>,
    outcome: Option<Outcome<HEADS>>,
}

impl<const HEADS: usize> EncoderCalibration<HEADS> {
    /// By the motor, from a drive that is ready. `previous` keeps the zero: the calibration before this one. Samples come
    /// `sample_hz` times a second.
    ///
    /// # Errors
    /// There is no current control, or the speed is not allowed.
    pub fn by_motor(
        config: &Config,
        rings: &Rings,
        previous: &Calibration<HEADS>,
        sample_hz: f32,
    ) -> Result<Self, Error> {
        let control = Sequence::possible(config).map_err(Error::Procedure)?;
        let sequence = Sequence::new(config, control, config.commutation);
        let finest = rings.pole_pairs(Ring::Reference).max(rings.pole_pairs(Ring::Vernier));
        let fastest = control.trajectory.speed() as f32 / control.scale.per_radian_s();
        let speed_rad_s = (TAU * sample_hz / (SAMPLES_A_PAIR * f32::from(finest))).min(fastest);
        let demand = control.speed(speed_rad_s).map_err(|bad| Error::Procedure(procedure::Error::Demand(bad)))?;
        let timeout_ms = (LONGEST * 1000.0 * turns(HEADS) * TAU / speed_rad_s + MARGIN_MS) as u32;
        let begin = Stage::Rings(Calibrator::new(rings, previous));
        Ok(Self::new(config, rings, previous, begin, Some((sequence, demand)), true, timeout_ms))
    }

    /// By hand: a few turns, about as fast as the hand of a clock that does one in two seconds, and steadily. An attempt
    /// that is not fit is followed by another until the time is over.
    pub fn by_hand(config: &Config, rings: &Rings, previous: &Calibration<HEADS>, has_halls: bool) -> Self {
        Self::new(config, rings, previous, Stage::Waiting(None), None, has_halls, BY_HAND_MS)
    }

    fn new(
        config: &Config,
        rings: &Rings,
        previous: &Calibration<HEADS>,
        stage: Stage<HEADS>,
        motor: Option<(Sequence, Speed)>,
        has_halls: bool,
        timeout_ms: u32,
    ) -> Self {
        let (sequence, speed) = motor.map_or((None, Speed(0)), |(sequence, speed)| (Some(sequence), speed));
        Self {
            sequence,
            speed,
            rings: *rings,
            pole_pairs: config.pole_pairs,
            has_halls,
            previous: previous.clone(),
            stage,
            number: None,
            began_ms: None,
            now_ms: 0,
            timeout_ms,
            steady: false,
            failure: None,
            attempt: None,
            outcome: None,
        }
    }

    /// Takes a sample, all of them in their order.
    pub fn sample(&mut self, sample: &SampleOf<Encoder<HEADS>>) {
        let follows = self.number.replace(sample.number).is_none_or(|last| sample.number == last.wrapping_add(1));
        let counts = self.failure.is_none() && (self.sequence.is_none() || self.steady);
        if !counts || matches!(self.stage, Stage::Over) {
            return;
        }
        let result = if follows { self.push(sample) } else { Err(Error::SamplesLost) };
        if let Err(error) = result {
            self.fail(error);
        }
    }

    fn push(&mut self, sample: &SampleOf<Encoder<HEADS>>) -> Result<(), Error> {
        match &mut self.stage {
            Stage::Waiting(begin) => {
                let reading = sample.reading.reference[0];
                let (last, way) = begin.get_or_insert((reading, 0));
                // To and fro counts as well: it is enough that the shaft moves.
                *way += u32::from((reading.wrapping_sub(*last) as i16).unsigned_abs());
                *last = reading;
                if *way > BEGINS << 16 {
                    self.stage = Stage::Rings(Calibrator::new(&self.rings, &self.previous));
                }
            }
            Stage::Rings(calibrator) => {
                if calibrator.push(sample.reading).map_err(Error::Rings)? {
                    self.take_rings()?;
                }
            }
            Stage::Mounting(encoder, fit) => {
                if fit.push(encoder.decode(sample.reading).angle, sample.halls) {
                    let fitted = fit.finish(self.pole_pairs).map_err(Error::Mounting)?;
                    if let Some(outcome) = &mut self.outcome {
                        outcome.fitted = Some(fitted);
                    }
                    self.stage = Stage::Over;
                }
            }
            Stage::Over => {}
        }
        Ok(())
    }

    /// The rings are calibrated.
    #[inline(never)]
    fn take_rings(&mut self) -> Result<(), Error> {
        let Stage::Rings(calibrator) = core::mem::replace(&mut self.stage, Stage::Over) else { return Ok(()) };
        let (calibration, report) = calibrator.finish().map_err(Error::Rings)?;
        if self.has_halls {
            // Nothing is compared from sample to sample, so any step will do.
            let encoder = Encoder::new(&self.rings, &calibration, MechanicalAngle::from_bits(1))
                .map_err(|_| Error::Procedure(procedure::Error::Inconclusive))?;
            self.stage = Stage::Mounting(encoder, TurnFit::default());
        }
        self.outcome = Some(Outcome { calibration, report, fitted: None });
        Ok(())
    }

    fn fail(&mut self, error: Error) {
        match &mut self.sequence {
            Some(sequence) => {
                self.failure = Some(error);
                sequence.cancel(procedure::Error::Inconclusive);
            }
            // By hand there is another attempt.
            None => {
                self.attempt = Some(error);
                self.outcome = None;
                self.stage = Stage::Waiting(None);
            }
        }
    }

    /// Why the last attempt of a hand was not fit, if there was one.
    pub const fn attempt(&self) -> Option<&Error> {
        self.attempt.as_ref()
    }

    /// What was found, from the end on.
    pub const fn outcome(&self) -> Option<&Outcome<HEADS>> {
        self.outcome.as_ref()
    }

    /// Why there is nothing, from the end on.
    pub fn error(&self, state: State) -> Option<Error> {
        match (state, self.failure) {
            (_, Some(error)) => Some(error),
            (State::Failed(error), None) => Some(Error::Procedure(error)),
            _ => None,
        }
    }
}

impl<const HEADS: usize> Procedure for EncoderCalibration<HEADS> {
    fn event(&mut self, event: &Event) {
        if let Some(sequence) = &mut self.sequence {
            sequence.event(event);
        }
    }

    fn measurement(&mut self, _: &Measurement) {}

    fn step(&mut self, service: &mut Service, now_ms: u32) -> State {
        self.now_ms = now_ms;
        let over = matches!(self.stage, Stage::Over);
        let Some(sequence) = &mut self.sequence else {
            let late = now_ms.wrapping_sub(*self.began_ms.get_or_insert(now_ms)) > self.timeout_ms;
            return match (self.failure, over && self.outcome.is_some(), late) {
                (Some(_), ..) => State::Failed(procedure::Error::Cancelled),
                (None, true, _) => State::Done,
                (None, false, true) => {
                    self.failure = Some(self.attempt.unwrap_or(Error::NotTurned));
                    State::Failed(procedure::Error::NotReached)
                }
                (None, false, false) => State::Running,
            };
        };
        if sequence.step(service, now_ms) {
            sequence.follow(Demand::Speed(self.speed));
            let elapsed_ms = now_ms.wrapping_sub(*self.began_ms.get_or_insert(now_ms));
            self.steady = elapsed_ms > SETTLING_MS;
            if over {
                sequence.finish();
            } else if elapsed_ms > self.timeout_ms {
                sequence.cancel(procedure::Error::NotReached);
            }
        } else {
            self.steady = false;
        }
        sequence.state()
    }

    fn cancel(&mut self) {
        match &mut self.sequence {
            Some(sequence) => sequence.cancel(procedure::Error::Cancelled),
            None => self.failure = Some(Error::Procedure(procedure::Error::Cancelled)),
        }
    }

    fn progress(&self) -> f32 {
        let done = match &self.stage {
            Stage::Waiting(_) => 0.0,
            Stage::Rings(calibrator) => f32::from(calibrator.turns().0),
            Stage::Mounting(_, fit) => turns(HEADS) - 1.0 + fit.progress(),
            Stage::Over => turns(HEADS),
        };
        done / turns(HEADS)
    }
}
