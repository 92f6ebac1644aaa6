use super::*;
use hallservo_protocol::{Answer, FRAME, Problem, Reply, Setting, encode};

extern crate std;
use std::collections::HashSet;

fn full() -> Settings {
    let control = Some(hallservo::control::settings::Settings::default());
    Settings::new(settings::Settings { control, ..Default::default() })
}

#[test]
fn names_and_keys_are_unique_and_every_row_fits_a_frame() {
    let names: HashSet<_> = TABLE.iter().map(|entry| entry.name).collect();
    let keys: HashSet<_> = TABLE.iter().map(|entry| key(entry.name)).collect();
    assert_eq!((names.len(), keys.len()), (TABLE.len(), TABLE.len()));
    let mut longest = 0;
    for Entry { name, unit, kind, .. } in TABLE {
        let (name, unit, about, kind) = (*name, *unit, about(name), *kind);
        let setting = Setting { name, unit, kind, value: 1.0, default: 1.0, min: 0.0, max: 1.0, fixed: true };
        let length = encode(&Reply { id: u16::MAX, answer: Answer::Setting(setting) }, &mut [0; FRAME]);
        longest = longest.max(length.unwrap_or_else(|_| panic!("{name}")));
        assert!(name.len() <= 32 && unit.len() <= 8 && (1..=90).contains(&about.len()), "{name}");
    }
    std::println!("{} settings, longest frame {longest} bytes", TABLE.len());
}

/// The library has the same name for it, but for what bridge and motor have both.
fn same(name: &str, field: &str) -> bool {
    name == field || name.strip_prefix("bridge_").or(name.strip_prefix("motor_")) == Some(field)
}

#[test]
fn every_range_is_that_of_the_drives_validation() {
    for entry in TABLE.iter().filter(|entry| entry.kind == Kind::Real && entry.name != "dead_time_s") {
        let settings = full();
        let (min, max) = entry.range(&settings);
        let step = 1e-3 * (max - min).min(1e6);
        for (value, allowed) in [(min, true), (max, true), (min - step, false), (max + step, false), (f32::NAN, false)]
        {
            if !value.is_finite() && entry.name == "command_timeout_s" {
                continue;
            }
            let mut changed = settings;
            (entry.field)(&mut changed).expect("control").assign(value);
            // At its end a setting may push another out of that one's range, or not fit to the PWM.
            let refused = match changed.validate() {
                Err(Refusal::OutOfRange { field, .. }) => same(entry.name, field),
                _ => false,
            };
            // The inner ends of the range between warning and fault belong to both.
            let shared = entry.name.ends_with("_warn_c") && value > min;
            assert!(refused != allowed || shared, "{} = {value}: {:?}", entry.name, changed.validate());
        }
    }
}

#[test]
fn whole_numbers_and_choices_are_kept_and_nothing_between() {
    let settings = full();
    for entry in TABLE.iter().filter(|entry| entry.kind != Kind::Real && !entry.fixed) {
        let (min, max) = entry.range(&settings);
        for value in [min, max] {
            // Fewer pole pairs leave the largest speed allowed; more do not.
            let Ok(changed) = settings.with(entry.name, value) else {
                assert_eq!(entry.name, "pole_pairs");
                continue;
            };
            assert_eq!(entry.get(&changed), Some(value), "{}", entry.name);
        }
        assert_eq!(settings.with(entry.name, min + 0.5).unwrap_err(), Refusal::NoChoice, "{}", entry.name);
        if let Kind::Choice(names) = entry.kind {
            assert_eq!(names.split('|').count() as f32, max + 1.0, "{}", entry.name);
        }
    }
}

#[test]
fn what_cannot_be_is_named() {
    let settings = full();
    assert_eq!(settings.with("adc_bits", 12.0), Err(Refusal::Fixed));
    assert_eq!(settings.with("nonsense", 12.0), Err(Refusal::NoSetting));
    let plain = Settings::new(settings::Settings::default());
    assert_eq!(plain.with("max_current_a", 1.0), Err(Refusal::NoControl));
    assert!(matches!(plain.with("commutation", 2.0), Err(Refusal::OutOfRange { field: "commutation", .. })));
    assert!(matches!(settings.with("max_current_a", f32::NAN), Err(Refusal::OutOfRange { .. })));
    // 64 pole pairs make the largest speed of the default impossible, and that is what is named.
    assert!(matches!(settings.with("pole_pairs", 64.0), Err(Refusal::OutOfRange { field: "max_speed_rad_s", .. })));
}

#[test]
fn a_record_keeps_what_was_changed_and_follows_the_defaults_otherwise() {
    let defaults = full();
    let settings =
        [("pole_pairs", 7.0), ("current_bandwidth_hz", 400.0), ("speed_bandwidth_hz", 90.0), ("on_timeout", 1.0)]
            .iter()
            .fold(defaults, |settings, (name, value)| settings.with(name, *value).unwrap());
    let mut record = [0; 240];
    let length = settings.record(&defaults, &mut record).unwrap();
    assert_eq!(length, 4 * KEYED);
    assert_eq!(Settings::of_record(&defaults, &record[..length]), (settings, Problem::None));
    // A later firmware with another default of what was never changed.
    let later = defaults.with("stall_s", 2.0).unwrap();
    let (read, problem) = Settings::of_record(&later, &record[..length]);
    assert_eq!((read, problem), (settings.with("stall_s", 2.0).unwrap(), Problem::None));
    assert_eq!(settings.record(&defaults, &mut record[..20]), None);
}

#[test]
fn what_a_record_has_and_nobody_knows_is_told() {
    let defaults = full();
    let mut record = [0_u8; 2 * KEYED];
    defaults.with("pole_pairs", 7.0).unwrap().record(&defaults, &mut record).unwrap();
    record[KEYED..].copy_from_slice(&[0xab, 0xcd, 0, 0, 0, 0]);
    let (read, problem) = Settings::of_record(&defaults, &record);
    assert_eq!((read.drive.pole_pairs, problem), (7, Problem::Foreign));
    // A value that is not allowed.
    let mut record = [0_u8; KEYED];
    record[..2].copy_from_slice(&key("pole_pairs").to_le_bytes());
    record[2..].copy_from_slice(&1e9_f32.to_le_bytes());
    assert_eq!(Settings::of_record(&defaults, &record), (defaults, Problem::Foreign));
    assert_eq!(Settings::of_record(&defaults, &record[..5]).1, Problem::Corrupt);
    // Settings that are allowed each, and not together.
    let mut record = [0_u8; KEYED];
    record[..2].copy_from_slice(&key("pole_pairs").to_le_bytes());
    record[2..].copy_from_slice(&64_f32.to_le_bytes());
    assert_eq!(Settings::of_record(&defaults, &record), (defaults, Problem::Foreign));
}
