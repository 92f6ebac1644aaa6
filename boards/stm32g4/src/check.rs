//! What holds for every board with this chip; its own tests call it. On the host only.

use crate::registers::adc::Sequence;
use crate::wiring::Wiring;
use core::ops::RangeInclusive;
use hallservo::commutation::svpwm::Modulator;
use hallservo::pwm;
use hallservo::settings::{Control, Entry, Kind, Settings, TABLE};
use std::vec::Vec;

/// A drive can start with what a board gives it, and the timer agrees with the drive.
///
/// # Panics
/// Where it does not.
pub fn settings(settings: &Settings, wiring: &Wiring) {
    let config = settings.validate().expect("settings that a drive can start with");
    assert_eq!((config.period, config.dead_time), (wiring.period(), wiring.dead_time_ticks()));
    assert_eq!(config.adc_bits, 12);
    assert_eq!((settings.pwm_hz, settings.timer_hz), (wiring.pwm_hz as f32, 170e6));
}

/// The simulations on a host learn a board's settings from a file: those in which it differs from the library's default.
///
/// # Panics
/// Where the file does not say what the settings are.
pub fn exported(settings: &Settings, file: &str) {
    let default = Settings { control: Some(Control::default()), ..Settings::default() };
    let differs = |entry: &&Entry| entry.get(settings) != entry.get(&default);
    let line = |entry: &Entry| match (entry.kind(), entry.get(settings).expect("current control")) {
        (Kind::Choice(names), value) => {
            format!("{} = {:?}", entry.name, names.split('|').nth(value as usize).expect("a choice"))
        }
        (Kind::Switch, value) => format!("{} = {}", entry.name, value != 0.0),
        (_, value) => format!("{} = {value:?}", entry.name),
    };
    let wanted: Vec<String> = TABLE.iter().filter(differs).map(line).collect();
    let written: Vec<&str> = file.lines().filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    assert!(written == wanted, "settings.toml should say\n{}", wanted.join("\n"));
}

/// Currents are sampled while the lower transistors conduct: from half a window before the valley the amplifiers settle
/// for half a microsecond at least, and these ranks of the sequence are held before the window ends.
///
/// # Panics
/// Where they are not.
pub fn currents(settings: &Settings, wiring: &Wiring, sequence: &Sequence, ranks: RangeInclusive<usize>) {
    let half = settings.sampling_window_s * settings.timer_hz / 2.0;
    let begins = (wiring.lead - sequence.begun(*ranks.start())) as f32;
    let ends = (sequence.held(*ranks.end()) - wiring.lead) as f32;
    assert!(begins + 0.5e-6 * settings.timer_hz < half && ends < half, "{begins} {ends} {half}");
}

/// The longest voltage vector at a PWM frequency, of that of a bridge without sampling and dead time: 1/√3 of the bus. Of
/// three sampled currents, or of two where the third phase's low side conducts for a time.
///
/// # Panics
/// Where the settings do not allow that frequency.
pub fn voltage_left(settings: &Settings, pwm_hz: f32, least_low_side_s: Option<f32>) -> f64 {
    let Settings { timer_hz, dead_time_s, .. } = *settings;
    let period = pwm::period_counts(timer_hz, pwm_hz).expect("a period");
    let dead_time = pwm::dead_time_counts(timer_hz, pwm_hz, dead_time_s).expect("a dead time");
    let mut limits = settings.limits(period).expect("limits");
    if let Some(least_s) = least_low_side_s {
        limits = limits.with_top(pwm::highest_compare(period, timer_hz, least_s, dead_time_s));
    }
    f64::from(Modulator::longest(period, dead_time, &limits)) * 3.0_f64.sqrt()
}

/// Channels of a sequence, by rank.
pub fn channels(sequence: &Sequence) -> Vec<u8> {
    sequence.0.iter().map(|rank| rank.channel).collect()
}
