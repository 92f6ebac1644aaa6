//! Commands and settings on their way to the drive, and its answers.

use super::Supervisor;
use crate::settings::Settings;
use embedded_storage::nor_flash::NorFlash;
use hallservo::drive::Command;
use hallservo_protocol::Refusal;

impl<F: NorFlash> Supervisor<F> {
    /// Sends a command to the drive; [`Self::take_reply`] has the answer.
    pub fn send(&mut self, command: Command) -> Result<(), Refusal<'static>> {
        self.ready_to_ask()?;
        self.service.send(command).map_err(|_| Refusal::Silent)
    }

    /// Sends other settings to the drive, the same way.
    pub fn configure(&mut self, settings: Settings) -> Result<(), Refusal<'static>> {
        let config = settings.validate()?;
        self.ready_to_ask()?;
        let spare = self.spare.take().ok_or(Refusal::Silent)?;
        *spare = config;
        match self.service.configure(spare) {
            Ok(()) => {
                self.coming = Some(settings);
                Ok(())
            }
            Err(spare) => {
                self.spare = Some(spare);
                Err(Refusal::Silent)
            }
        }
    }

    fn ready_to_ask(&mut self) -> Result<(), Refusal<'static>> {
        self.reply = None;
        self.since_command = 0;
        if self.unheard > 0 { Err(Refusal::Silent) } else { Ok(()) }
    }

    /// The drive's answer to the last command.
    pub fn take_reply(&mut self) -> Option<Result<(), Refusal<'static>>> {
        self.reply.take()
    }

    /// Nobody waits for the answer any more.
    pub fn give_up(&mut self) {
        self.unheard = 1;
    }

    pub(super) fn answered(&mut self, reply: Result<(), Refusal<'static>>) {
        if let Some(settings) = self.coming.take()
            && reply.is_ok()
        {
            self.take_up(settings);
        }
        match self.unheard.checked_sub(1) {
            Some(fewer) => self.unheard = fewer,
            None => self.reply = Some(reply),
        }
    }

    /// The drive works with other settings now.
    #[inline(never)]
    fn take_up(&mut self, settings: Settings) {
        if settings.drive.reversed != self.settings.drive.reversed {
            self.install = self.sensors.is_some();
            if let Some(sensors) = &mut self.sensors {
                sensors.model.reversed = settings.drive.reversed;
            }
        }
        self.balance |= settings.anti_cogging != self.settings.anti_cogging;
        self.settings = settings;
        self.relearn();
    }
}
