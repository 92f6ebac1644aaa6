//! What is handed over to the tasks.

use super::servo::Context;
use super::{Drive, Sample};
use crate::mode::Mode;

impl Drive {
    /// A record with currents and voltages, if there are any.
    #[inline(never)]
    pub(super) fn send_record_and_measurement(&mut self, sample: &Sample) {
        if let Some(config) = &self.config.control
            && self.mode == Mode::Running
        {
            let with = Context { config, rotor: &self.record.rotor, sample };
            self.servo.note(&with, &self.paths.field_oriented, &self.paths.idle, self.record.sequence);
            self.publish();
            self.hand_over_measurement();
        }
        let calibrating = matches!(self.mode, Mode::Aligning | Mode::Calibrating);
        let every = if calibrating { self.config.calibration_record_every } else { self.config.record_every };
        self.record.codes = sample.halls;
        self.send_record(every);
        // A calibration may record every step.
        if every == 1 {
            self.receive(sample);
        }
    }

    /// Lets the next step hand over a record, unless this one does.
    pub(super) fn hasten_record(&mut self) {
        if self.until_record != 0 {
            self.record.sequence = self.record.sequence.wrapping_sub(self.until_record - 1);
            self.until_record = 1;
        }
    }

    /// Hands a record to the tasks; when they do not keep up, it is lost. The next one comes after `every` steps.
    #[inline(always)]
    pub(super) fn send_record(&mut self, every: u32) {
        self.until_record = every;
        let _ = self.channels.records.enqueue(self.record);
        self.record.sequence = self.record.sequence.wrapping_add(every);
    }
}
