//! The settings in the flash: those that differ from the board's defaults, each under the name it has in the table.
//!
//! A list of pairs, little endian: the [`key`] of a name, then the value as `f32`. So a later firmware that knows more settings
//! keeps the old values, and gives the new ones its defaults; a default that was never changed by anyone follows the
//! firmware; a setting that is not known any more, or whose value is not allowed any more, is left at its default, and that is
//! told as [`Problem::Foreign`].

use super::{Entry, Settings, TABLE};
use crc::{CRC_16_IBM_SDLC, Crc, NoTable};
use hallservo_protocol::Problem;

/// Bytes of a pair.
pub const KEYED: usize = 6;

const CRC: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_IBM_SDLC);

/// What stands for a name: its CRC-16. No two names of the table have the same.
pub fn key(name: &str) -> u16 {
    CRC.checksum(name.as_bytes())
}

impl Settings {
    /// Writes what differs from the defaults; returns the length, or `None` if there is no room.
    pub(crate) fn record(&self, defaults: &Self, record: &mut [u8]) -> Option<usize> {
        let mut pairs = record.chunks_exact_mut(KEYED);
        let mut length = 0;
        for entry in TABLE.iter().filter(|entry| !entry.fixed && entry.get(self) != entry.get(defaults)) {
            let pair = pairs.next()?;
            pair[..2].copy_from_slice(&key(entry.name).to_le_bytes());
            pair[2..].copy_from_slice(&entry.get(self).unwrap_or_default().to_le_bytes());
            length += KEYED;
        }
        Some(length)
    }

    /// The defaults, changed as a record says, and what was wrong with the record.
    pub(crate) fn of_record(defaults: &Self, record: &[u8]) -> (Self, Problem) {
        let mut settings = *defaults;
        let mut problem = if record.len().is_multiple_of(KEYED) { Problem::None } else { Problem::Corrupt };
        // Some ranges depend on other settings, so what is refused at first may be allowed later.
        for pass in 0..3 {
            for pair in record.chunks_exact(KEYED) {
                let Some((entry, value)) = pair_of(pair) else {
                    problem = Problem::Foreign;
                    continue;
                };
                if entry.assign(&mut settings, value).is_err() && pass == 2 {
                    problem = Problem::Foreign;
                }
            }
        }
        if settings.validate().is_ok() { (settings, problem) } else { (*defaults, Problem::Foreign) }
    }
}

fn pair_of(pair: &[u8]) -> Option<(&'static Entry, f32)> {
    let [low, high, value @ ..] = pair else { return None };
    let key_found = u16::from_le_bytes([*low, *high]);
    let entry = TABLE.iter().find(|entry| !entry.fixed && key(entry.name) == key_found)?;
    Some((entry, f32::from_le_bytes(value.try_into().ok()?)))
}
