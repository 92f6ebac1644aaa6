//! What is kept in the flash, and when.

use super::Supervisor;
use crate::fmt::say;
use crate::saving::REST_S;
use crate::settings::Settings;
use crate::supervisor::SETTLED;
use embedded_storage::nor_flash::NorFlash;
use hallservo_protocol::{Cause, Problem, Record};

/// Slower is rest: while a page of 2 KiB is erased, in some 25 ms, no rotor of up to 10 pole pairs turns out of the tracker's sight then.
const AT_REST_RAD_S: f32 = 2.0;

impl<F: NorFlash> Supervisor<F> {
    /// Saves one of what waits, if the bridge is off.
    #[inline(never)]
    pub(super) fn save(&mut self) {
        if !self.may_save() {
            return;
        }
        let rested = self.learnt_saved_ms.is_none_or(|then| self.now_ms >= then + 1000 * REST_S);
        if rested && self.is_worth_saving() {
            self.learnt_saved_ms = Some(self.now_ms);
            self.waiting[Record::Sensors as usize] = true;
        }
        if core::mem::take(&mut self.waiting[Record::Sensors as usize]) {
            self.save_sensors();
        } else if core::mem::take(&mut self.waiting[Record::Cogging as usize]) {
            self.save_table();
        } else if core::mem::take(&mut self.waiting[Record::Settings as usize]) {
            self.save_settings();
        }
    }

    /// Whether an erase, which stalls the core, does no harm: the bridge is off, and the rotor does not run out of sight meanwhile.
    pub fn may_save(&self) -> bool {
        self.since_command >= SETTLED && self.is_at_rest()
    }

    /// Whether the bridge is off and the rotor has come to rest.
    pub fn is_at_rest(&self) -> bool {
        !self.mode().drives() && self.speed_rad_s().abs() < AT_REST_RAD_S
    }

    pub(super) fn is_worth_saving(&self) -> bool {
        match (&self.sensors, &self.stored_sensors) {
            (Some(sensors), Some(stored)) => sensors.differ(stored),
            (sensors, _) => sensors.is_some(),
        }
    }

    #[inline(never)]
    fn save_sensors(&mut self) {
        let Some(sensors) = &self.sensors else { return };
        let saved = self.saving.save_sensors(sensors);
        // Those that cannot be saved are not tried again and again.
        self.stored_sensors = Some(*sensors);
        self.saved(Record::Sensors, saved);
    }

    #[inline(never)]
    fn save_table(&mut self) {
        let Some(table) = &self.table else { return };
        let saved = self.saving.save_table(table, self.settings.full_scale_a());
        self.saved(Record::Cogging, saved);
    }

    #[inline(never)]
    fn save_settings(&mut self) {
        let saved = self.saving.save_settings(&self.settings, &self.defaults);
        if saved.is_ok() {
            self.stored_settings = self.settings;
        }
        self.saved(Record::Settings, saved);
    }

    fn saved(&mut self, record: Record, saved: Result<(), Problem>) {
        self.stored[record as usize] = saved.err().unwrap_or(Problem::None);
        match saved {
            Ok(()) => say!(info, "record {} saved", record as u8),
            Err(_) => self.note(Cause::NotSaved(record)),
        }
    }

    /// Asks for the settings to be saved when that is possible.
    pub fn ask_to_save(&mut self) {
        self.waiting[Record::Settings as usize] = true;
    }

    /// Whether they have been, and how that went.
    pub fn settings_saved(&self) -> Option<bool> {
        let done = !self.waiting[Record::Settings as usize];
        done.then(|| self.stored[Record::Settings as usize] == Problem::None)
    }

    /// The settings in the flash.
    pub fn load_settings(&mut self) -> Result<Settings, Problem> {
        match self.saving.settings(&self.defaults) {
            (settings, Problem::None | Problem::Foreign) => Ok(settings),
            (_, problem) => Err(problem),
        }
    }
}
