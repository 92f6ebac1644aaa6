//! What the diagnostic channel is told of the Halls.

use super::Tasks;
use crate::encoder::Encoder;
use embedded_storage::nor_flash::NorFlash;
use hallservo_registers::diagnostic::Halls;

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// The Halls as the latest record has them.
    pub fn halls(&self) -> Halls {
        let codes = self.record.codes;
        let angle = self.record.rotor.angle();
        let Some(model) = self.sensors.as_ref().map(|sensors| &sensors.model) else {
            return Halls { codes, amplitude: f32::NAN, angle_deg: f32::NAN, calibrated: false };
        };
        // How far the three are from their means together, against what they would be at this angle.
        let length = |codes: [u16; 3]| {
            let parts = codes.iter().zip(&model.sensors);
            let squares = parts.map(|(code, sensor)| {
                let wave = (f32::from(*code) - sensor.offset) / sensor.amplitude;
                wave * wave
            });
            hallservo::float::root(squares.sum())
        };
        let amplitude = length(codes) / length(model.codes(angle));
        Halls { codes, amplitude, angle_deg: angle.to_degrees(), calibrated: true }
    }
}
