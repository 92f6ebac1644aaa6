//! The adaptation at a drive: records in, new estimators out.

use super::{InstallError, Service};
use crate::config::Config;
use crate::control::config::Config as Control;
use crate::fault::Limits;
use crate::hall::Channel;
use crate::hall::adapt::{self, Adapter, Observation, Status};
use crate::hall::estimate::{self, BadModel};
use crate::hall::model::Model;
use crate::hall::pair::{Motion, Pair};
use crate::mode::Mode;
use crate::telemetry::{Measurement, Record};

/// What is to be sent to the drive next.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Due {
    Nothing,
    Learnt,
    Without(Channel),
}

/// Torque of the measured current along q, N·m, in the direction of the electrical angle: 1.5 · pole pairs · flux
/// linkage · i_q. The drive gives a [`Measurement`] with each record; for [`Adaptation::take`], with friction alone as
/// [`adapt::Settings::damping_nms`], for the current has the back-EMF in it. Within 3 % of the simulated motor's torque
/// on average.
pub fn torque_nm(measurement: &Measurement, control: &Control) -> f32 {
    let [_, amperes] = measurement.current_a(control);
    amperes * control.motor.torque_constant(control.scale.pole_pairs)
}

/// What looks at a drive's records of the Halls: it keeps them true, and sees whether two without a third fit each other.
#[derive(Clone, Debug)]
pub struct Watch {
    pair: Option<Pair>,
    adaptation: Option<Adaptation>,
}

impl Watch {
    /// Nothing looks.
    // A constant would lie in the flash with all its zeros: 700 bytes.
    #[inline(always)]
    pub const fn none() -> Self {
        Self { pair: None, adaptation: None }
    }

    /// Looks whether two Halls fit each other, or not; nothing is learnt.
    pub fn begin(&mut self, two_halls: bool) {
        self.pair = two_halls.then_some(Pair::NEW);
        self.adaptation = None;
    }

    /// [`Adaptation::resume`], written to its place, as it is large for a stack; nothing is left there after an error.
    ///
    /// # Errors
    /// As [`Adaptation::resume`].
    pub fn resume(
        &mut self,
        config: &adapt::Config,
        calibrated: &Model,
        model: &Model,
        every: u32,
    ) -> Result<(), BadModel> {
        self.adaptation = None;
        estimate::validate_without(calibrated, config.adc_bits, config.absent())?;
        self.place(config, calibrated, model, every);
        let result = self.adaptation().map_or(Ok(()), |adaptation| {
            adaptation.adapter.begin();
            adaptation.adapter.go_on_from(model)
        });
        if result.is_err() {
            self.adaptation = None;
        }
        result
    }

    fn place(&mut self, config: &adapt::Config, calibrated: &Model, model: &Model, every: u32) {
        self.adaptation = Some(Adaptation::of(Adapter::at(config, calibrated), model, every));
    }

    /// Whether a record of a running drive says that its two sensors do not fit each other, with the torque of
    /// [`torque_nm`]: what the task that asks answers by [`Service::trip`].
    pub fn contradicts(&mut self, record: &Record, model: &Model, torque_nm: f32, config: &Config) -> bool {
        let Some(pair) = &mut self.pair else { return false };
        if record.status.mode() != Mode::Running {
            *pair = Pair::NEW;
            return false;
        }
        let motion = |control| Motion::of(control, torque_nm, record.rotor.speed(), config.record_every());
        pair.take(model, &record.codes, record.rotor.angle())
            | config.control.as_ref().map(motion).is_some_and(|motion| pair.turns_against(motion))
    }

    /// The filter of what keeps the Halls true.
    pub fn adapter(&self) -> Option<&Adapter> {
        self.adaptation.as_ref().map(Adaptation::adapter)
    }

    /// What keeps the Halls true.
    pub const fn adaptation(&mut self) -> Option<&mut Adaptation> {
        self.adaptation.as_mut()
    }
}

/// Feeds an [`Adapter`] with a drive's records and sends the drive the models that it learns.
#[derive(Clone, Debug)]
pub struct Adaptation {
    adapter: Adapter,
    due: Due,
    /// Steps of the drive between two records.
    every: u32,
    last: Option<u32>,
    reversed: bool,
}

impl Adaptation {
    /// For the model that the drive works with, and records of every so many steps.
    ///
    /// # Errors
    /// [`BadModel`], as [`Adapter::new`].
    pub fn new(config: &adapt::Config, model: &Model, every: u32) -> Result<Self, BadModel> {
        Self::resume(config, model, model, every)
    }

    /// The same for a model that was learnt since a calibration: [`Adapter::resume`].
    ///
    /// # Errors
    /// [`BadModel`], as [`Adapter::new`], of either.
    pub fn resume(config: &adapt::Config, calibrated: &Model, model: &Model, every: u32) -> Result<Self, BadModel> {
        Ok(Self::of(Adapter::resume(config, calibrated, model)?, model, every))
    }

    const fn of(adapter: Adapter, model: &Model, every: u32) -> Self {
        let every = if every > 0 { every } else { 1 };
        Self { adapter, due: Due::Nothing, every, last: None, reversed: model.reversed }
    }

    /// Learns from a record of a drive that is ready or running, with the torque as far as it is known, in the
    /// direction of the electrical angle: [`torque_nm`], or 0 where no current is measured. Records may be missing.
    pub fn take(&mut self, record: &Record, torque_nm: f32) -> Status {
        if matches!(record.status.mode(), Mode::Aligning | Mode::Calibrating) {
            // What is due belongs to the calibration that this one replaces.
            self.due = Due::Nothing;
        }
        if !matches!(record.status.mode(), Mode::Ready | Mode::Running) {
            return Status::Tracking;
        }
        if record.status.limits().contains(Limits::CHECKING) {
            // The torque of the check is not measured: the rotor's motion would be taken for unevenness.
            return Status::Tracking;
        }
        // A record out of turn, as after a command, counts for the time that it is early or late by.
        let steps = record.sequence.wrapping_sub(self.last.unwrap_or(record.sequence));
        let samples = (steps + self.every / 2) / self.every;
        if samples == 0 && self.last.is_some() {
            return Status::Tracking;
        }
        self.last = Some(record.sequence);
        let outcome = self.adapter.update(&Observation {
            codes: record.codes,
            elapsed: samples.min(u16::MAX.into()) as u16,
            torque_nm: if self.reversed { -torque_nm } else { torque_nm },
        });
        match (outcome, self.adapter.fault().and_then(adapt::Fault::lost)) {
            (Status::Failed(_), Some(lost)) => self.due = Due::Without(lost),
            (Status::ModelReady, _) if self.due == Due::Nothing => self.due = Due::Learnt,
            _ => {}
        }
        outcome
    }

    /// Sends the drive the model that is due; to be called after [`Self::take`], when there is time to make an
    /// estimator. True when one was sent.
    ///
    /// # Errors
    /// [`InstallError`]; when it is `Busy`, the next call tries again.
    pub fn publish(&mut self, service: &mut Service) -> Result<bool, InstallError> {
        let result = match self.due {
            Due::Nothing => return Ok(false),
            Due::Learnt => service.install(self.adapter.model()),
            Due::Without(lost) => service.install_without(lost, self.adapter.model()),
        };
        if result != Err(InstallError::Busy) {
            self.due = Due::Nothing;
        }
        result.map(|()| true)
    }

    /// As [`Adapter::expect_unexplained`].
    pub fn expect_unexplained(&mut self, rms: [f32; 3]) {
        self.adapter.expect_unexplained(rms);
    }

    /// The filter.
    pub const fn adapter(&self) -> &Adapter {
        &self.adapter
    }
}
