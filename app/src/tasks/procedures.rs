//! The calibration and the procedures that turn the rotor.

use super::rest::Rest;
use super::{SETTLED, Tasks};
use crate::encoder::Encoder;
use crate::measure;
use crate::procedure::Completion;
#[cfg(feature = "map")]
use crate::procedure::Procedure;
use embedded_storage::nor_flash::NorFlash;
use hallservo::drive;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo::service::procedure::Error;
use hallservo_protocol::{self as protocol, Activity, Calibration, Cause, Record, Refusal};

/// How long a tool may be silent where the settings do not say, as there is no current control, s.
const TIMEOUT_S: f32 = 1.0;
/// The least of either: a tool's requests pass two operating systems.
const LEAST_MS: u32 = 100;

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Whether a procedure may begin: with the drive ready.
    pub fn may_turn(&self) -> Result<(), Refusal<'static>> {
        match self.mode() {
            Mode::Ready => Ok(()),
            Mode::Unarmed => Err(Refusal::Drive(drive::Refusal::NotCalibrated)),
            mode => Err(Refusal::Drive(drive::Refusal::Mode(mode))),
        }
    }

    /// Ends a procedure, and the wait for the rotor after one. The bridge is to be switched off, too.
    pub fn cancel(&mut self) {
        self.rest = None;
        if let Some(procedure) = self.procedure {
            procedure.cancel();
        }
        self.encoder.cancel();
    }

    /// Ends what turns the motor, the bridge off at once, when the tool that began it has fallen silent.
    pub(super) fn end_abandoned(&mut self) {
        let timeout_s = self.settings.control.as_ref().map_or(TIMEOUT_S, |control| control.guard.command_timeout_s);
        let timeout_ms = ((1000.0 * timeout_s) as u32).max(LEAST_MS);
        let is_abandoned = self.controller.is_abandoned(self.now_ms, timeout_ms);
        self.controller.watch(self.mode().drives(), self.limits().contains(Limits::TIMEOUT));
        if !is_abandoned {
            return;
        }
        let calibrates = matches!(self.mode(), Mode::Aligning | Mode::Calibrating);
        if calibrates || self.procedure.is_some() || self.encoder.activity().0 != Activity::None {
            self.note(Cause::Abandoned(self.activity()));
            self.cancel();
            if self.disarm().is_ok() {
                self.abandon_reply();
            }
        }
    }

    #[inline(never)]
    pub(super) fn proceed(&mut self) {
        let Some(procedure) = self.procedure else { return };
        let rest = Rest::after(procedure.activity(), self.now_ms);
        let Some(outcome) = procedure.step(self.service, self.now_ms as u32) else { return };
        // After a cancelled procedure nothing waits for the rotor.
        if !matches!(outcome, Completion::Failed(_, Error::Cancelled | Error::Disarmed)) {
            self.rest = Some(rest);
        }
        match outcome {
            Completion::Swings(found) => self.swings = protocol::Procedure::Done(*found),
            Completion::Failed(Activity::Swings, error) => self.swings = protocol::Procedure::Failed(error),
            #[cfg(feature = "map")]
            Completion::Magnets(mapping) => {
                if let Some(sensors) = &self.sensors {
                    self.magnets.learnt(mapping, sensors, self.service.config());
                }
                self.relearn();
            }
            #[cfg(feature = "map")]
            Completion::Failed(Activity::Magnets, error) => self.magnets.failed(error),
            Completion::Motor(report) => {
                self.identification = protocol::Procedure::Done(*report);
                let mut settings = self.settings;
                if let Some(control) = &mut settings.control {
                    report.apply(control);
                }
                // A motor beyond the ranges of the settings is reported all the same.
                if self.configure(&settings).is_ok() {
                    self.abandon_reply();
                }
            }
            Completion::Cogging(table) => {
                #[cfg(feature = "map")]
                if E::SETTINGS == 0 {
                    self.magnets.learnt_by_pole(&self.settings);
                }
                let full_scale_a = self.settings.full_scale_a();
                let by_pole_a = self.magnets.by_pole_a(full_scale_a);
                self.cogging = protocol::Procedure::Done(measure::cogging(table, full_scale_a, by_pole_a));
                self.table = Some(*table);
                // The drive uses it already, whether the settings want it or not.
                self.table_due = true;
                self.unsaved[Record::Cogging as usize] = true;
            }
            Completion::Failed(Activity::Identification, error) => {
                self.identification = protocol::Procedure::Failed(error);
            }
            Completion::Failed(_, error) => {
                self.cogging = protocol::Procedure::Failed(error);
                // The drive may use a table of an earlier pass.
                self.table_due = true;
            }
        }
        *self.procedure = None;
    }

    /// Whether the map of the magnets is being learnt.
    pub fn is_mapping(&self) -> bool {
        #[cfg(feature = "map")]
        return matches!(&*self.procedure, Some(Procedure::Magnets(_)));
        #[cfg(not(feature = "map"))]
        false
    }

    /// Notes that a command or a fault has ended the calibration, which leaves the one before.
    pub(super) fn end_calibration(&mut self) {
        let turns = matches!(self.mode(), Mode::Aligning | Mode::Calibrating);
        if self.calibration == Calibration::Running && !turns && self.ticks_since_command > SETTLED {
            self.calibration = Calibration::Ended;
            self.service.give_up_calibration();
            self.sensors_due = true;
        }
        if core::mem::take(&mut self.sensors_due) {
            self.take_up_sensors();
        }
    }

    /// The procedure that runs, or what else keeps the drive busy.
    #[inline(never)]
    pub fn activity(&self) -> Activity {
        match (&*self.procedure, &self.rest) {
            (Some(procedure), _) => procedure.activity(),
            (None, Some(rest)) => rest.after,
            _ if matches!(self.calibration, Calibration::Running) => Activity::Calibration,
            // The drive takes up the identified parameters.
            _ if self.unclaimed_replies > 0 && self.sent_settings.is_some() => Activity::Identification,
            _ => self.encoder.activity().0,
        }
    }
}
