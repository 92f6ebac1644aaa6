//! Commands and settings on their way to the drive, and its answers.

use super::Tasks;
use crate::encoder::Encoder;
use embedded_storage::nor_flash::NorFlash;
use hallservo::control::impedance::{self, Motion};
use hallservo::drive::{Command, Reply};
use hallservo::settings::Settings;
use hallservo_protocol::Refusal;

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Sends a command to the drive; [`Self::take_reply`] has the answer.
    pub fn send(&mut self, command: Command) -> Result<(), Refusal<'static>> {
        self.ready_for_command()?;
        self.follows_impedance = false;
        self.service.send(command).map_err(|_| Refusal::NoAnswer)
    }

    /// Sends the drive a spring and a damper, whose positions count from the user's zero; [`Self::take_reply`] has the
    /// answer.
    #[inline(never)]
    pub fn impedance(&mut self, request: &impedance::Request) -> Result<(), Refusal<'static>> {
        let places = match request.motion {
            Motion::To { position_turns, stop_turns, .. } => position_turns.is_some() || stop_turns.is_some(),
            Motion::Within { .. } => true,
        };
        self.encoder.may_move(places, &self.settings)?;
        let mut impedance = self.service.config().impedance(request).map_err(Refusal::Impedance)?;
        impedance.shift(self.encoder.origin());
        self.ready_for_command()?;
        self.service.follow_impedance(&impedance).map_err(|_| Refusal::NoAnswer)?;
        self.follows_impedance = true;
        Ok(())
    }

    /// Where the reference of the spring and the damper is, while one is followed.
    pub fn reference(&self) -> Option<impedance::State> {
        let control = self.service.config().control.as_ref().filter(|_| self.follows_impedance)?;
        let state = self.service.reference().state(self.measurement.as_ref()?, control, self.encoder.origin());
        Some(state)
    }

    /// Sends the drive the command to disarm, whatever it still owes an answer to: behind what is queued already, so
    /// that nothing else is the last word. One that finds the queue full follows at a later tick.
    pub fn disarm(&mut self) -> Result<(), Refusal<'static>> {
        self.reply = None;
        self.ticks_since_command = 0;
        self.disarm_due = self.service.send(Command::Disarm).is_err();
        if self.disarm_due { Err(Refusal::NoAnswer) } else { Ok(()) }
    }

    /// Sends other settings to the drive; [`Self::take_reply`] has the answer.
    pub fn configure(&mut self, settings: &Settings) -> Result<(), Refusal<'static>> {
        self.send_settings(settings, false)
    }

    /// The same with other values of tunable ones.
    pub fn retune(&mut self, settings: &Settings) -> Result<(), Refusal<'static>> {
        self.send_settings(settings, true)
    }

    // One copy, as a firmware has little flash.
    #[inline(never)]
    fn send_settings(&mut self, settings: &Settings, retunes: bool) -> Result<(), Refusal<'static>> {
        // Without memory for them, too, a setting that cannot be is the better refusal.
        match &mut self.spare_config {
            Some(config) => settings.validate_into(config),
            None => settings.verify(),
        }
        .map_err(Refusal::Setting)?;
        self.ready_for_command()?;
        let config = self.spare_config.take().ok_or(Refusal::NoAnswer)?;
        if !retunes {
            self.encoder.place(config, settings);
        }
        match if retunes { self.service.retune(config) } else { self.service.configure(config) } {
            Ok(()) => {
                (self.sent_settings, self.retunes) = (Some(*settings), retunes);
                Ok(())
            }
            Err(config) => {
                self.spare_config = Some(config);
                Err(Refusal::NoAnswer)
            }
        }
    }

    fn ready_for_command(&mut self) -> Result<(), Refusal<'static>> {
        self.reply = None;
        self.ticks_since_command = 0;
        if self.unclaimed_replies > 0 || self.disarm_due {
            return Err(Refusal::NoAnswer);
        }
        self.scope.commanded();
        Ok(())
    }

    /// The drive's answer to the last command.
    pub fn take_reply(&mut self) -> Option<Reply> {
        self.reply.take()
    }

    /// No request waits for the answer to the last command any more.
    #[inline(never)]
    pub const fn abandon_reply(&mut self) {
        self.unclaimed_replies = self.unclaimed_replies.saturating_add(1);
    }

    pub(super) fn on_reply(&mut self, reply: Reply) {
        if let Some(settings) = self.sent_settings.take()
            && reply.is_ok()
        {
            // Other gains give no reason to learn the sensors anew.
            if self.retunes {
                self.settings = settings;
            } else {
                self.adopt_settings(settings);
            }
        }
        match self.unclaimed_replies.checked_sub(1) {
            Some(fewer) => self.unclaimed_replies = fewer,
            None => self.reply = Some(reply),
        }
    }

    /// The drive works with other settings now.
    #[inline(never)]
    fn adopt_settings(&mut self, settings: Settings) {
        if settings.reversed != self.settings.reversed {
            // The drive has given up the model that counts the other way.
            if let Some(sensors) = &mut self.sensors {
                sensors.direct(settings.reversed);
            }
            if let Some(table) = &mut self.table {
                *table = table.reversed();
                self.table_due = true;
            }
        }
        if (settings.reversed, settings.halls) != (self.settings.reversed, self.settings.halls) {
            self.install_due = self.sensors.is_some();
            // Before the next request, which may be to arm. A faulted drive gets it when the fault is cleared.
            self.install();
        }
        self.table_due |= settings.anti_cogging != self.settings.anti_cogging;
        self.settings = settings;
        self.magnets.adopt(&mut self.storage, self.sensors.as_ref(), &settings);
        self.relearn();
    }
}
