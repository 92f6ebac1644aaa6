//! The sensors' model as a record: what a calibration found and the adaptation has learnt since.

use crate::angle::ElectricalAngle;
use crate::hall::model::{Model, Sensor};

/// Version of the form below, for [`super::Store::new`].
pub const VERSION: u16 = 1;
/// Bytes of the record.
pub const LENGTH: usize = 3 * 20 + 8;

/// The record of a model: little endian, each sensor's offset, amplitude, placement, third and fifth harmonic, then the
/// alignment and whether it is reversed.
pub fn encode(model: &Model) -> [u8; LENGTH] {
    let mut record = [0; LENGTH];
    let (words, _) = record.as_chunks_mut();
    for (words, sensor) in words.chunks_exact_mut(5).zip(&model.sensors) {
        let Sensor { offset, amplitude, placement, third, fifth } = *sensor;
        let bits =
            [offset.to_bits(), amplitude.to_bits(), placement.to_bits() as u32, third.to_bits(), fifth.to_bits()];
        for (word, bits) in words.iter_mut().zip(bits) {
            *word = bits.to_le_bytes();
        }
    }
    words[15] = model.alignment.to_bits().to_le_bytes();
    words[16] = u32::from(model.reversed).to_le_bytes();
    record
}

/// The model of a record; `None` where the length or a value is not one that [`encode`] writes. Whether the model is
/// any good is for [`crate::hall::estimate::validate`] to say.
pub fn decode(record: &[u8]) -> Option<Model> {
    let record: &[u8; LENGTH] = record.try_into().ok()?;
    let word = |at: usize| [record[4 * at], record[4 * at + 1], record[4 * at + 2], record[4 * at + 3]];
    let sensor = |k: usize| Sensor {
        offset: f32::from_le_bytes(word(5 * k)),
        amplitude: f32::from_le_bytes(word(5 * k + 1)),
        placement: ElectricalAngle::from_bits(i32::from_le_bytes(word(5 * k + 2))),
        third: f32::from_le_bytes(word(5 * k + 3)),
        fifth: f32::from_le_bytes(word(5 * k + 4)),
    };
    let reversed = match u32::from_le_bytes(word(16)) {
        0 => false,
        1 => true,
        _ => return None,
    };
    let alignment = ElectricalAngle::from_bits(i32::from_le_bytes(word(15)));
    Some(Model { sensors: [sensor(0), sensor(1), sensor(2)], alignment, reversed })
}
