//! What is saved in the flash, and when.

use super::{SETTLED, Tasks};
use crate::encoder::Encoder;
use crate::fmt::log;
use crate::storage::{ENCODER, SAVE_INTERVAL_S};
use embedded_storage::nor_flash::NorFlash;
use hallservo::settings::Settings;
use hallservo_protocol::{Cause, Problem, Record};

/// Speed below which the rotor is at rest, mechanical rad/s: in the 25 ms that the erase of a page of 2 KiB takes, a
/// rotor of up to 10 pole pairs turns by less than half an electrical turn then, which the tracker follows.
const AT_REST_RAD_S: f32 = 2.0;

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Saves one of the records that are due, if the bridge is off.
    #[inline(never)]
    pub(super) fn save(&mut self) {
        if !self.may_save() {
            return;
        }
        self.save_encoder();
        // A map is of no use without its calibration, which comes first: a power cut between them leaves no old one that has
        // lost its map.
        if !self.unsaved[Record::Sensors as usize] {
            self.save_magnets();
        }
        let interval_over = self.learnt_saved_ms.is_none_or(|then| self.now_ms >= then + 1000 * SAVE_INTERVAL_S);
        if interval_over && self.sensors_changed() {
            self.learnt_saved_ms = Some(self.now_ms);
            self.unsaved[Record::Sensors as usize] = true;
        }
        // While they are being calibrated there are none.
        if self.sensors.is_some() && core::mem::take(&mut self.unsaved[Record::Sensors as usize]) {
            self.save_sensors();
        } else if core::mem::take(&mut self.unsaved[Record::Cogging as usize]) {
            self.save_table();
        } else if core::mem::take(&mut self.unsaved[Record::Settings as usize]) {
            self.save_settings();
        }
    }

    /// Whether an erase, which stalls the core, does no harm: the bridge is off, and the rotor at rest.
    pub fn may_save(&self) -> bool {
        self.ticks_since_command >= SETTLED && self.is_at_rest()
    }

    /// Whether the bridge is off and the rotor has come to rest.
    pub fn is_at_rest(&self) -> bool {
        !self.mode().drives() && self.speed_rad_s().abs() < AT_REST_RAD_S
    }

    /// Whether the model of the sensors differs from the stored one by more than
    /// [`LEAST_CHANGE`](crate::storage::LEAST_CHANGE).
    pub(super) fn sensors_changed(&self) -> bool {
        match (&self.sensors, &self.stored_sensors) {
            (Some(sensors), Some(stored)) => sensors.differ(stored),
            (sensors, _) => sensors.is_some(),
        }
    }

    /// Saves what is known of the encoder, where the flash does not hold it.
    #[inline(always)]
    fn save_encoder(&mut self) {
        if E::RECORD == 0 {
            return;
        }
        let mut place = [0; ENCODER];
        if let Some(record) = self.encoder.record(&mut place) {
            let saved = self.storage.save_encoder(record);
            self.encoder.saved(saved);
            #[cfg(feature = "encoder")]
            match saved {
                Ok(()) => log!(info, "the encoder saved"),
                Err(_) => self.note(Cause::NotSaved(Record::Encoder)),
            }
        }
    }

    /// Saves the map of the magnets, where the flash does not hold it.
    #[inline(always)]
    fn save_magnets(&mut self) {
        #[cfg(feature = "map")]
        match self.magnets.save(&mut self.storage) {
            Some(Ok(())) => log!(info, "the map of the magnets saved"),
            Some(Err(_)) => self.note(Cause::NotSaved(Record::Magnets)),
            None => {}
        }
    }

    #[inline(never)]
    fn save_sensors(&mut self) {
        let Some(sensors) = &self.sensors else { return };
        let saved = self.storage.save_sensors(sensors);
        // A save that failed is not repeated before the model has changed again.
        self.stored_sensors = self.sensors;
        self.saved(Record::Sensors, saved);
    }

    #[inline(never)]
    fn save_table(&mut self) {
        let Some(table) = &self.table else { return };
        let saved = self.storage.save_table(
            table,
            #[cfg(feature = "map")]
            self.magnets.by_pole(),
            &self.settings,
        );
        self.saved(Record::Cogging, saved);
    }

    #[inline(never)]
    fn save_settings(&mut self) {
        let saved = self.storage.save_settings(&self.settings, &self.defaults);
        if saved.is_ok() {
            self.stored_settings = self.settings.digest();
            self.unconfirmed = false;
        }
        self.saved(Record::Settings, saved);
    }

    fn saved(&mut self, record: Record, saved: Result<(), Problem>) {
        self.stored[record as usize] = saved.err().unwrap_or(Problem::None);
        match saved {
            Ok(()) => log!(info, "record {} saved", record as u8),
            Err(_) => self.note(Cause::NotSaved(record)),
        }
    }

    /// Has the settings saved as soon as that is possible.
    pub fn request_save(&mut self) {
        self.unsaved[Record::Settings as usize] = true;
    }

    /// Whether a requested save went well; `None` while it is due.
    pub fn settings_saved(&self) -> Option<bool> {
        let done = !self.unsaved[Record::Settings as usize];
        done.then(|| self.stored[Record::Settings as usize] == Problem::None)
    }

    /// The settings in the flash, to their place.
    pub fn load_settings(&mut self, place: &mut Settings) -> Result<(), Problem> {
        match self.storage.settings(&self.defaults, place) {
            Problem::None => Ok(()),
            Problem::Foreign => {
                self.unconfirmed = true;
                Ok(())
            }
            problem => Err(problem),
        }
    }
}
