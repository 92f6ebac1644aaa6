//! The Halls' electrical zero out of the encoder: without motion, where a calibration would turn the rotor.

use super::Tasks;
use crate::encoder::Encoder;
use embedded_storage::nor_flash::NorFlash;
use hallservo_protocol::{EncoderRefusal, Record, Refusal};

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Moves the zero of the sensors' model to where the encoder has it, in use and in the flash.
    ///
    /// # Errors
    /// The rotor is not at rest, or one of the two does not know its angle.
    pub fn align(&mut self) -> Result<(), Refusal<'static>> {
        if !self.is_at_rest() {
            return Err(Refusal::Encoder(EncoderRefusal::NotAbsolute(None)));
        }
        let ahead = self.encoder.halls_ahead(self.mode())?;
        let reversed = self.settings.reversed;
        let Some(sensors) = self.sensors.as_mut() else { return Err(Refusal::Encoder(EncoderRefusal::NotCalibrated)) };
        for model in [&mut sensors.model, &mut sensors.calibrated] {
            model.reversed = reversed;
            *model = model.with_zero_at(ahead);
        }
        self.install_due = true;
        self.unsaved[Record::Sensors as usize] = true;
        self.relearn();
        Ok(())
    }
}
