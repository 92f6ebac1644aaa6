//! The settings as a record: those that differ from the board's defaults, each under the key of its name.
//!
//! A list of pairs, little endian: the [`key`] of a name, then the value as `f32`. So a later firmware that knows more
//! settings keeps the old values and gives the new ones its defaults, and a default that nobody has changed follows the
//! firmware.

use crate::crc::crc16;
use crate::settings::{Entry, Error, Settings, TABLE, find};

/// Version of the form below, for [`super::Store::new`].
pub const VERSION: u16 = 0x0301;
/// Most bytes of the record: all settings.
pub const LONGEST: usize = PAIR * TABLE.len();
/// Bytes of a pair.
pub const PAIR: usize = 6;

/// What stands for a name: its CRC-16. No two names of the table have the same.
pub fn key(name: &str) -> u16 {
    crc16(name.as_bytes())
}

/// Writes what differs from the defaults; returns the length, or `None` if there is no room.
pub fn encode(settings: &Settings, defaults: &Settings, record: &mut [u8]) -> Option<usize> {
    let mut pairs = record.chunks_exact_mut(PAIR);
    let mut length = 0;
    for entry in TABLE.iter().filter(|entry| !entry.fixed(defaults)) {
        let (Some(value), Some(default)) = (entry.get(settings), entry.get(defaults)) else { continue };
        if value != default {
            let pair = pairs.next()?;
            pair[..2].copy_from_slice(&key(entry.name).to_le_bytes());
            pair[2..].copy_from_slice(&value.to_le_bytes());
            length += PAIR;
        }
    }
    Some(length)
}

/// The defaults, changed as a record says, and whether all of it was taken over: what is not known or not allowed any
/// more stays at its default. Settings are judged together: one out of its range falls back to its default, and where
/// that does not help, all do.
pub fn decode(defaults: &Settings, record: &[u8]) -> (Settings, bool) {
    let mut settings = *defaults;
    let complete = apply(defaults, record, &mut settings) & settle(defaults, &mut settings);
    (settings, complete)
}

/// The first half of [`decode`]: changes settings, the defaults at first, as a record says, and tells whether all of it
/// is known. What takes a stack can be given back before the other half.
pub fn apply(defaults: &Settings, record: &[u8], settings: &mut Settings) -> bool {
    let mut complete = record.len().is_multiple_of(PAIR);
    for pair in record.chunks_exact(PAIR) {
        complete &= pair_of(pair, defaults).is_some_and(|(entry, value)| entry.assign(settings, value).is_ok());
    }
    complete
}

/// The second half: makes them valid together, and tells whether they were.
pub fn settle(defaults: &Settings, settings: &mut Settings) -> bool {
    let mut complete = true;
    while let Err(error) = settings.verify() {
        complete = false;
        if !reset(settings, defaults, error) {
            *settings = *defaults;
            break;
        }
    }
    complete
}

fn pair_of(pair: &[u8], defaults: &Settings) -> Option<(&'static Entry, f32)> {
    let [low, high, value @ ..] = pair else { return None };
    let found = u16::from_le_bytes([*low, *high]);
    let entry = TABLE.iter().find(|entry| !entry.fixed(defaults) && key(entry.name) == found)?;
    Some((entry, f32::from_le_bytes(value.try_into().ok()?)))
}

/// The setting that is to blame goes back to its default; false if it has that already.
fn reset(settings: &mut Settings, defaults: &Settings, error: Error<'_>) -> bool {
    let (Error::OutOfRange { field, .. } | Error::Ceiling { field, .. }) = error else { return false };
    let Some(entry) = find(field) else { return false };
    let (value, default) = (entry.get(settings), entry.get(defaults));
    value != default && default.is_some_and(|default| entry.assign(settings, default).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Control;

    fn full() -> Settings {
        Settings { control: Some(Control::default()), ..Settings::default() }
    }

    fn pairs<const N: usize>(values: [(&str, f32); N]) -> [[u8; PAIR]; N] {
        values.map(|(name, value)| {
            let ([a, b], [c, d, e, f]) = (key(name).to_le_bytes(), value.to_le_bytes());
            [a, b, c, d, e, f]
        })
    }

    #[test]
    fn a_record_keeps_what_was_changed_and_follows_the_defaults_otherwise() {
        let defaults = full();
        let changes =
            [("pole_pairs", 7.0), ("current_bandwidth_hz", 400.0), ("speed_bandwidth_hz", 90.0), ("on_timeout", 1.0)];
        let settings = changes.iter().fold(defaults, |settings, (name, value)| settings.with(name, *value).unwrap());
        let mut record = [0; LONGEST];
        let length = encode(&settings, &defaults, &mut record).unwrap();
        assert_eq!(record[..length], *pairs(changes).as_flattened());
        assert_eq!(decode(&defaults, &record[..length]), (settings, true));
        // A later firmware with another default of what was never changed.
        let later = defaults.with("stall_s", 2.0).unwrap();
        assert_eq!(decode(&later, &record[..length]), (settings.with("stall_s", 2.0).unwrap(), true));
        assert_eq!(encode(&settings, &defaults, &mut record[..20]), None);
    }

    #[test]
    fn what_is_not_known_or_not_allowed_stays_at_its_default() {
        let defaults = full();
        let seven = defaults.with("pole_pairs", 7.0).unwrap();
        let bad = [("nonsense", 0.0), ("adc_bits", 10.0), ("stall_s", 1e9), ("stall_s", f32::NAN), ("reversed", 0.5)];
        for bad in bad {
            let record = pairs([("pole_pairs", 7.0), bad]);
            assert_eq!(decode(&defaults, record.as_flattened()), (seven, false), "{bad:?}");
        }
        assert_eq!(decode(&defaults, &pairs([("pole_pairs", 1e9)])[0]), (defaults, false));
        assert_eq!(decode(&defaults, &[1, 2, 3, 4, 5]), (defaults, false));
    }

    #[test]
    fn settings_that_depend_on_each_other_are_judged_together() {
        let defaults = full();
        // Whatever the order: each alone would be out of its range.
        for order in [["over_voltage_v", "under_voltage_v"], ["under_voltage_v", "over_voltage_v"]] {
            let value = |name| if name == "over_voltage_v" { 34.0 } else { 32.5 };
            let record = pairs(order.map(|name| (name, value(name))));
            let (settings, complete) = decode(&defaults, record.as_flattened());
            let guard = settings.control.unwrap().guard;
            assert_eq!((guard.under_voltage_v, guard.over_voltage_v, complete), (32.5, 34.0, true));
        }
        // Allowed by itself, but not with the default of the largest speed.
        assert_eq!(decode(&defaults, &pairs([("pole_pairs", 64.0)])[0]), (defaults, false));
    }
}
