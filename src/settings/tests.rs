use super::*;
use crate::storage::settings::key;

extern crate std;
use std::collections::HashSet;
use std::vec::Vec;

fn full() -> Settings {
    Settings { control: Some(Control::default()), ..Settings::default() }
}

fn control(settings: &mut Settings) -> &mut Control {
    settings.control.as_mut().unwrap()
}

fn blamed(settings: &Settings) -> &'static str {
    match settings.validate() {
        Err(Error::OutOfRange { field, .. }) => field,
        other => panic!("{other:?}"),
    }
}

#[test]
fn names_and_keys_are_unique_and_all_are_described() {
    let names: HashSet<_> = TABLE.iter().map(|entry| entry.name).collect();
    let keys: HashSet<_> = TABLE.iter().map(|entry| key(entry.name)).collect();
    assert_eq!((names.len(), keys.len()), (TABLE.len(), TABLE.len()));
    for entry in TABLE {
        let (name, unit) = (entry.name, entry.unit());
        assert!(name.len() <= 32 && unit.len() <= 8 && (1..=90).contains(&about(name).len()), "{name}");
    }
}

#[test]
fn every_field_out_of_range_is_named() {
    assert!(full().validate().is_ok());
    type Spoil = fn(&mut Settings);
    let cases: [(&str, Spoil); 66] = [
        ("adc_bits", |s| s.adc_bits = 7),
        ("adc_bits", |s| s.adc_bits = 17),
        ("timer_hz", |s| s.timer_hz = f32::NAN),
        ("timer_hz", |s| s.timer_hz = 1e10),
        ("pwm_hz", |s| s.pwm_hz = 999.0),
        ("pwm_hz", |s| s.pwm_hz = f32::INFINITY),
        ("sampling_window_s", |s| s.sampling_window_s = -1e-6),
        ("pole_pairs", |s| s.pole_pairs = 0),
        ("pole_pairs", |s| s.pole_pairs = 65),
        ("phase_advance_deg", |s| s.phase_advance_deg = 61.0),
        ("phase_advance_deg", |s| s.phase_advance_deg = f32::NAN),
        ("max_modulation", |s| s.max_modulation = 1.01),
        ("max_modulation", |s| s.max_modulation = -0.1),
        ("tracking_bandwidth_hz", |s| s.tracking_bandwidth_hz = 0.0),
        ("tracking_bandwidth_hz", |s| s.tracking_bandwidth_hz = f32::NAN),
        ("least_low_side_s", |s| s.least_low_side_s = 1.1e-6),
        ("least_low_side_s", |s| s.least_low_side_s = -1e-9),
        ("least_low_side_s", |s| (s.least_low_side_s, control(s).field_weakening_a) = (1e-6, 0.1)),
        ("least_low_side_s", |s| s.least_low_side_s = f32::NAN),
        ("halls_held_s", |s| s.halls_held_s = -21e-6),
        ("halls_held_s", |s| (s.pwm_hz, s.halls_held_s) = (100e3, 16e-6)),
        ("halls_held_s", |s| s.halls_held_s = f32::NAN),
        ("max_electrical_hz", |s| s.max_electrical_hz = 2001.0),
        ("max_electrical_hz", |s| s.max_electrical_hz = 0.0),
        ("tolerated_samples", |s| s.tolerated_samples = 101),
        ("calibration_modulation", |s| s.calibration_modulation = 0.6),
        ("calibration_align_s", |s| s.calibration_align_s = 0.0),
        ("calibration_align_s", |s| s.calibration_align_s = 11.0),
        ("calibration_hz", |s| s.calibration_hz = 51.0),
        ("calibration_hz", |s| s.calibration_hz = f32::NAN),
        ("calibration_turns", |s| s.calibration_turns = 1),
        ("calibration_turns", |s| s.calibration_turns = 65),
        ("record_hz", |s| s.record_hz = 0.0),
        ("record_hz", |s| s.record_hz = 20_001.0),
        ("calibration_record_hz", |s| s.calibration_record_hz = f32::NAN),
        ("current_full_scale_a", |s| control(s).current_full_scale_a = 0.0),
        ("bus_full_scale_v", |s| control(s).bus_full_scale_v = f32::NAN),
        ("resistance_ohm", |s| control(s).resistance_ohm = 0.0),
        ("inductance_h", |s| control(s).inductance_h = -1.0),
        ("flux_linkage_wb", |s| control(s).flux_linkage_wb = f32::NAN),
        ("inertia_kgm2", |s| control(s).inertia_kgm2 = 0.0),
        ("current_bandwidth_hz", |s| control(s).current_bandwidth_hz = 2001.0),
        ("speed_bandwidth_hz", |s| control(s).speed_bandwidth_hz = 251.0),
        ("position_bandwidth_hz", |s| control(s).position_bandwidth_hz = 31.0),
        ("dead_time_ramp_a", |s| control(s).dead_time_ramp_a = 0.0),
        ("max_current_a", |s| control(s).max_current_a = 7.5),
        ("max_speed_rad_s", |s| control(s).max_speed_rad_s = 1e5),
        ("max_acceleration_rad_s2", |s| control(s).max_acceleration_rad_s2 = 0.0),
        ("under_voltage_v", |s| control(s).guard.under_voltage_v = 0.0),
        ("over_voltage_v", |s| control(s).guard.over_voltage_v = 11.0),
        ("chopper_v", |s| control(s).guard.chopper_v = 28.3),
        ("chopper_v", |s| control(s).guard.chopper_v = 13.6),
        ("chopper_v", |s| (control(s).guard.chopper_v, control(s).guard.over_voltage_v) = (26.0, 28.0)),
        ("chopper_on_s", |s| control(s).guard.chopper_on_s = f32::INFINITY),
        ("chopper_share", |s| control(s).guard.chopper_share = 0.0),
        ("over_current_a", |s| control(s).guard.over_current_a = 8.25),
        ("imbalance_a", |s| control(s).guard.imbalance_a = f32::NAN),
        ("offset_a", |s| control(s).guard.offset_a = -1.0),
        ("bridge_pull_up_ohm", |s| control(s).guard.bridge.pull_up_ohm = 0.0),
        ("motor_nominal_ohm", |s| control(s).guard.motor.nominal_ohm = f32::INFINITY),
        ("motor_beta_k", |s| control(s).guard.motor.beta_k = 10.0),
        ("bridge_max_c", |s| control(s).guard.bridge.max_c = 80.0),
        ("stall_s", |s| control(s).guard.stall_s = 0.0),
        ("command_timeout_s", |s| control(s).guard.command_timeout_s = f32::NAN),
        ("max_winding_rise_k", |s| control(s).guard.max_winding_rise_k = 501.0),
        // 20 mΩ: the dead time takes more voltage than the winding.
        ("max_winding_rise_k", |s| {
            (control(s).resistance_ohm, control(s).guard.max_winding_rise_k) = (0.02, 100.0);
        }),
    ];
    for (name, change) in cases {
        let mut settings = full();
        change(&mut settings);
        assert_eq!(blamed(&settings), name);
    }
}

#[test]
fn both_ends_of_every_range_are_allowed_and_nothing_beyond_nor_what_is_no_number() {
    for entry in TABLE.iter().filter(|entry| entry.kind() == Kind::Real) {
        let (min, max) = entry.range(&full()).unwrap();
        let with = |value| {
            let mut changed = full();
            entry.assign(&mut changed, value).unwrap();
            changed
        };
        for allowed in [min, max] {
            // It may take another one out of its range, or not fit the PWM.
            assert_eq!(entry.check(&with(allowed)), Ok(()), "{}", entry.name);
        }
        let step = 1e-3 * (max - min).min(1e6);
        let beyond = [min - step, max + step, f32::NAN].into_iter().filter(|value| *value != f32::INFINITY);
        for value in beyond {
            assert_eq!(blamed(&with(value)), entry.name, "{value}");
        }
    }
}

#[test]
fn whole_numbers_and_choices_are_kept_and_nothing_between() {
    let settings = full();
    for entry in TABLE.iter().filter(|entry| entry.kind() != Kind::Real && !entry.fixed(&full())) {
        let (min, max) = entry.range(&settings).unwrap();
        for value in [min, max] {
            // Fewer pole pairs leave the largest speed allowed; more do not.
            let Ok(changed) = settings.with(entry.name, value) else {
                assert_eq!(entry.name, "pole_pairs");
                continue;
            };
            assert_eq!(entry.get(&changed), Some(value), "{}", entry.name);
        }
        assert_eq!(settings.with(entry.name, min + 0.5), Err(Error::NotWhole), "{}", entry.name);
        if let Kind::Choice(names) = entry.kind() {
            assert_eq!(names.split('|').count() as f32, max + 1.0, "{}", entry.name);
            for number in (0..=max as u8).map(f32::from) {
                assert_eq!(entry.get(&settings.with(entry.name, number).unwrap()), Some(number), "{}", entry.name);
            }
        }
    }
}

#[test]
fn what_cannot_be_set_is_named() {
    let settings = full();
    assert_eq!(settings.with("adc_bits", 12.0), Err(Error::Fixed));
    assert_eq!(settings.with("nonsense", 12.0), Err(Error::Unknown));
    let plain = Settings::default();
    for name in ["max_current_a", "feedback", "stall_s", "bridge_max_c"] {
        assert_eq!(plain.with(name, 1.0), Err(Error::NoControl));
        assert_eq!(find(name).unwrap().range(&plain), None);
    }
    assert!(matches!(plain.with("commutation", 2.0), Err(Error::OutOfRange { field: "commutation", .. })));
    let field_oriented = Settings { commutation: crate::commutation::Commutation::FieldOriented, ..plain };
    assert_eq!(field_oriented.validate(), Err(Error::NoControl));
    // 64 pole pairs make the largest speed of the default impossible, and that is what is named.
    assert!(matches!(settings.with("pole_pairs", 64.0), Err(Error::OutOfRange { field: "max_speed_rad_s", .. })));
}

#[test]
fn contradictions_are_refused() {
    let cases: [fn(&mut Settings); 2] =
        [|s| (s.timer_hz, s.pwm_hz, s.dead_time_s) = (1e6, 200e3, 0.0), |s| s.sampling_window_s = 20e-6];
    for change in cases {
        let mut settings = Settings::default();
        change(&mut settings);
        // What follows from the frequency of the PWM.
        (settings.max_electrical_hz, settings.record_hz) = (500.0, 500.0);
        assert!(matches!(settings.validate(), Err(Error::Pwm(_))), "{settings:?}");
    }
}

#[test]
fn other_values_have_another_digest() {
    let changed: Vec<_> = TABLE.iter().filter(|entry| entry.kind() == Kind::Switch).collect();
    assert!(full().digest() == full().digest() && !changed.is_empty());
    assert_ne!(full().digest(), Settings::default().digest());
    for entry in changed {
        let value = entry.get(&full()).unwrap();
        assert_ne!(full().with(entry.name, 1.0 - value).unwrap().digest(), full().digest());
    }
}

#[test]
fn a_thermistor_reads_half_at_25_degrees_and_less_when_hot() {
    let ntc = Thermistor::ntc_10k(80.0, 100.0);
    assert!((ntc.code(25.0) - 32_768.0).abs() < 1.0);
    // 10 kΩ · exp(3380 (1/373.15 − 1/298.15)) = 1.024 kΩ.
    assert!((ntc.code(100.0) / 65_536.0 - 0.0929).abs() < 2e-4);
    assert!(ntc.code(80.0) > ntc.code(100.0));
}

#[test]
fn no_setting_exceeds_the_boards_ceilings_and_the_refusal_names_them() {
    let board = Settings { ceilings: &[("max_current_a", 2.0), ("stall_s", 1.0), ("commutation", 1.0)], ..full() };
    let settings = Settings { control: board.control.map(|c| Control { max_current_a: 2.0, ..c }), ..board };
    assert!(settings.validate().is_ok());
    for (field, value, most) in [("max_current_a", 2.01, 2.0), ("stall_s", 1.5, 1.0), ("commutation", 2.0, 1.0)] {
        let error = settings.with(field, value).unwrap_err();
        assert_eq!(error, Error::Ceiling { field, value, most });
        let text = std::format!("{error}");
        assert!(text.contains(field) && text.contains("ceiling"), "{text}");
        // A tool shows the ceiling as the end of the range.
        assert_eq!(find(field).unwrap().range(&settings).unwrap().1, most);
    }
    // Nor do those that a board itself or a drive without a check of the ceilings would start with.
    assert_eq!(board.validate(), Err(Error::Ceiling { field: "max_current_a", value: 3.0, most: 2.0 }));
    // What is the board's may be changed up to a ceiling that it names, and not otherwise.
    let board = Settings { ceilings: &[("pwm_hz", 80e3)], ..full() };
    assert_eq!(board.with("pwm_hz", 80e3).unwrap().validate().unwrap().period, 1063);
    assert!(matches!(board.with("pwm_hz", 81e3), Err(Error::Ceiling { field: "pwm_hz", .. })));
    assert!(matches!(board.with("pwm_hz", 19e3), Err(Error::OutOfRange { field: "pwm_hz", .. })));
    assert_eq!((full().with("pwm_hz", 40e3), board.with("timer_hz", 170e6)), (Err(Error::Fixed), Err(Error::Fixed)));
    // A range that is narrower stays.
    assert!(matches!(settings.with("stall_s", 1e-3), Err(Error::OutOfRange { field: "stall_s", .. })));
    // A ceiling of nothing is found by the test of the board.
    assert_eq!(Settings { ceilings: &[("max_curent_a", 2.0)], ..full() }.validate(), Err(Error::Unknown));
}

#[test]
fn hostile_settings_are_out_of_their_ranges() {
    let hostile = [
        ("over_voltage_v", 36.3),
        ("over_voltage_v", 0.951 * 36.3),
        ("stall_s", 5.1),
        ("stall_s", 100.0),
        ("command_timeout_s", f32::INFINITY),
        ("command_timeout_s", 60.1),
    ];
    for (name, value) in hostile {
        let result = full().with(name, value);
        assert!(matches!(result, Err(Error::OutOfRange { field, .. }) if field == name), "{name} {value}: {result:?}");
    }
}

#[test]
fn one_blind_amplifier_shows_far_below_the_largest_current() {
    // The largest sum that three amplifiers with gains off by 2 % show, in all directions of the current, and six
    // standard deviations of their noise, both as simulated: two codes of 12 bit.
    let control = Control::default();
    let threshold = |control: &Control| control.guard.imbalance_a + 0.04 * control.max_current_a;
    let sum = (0..360_u16).map(|degrees| {
        let phase = |k: u16| libm::cosf(f32::from(degrees + 120 * k).to_radians());
        (0..3).map(|k| 0.02 * phase(k).abs()).sum::<f32>() * control.max_current_a
    });
    let noise = 6.0 * libm::sqrtf(3.0) * 2.0 / 2048.0 * control.current_full_scale_a;
    assert!(sum.fold(0.0, f32::max) + noise <= 1.02 * threshold(&control));
    assert!(threshold(&control) < 0.1 * control.max_current_a);
}

/// What is refused tells a value that is not.
#[test]
fn at_a_large_inertia_the_most_that_is_told_is_taken() {
    let mut told = std::vec::Vec::new();
    for inertia_kgm2 in [1e-5, 1e-3, 3e-3, 0.02, 0.1, 1.0, 100.0] {
        let mut settings =
            Settings { control: Some(Control { inertia_kgm2, ..Control::default() }), ..Settings::default() };
        while let Err(Error::OutOfRange { field, max, .. }) = settings.validate() {
            assert!(max > 0.0 && !told.contains(&(inertia_kgm2, field)), "{field} {max}");
            told.push((inertia_kgm2, field));
            let Some(control) = &mut settings.control else { continue };
            match field {
                "inertia_kgm2" => control.inertia_kgm2 = max,
                "speed_bandwidth_hz" => {
                    control.speed_bandwidth_hz = max;
                    control.position_bandwidth_hz = control.position_bandwidth_hz.min(max / 2.0);
                }
                other => panic!("{other}"),
            }
        }
        settings.validate().unwrap();
    }
    assert!(told.contains(&(3e-3, "speed_bandwidth_hz")) && told.contains(&(1.0, "inertia_kgm2")), "{told:?}");
}

#[test]
fn other_gains_are_all_that_follows_from_tunable_settings() {
    let base = full();
    let mut names: Vec<_> = TABLE.iter().filter(|entry| entry.is_tunable()).map(|entry| entry.name).collect();
    names.sort_unstable();
    let loops = ["current_bandwidth_hz", "position_bandwidth_hz", "speed_bandwidth_hz", "tracking_bandwidth_hz"];
    assert_eq!(names, loops);
    let values = [(200.0, 8.0, 3.0, 50.0), (2000.0, 400.0, 0.1, 5000.0), (1000.0, 60.0, 30.0, 5.0)];
    for (current_hz, speed_hz, position_hz, tracking_hz) in values {
        let mut changed = base;
        changed.tracking_bandwidth_hz = tracking_hz;
        let loops = control(&mut changed);
        (loops.current_bandwidth_hz, loops.speed_bandwidth_hz) = (current_hz, speed_hz);
        loops.position_bandwidth_hz = position_hz;
        let (mut config, wanted) = (base.validate().unwrap(), changed.validate().unwrap());
        assert_ne!(config, wanted);
        config.retune(&wanted);
        assert_eq!(config, wanted);
    }
    // What does not follow from them stays.
    let mut other = base;
    control(&mut other).max_current_a = 1.0;
    let mut config = base.validate().unwrap();
    config.retune(&other.validate().unwrap());
    assert_eq!(config, base.validate().unwrap());
}
