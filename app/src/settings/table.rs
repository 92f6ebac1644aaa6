//! The table. A name that has been in a release is never given to another setting.

use super::Entry;
use core::f32::consts::TAU;
use hallservo_protocol::Kind::{Choice, Real, Switch, Whole};

/// A row of [`TABLE`]: name, unit, kind, whether it is the board's; the field; its range, with the settings as `s` and those of
/// the control as `c`.
macro_rules! row {
    ($name:literal, $unit:literal, $kind:expr, $fixed:expr, $($field:ident).+, |$s:ident| $min:expr, $max:expr) => {
        Entry {
            name: $name,
            unit: $unit,
            kind: $kind,
            fixed: $fixed,
            field: |settings| Some(&mut settings.$($field).+),
            range: |$s, _| {
                let _ = $s;
                ($min, $max)
            },
        }
    };
    ($name:literal, $unit:literal, $kind:expr, $fixed:expr, control.$($field:ident).+, |$s:ident, $c:ident| $min:expr, $max:expr) => {
        Entry {
            name: $name,
            unit: $unit,
            kind: $kind,
            fixed: $fixed,
            field: |settings| match &mut settings.drive.control {
                Some(control) => Some(&mut control.$($field).+),
                None => None,
            },
            range: |$s, $c| {
                let _ = ($s, $c);
                ($min, $max)
            },
        }
    };
}

/// Whether a row is the board's.
const BOARD: bool = true;
const FREE: bool = false;

/// Rows, with what they are in words behind the name. The words are for people: they have a list of their own, which a chip
/// has no use for.
macro_rules! table {
    ($(row!($name:literal, $about:literal, $($row:tt)*)),+,) => {
        /// Every setting.
        pub static TABLE: &[Entry] = &[$(row!($name, $($row)*)),+];
        /// Names, and what they are.
        pub(super) static ABOUT: &[(&str, &str)] = &[$(($name, $about)),+];
    };
}

#[rustfmt::skip]
table! {
    row!("adc_bits", "resolution of the ADC", "bit", Whole, BOARD, drive.adc_bits, |s| 8.0, 16.0),
    row!("timer_hz", "clock of the PWM timer", "Hz", Real, BOARD, drive.timer_hz, |s| 1e6, 1e9),
    row!("pwm_hz", "switching frequency and rate of the control", "Hz", Real, BOARD, drive.pwm_hz, |s| 1e3, 200e3),
    row!("dead_time_s", "dead time of a leg", "s", Real, BOARD, drive.dead_time_s, |s| 0.0, 0.1 / s.pwm_hz),
    row!("sampling_window_s", "time for which sampling needs the lower transistors to conduct", "s", Real, BOARD, drive.sampling_window_s, |s| 0.0, 20e-6),
    row!("delay_periods", "from a sample to the middle of the PWM period that acts on it", "periods", Real, BOARD, drive.delay_periods, |s| 0.0, 16.0),
    row!("record_hz", "samples a second that reach the tasks", "Hz", Real, BOARD, drive.record_hz, |s| 1.0, s.pwm_hz / 2.0),
    row!("calibration_record_hz", "the same while calibrating", "Hz", Real, BOARD, drive.calibration_record_hz, |s| 1.0, s.pwm_hz),
    row!("pole_pairs", "pole pairs of the rotor", "", Whole, FREE, drive.pole_pairs, |s| 1.0, 64.0),
    row!("reversed", "count positive against the order of the phases A, B, C", "", Switch, FREE, drive.reversed, |s| 0.0, 1.0),
    row!("commutation", "how the phases are driven", "", Choice("block|sinusoidal|field-oriented"), FREE, drive.commutation, |s| 0.0, if s.control.is_some() { 2.0 } else { 1.0 }),
    row!("phase_advance_deg", "how far ahead of the quarter turn the field is set, electrical", "°", Real, FREE, drive.phase_advance_deg, |s| -60.0, 60.0),
    row!("max_modulation", "largest voltage command", "", Real, FREE, drive.max_modulation, |s| 0.0, 1.0),
    row!("tracking_bandwidth_hz", "natural frequency of the tracker, rounded to the next octave", "Hz", Real, FREE, drive.tracking_bandwidth_hz, |s| 5.0, 5000.0),
    row!("max_electrical_hz", "faster is a fault", "Hz", Real, FREE, drive.max_electrical_hz, |s| 1.0, s.pwm_hz / 20.0),
    row!("tolerated_samples", "successive samples without an angle that are bridged; one more is a fault", "", Whole, FREE, drive.tolerated_samples, |s| 0.0, 100.0),
    row!("run_on_two_halls", "a running drive that loses a Hall runs on until it is stopped", "", Switch, FREE, drive.run_on_two_halls, |s| 0.0, 1.0),
    row!("calibration_modulation", "voltage of the calibration's field", "", Real, FREE, drive.calibration_modulation, |s| 0.01, 0.5),
    row!("calibration_align_s", "time to raise the field, and again to let the rotor settle", "s", Real, FREE, drive.calibration_align_s, |s| 0.05, 10.0),
    row!("calibration_hz", "speed of the calibration's field, electrical", "Hz", Real, FREE, drive.calibration_hz, |s| 0.5, 50.0),
    row!("calibration_turns", "least electrical turns to calibrate by in each direction", "", Whole, FREE, drive.calibration_turns, |s| 2.0, 64.0),
    row!("adaptation", "learn the sensors while the motor turns", "", Switch, FREE, adaptation, |s| 0.0, 1.0),
    row!("anti_cogging", "balance the cogging, once it has been learnt", "", Switch, FREE, anti_cogging, |s| 0.0, 1.0),
    row!("current_full_scale_a", "current at the end of the ADC's range", "A", Real, BOARD, control.current_full_scale_a, |s, c| 0.1, 1000.0),
    row!("bus_full_scale_v", "bus voltage at the end of the ADC's range", "V", Real, BOARD, control.bus_full_scale_v, |s, c| 5.0, 1000.0),
    row!("resistance_ohm", "resistance of a phase, star", "Ω", Real, FREE, control.resistance_ohm, |s, c| 1e-3, 100.0),
    row!("inductance_h", "inductance of a phase, star", "H", Real, FREE, control.inductance_h, |s, c| 1e-6, 0.1),
    row!("flux_linkage_wb", "flux linkage of a phase: back-EMF per electrical rad/s", "Wb", Real, FREE, control.flux_linkage_wb, |s, c| 1e-5, 1.0),
    row!("inertia_kgm2", "inertia of all that turns", "kg·m²", Real, FREE, control.inertia_kgm2, |s, c| 1e-9, 1.0),
    row!("current_bandwidth_hz", "bandwidth of the current control", "Hz", Real, FREE, control.current_bandwidth_hz, |s, c| 10.0, s.pwm_hz / 20.0),
    row!("feedback", "current feedback with block and sinusoidal commutation", "", Choice("p|pi|pd|pid"), FREE, control.feedback, |s, c| 0.0, 3.0),
    row!("speed_bandwidth_hz", "bandwidth of the speed control", "Hz", Real, FREE, control.speed_bandwidth_hz, |s, c| 0.5, c.current_bandwidth_hz / 4.0),
    row!("position_bandwidth_hz", "bandwidth of the position control", "Hz", Real, FREE, control.position_bandwidth_hz, |s, c| 0.1, c.speed_bandwidth_hz / 2.0),
    row!("dead_time_ramp_a", "current below which the dead time acts in part only", "A", Real, FREE, control.dead_time_ramp_a, |s, c| 1e-3, c.current_full_scale_a),
    row!("max_current_a", "largest current", "A", Real, FREE, control.max_current_a, |s, c| 0.0, 0.9 * c.current_full_scale_a),
    row!("max_speed_rad_s", "largest speed of a command, mechanical", "rad/s", Real, FREE, control.max_speed_rad_s, |s, c| 0.1, TAU * s.max_electrical_hz / f32::from(s.pole_pairs)),
    row!("max_acceleration_rad_s2", "largest acceleration of a trajectory, mechanical", "rad/s²", Real, FREE, control.max_acceleration_rad_s2, |s, c| 1.0, 1e6),
    row!("under_voltage_v", "a lower bus voltage is a fault", "V", Real, FREE, control.guard.under_voltage_v, |s, c| c.bus_full_scale_v / 20.0, 0.9 * c.bus_full_scale_v),
    row!("over_voltage_v", "a higher bus voltage is a fault", "V", Real, FREE, control.guard.over_voltage_v, |s, c| c.guard.under_voltage_v, c.bus_full_scale_v),
    row!("over_current_a", "a larger phase current is a fault", "A", Real, FREE, control.guard.over_current_a, |s, c| 0.0, 0.99 * c.current_full_scale_a),
    row!("imbalance_a", "a larger sum of the phase currents is a fault", "A", Real, FREE, control.guard.imbalance_a, |s, c| 0.0, c.current_full_scale_a),
    row!("offset_a", "most that an amplifier may show while no current flows", "A", Real, FREE, control.guard.offset_a, |s, c| 0.0, c.current_full_scale_a),
    row!("stall_s", "at rest at the largest current for longer is a fault", "s", Real, FREE, control.guard.stall_s, |s, c| 0.01, 100.0),
    row!("command_timeout_s", "how long a command holds, up to 1000; inf: for ever", "s", Real, FREE, control.guard.command_timeout_s, |s, c| 1e-3, f32::INFINITY),
    row!("on_timeout", "what happens then", "", Choice("fault|stop"), FREE, control.guard.on_timeout, |s, c| 0.0, 1.0),
    row!("bridge_pull_up_ohm", "pull-up of the bridge's thermistor", "Ω", Real, BOARD, control.guard.bridge.pull_up_ohm, |s, c| 10.0, 1e7),
    row!("bridge_nominal_ohm", "the bridge's thermistor at 25 °C", "Ω", Real, BOARD, control.guard.bridge.nominal_ohm, |s, c| 10.0, 1e7),
    row!("bridge_beta_k", "B of the bridge's thermistor", "K", Real, BOARD, control.guard.bridge.beta_k, |s, c| 1e3, 1e4),
    row!("bridge_warn_c", "a hotter bridge gets less current", "°C", Real, FREE, control.guard.bridge.warn_c, |s, c| -40.0, c.guard.bridge.max_c - 1.0),
    row!("bridge_max_c", "a hotter bridge is a fault", "°C", Real, FREE, control.guard.bridge.max_c, |s, c| c.guard.bridge.warn_c + 1.0, 200.0),
    row!("motor_pull_up_ohm", "pull-up of the motor's thermistor", "Ω", Real, BOARD, control.guard.motor.pull_up_ohm, |s, c| 10.0, 1e7),
    row!("motor_nominal_ohm", "the motor's thermistor at 25 °C", "Ω", Real, FREE, control.guard.motor.nominal_ohm, |s, c| 10.0, 1e7),
    row!("motor_beta_k", "B of the motor's thermistor", "K", Real, FREE, control.guard.motor.beta_k, |s, c| 1e3, 1e4),
    row!("motor_warn_c", "a hotter motor gets less current", "°C", Real, FREE, control.guard.motor.warn_c, |s, c| -40.0, c.guard.motor.max_c - 1.0),
    row!("motor_max_c", "a hotter motor is a fault", "°C", Real, FREE, control.guard.motor.max_c, |s, c| c.guard.motor.warn_c + 1.0, 200.0),
}
