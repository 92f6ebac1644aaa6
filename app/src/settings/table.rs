//! The table. A name that has been in a release is never given to another setting.

use super::{Entry, Value};
use core::f32::consts::TAU;
use hallservo_protocol::Kind::{Choice, Real, Switch, Whole};

/// A row: name, unit, kind, whether it is the board's; the field; its range, with the settings as `s` and those of the control
/// as `c`; what it is.
macro_rules! row {
    ($name:literal, $unit:literal, $kind:expr, $fixed:expr, $($field:ident).+, |$s:ident| $min:expr, $max:expr, $about:literal) => {
        Entry {
            name: $name,
            unit: $unit,
            about: $about,
            kind: $kind,
            fixed: $fixed,
            get: |settings| Some(settings.$($field).+.number()),
            set: |settings, value| settings.$($field).+.assign(value),
            range: |settings| {
                let $s = &settings.drive;
                let _ = $s;
                ($min, $max)
            },
        }
    };
    ($name:literal, $unit:literal, $kind:expr, $fixed:expr, control.$($field:ident).+, |$s:ident, $c:ident| $min:expr, $max:expr, $about:literal) => {
        Entry {
            name: $name,
            unit: $unit,
            about: $about,
            kind: $kind,
            fixed: $fixed,
            get: |settings| settings.drive.control.as_ref().map(|control| control.$($field).+.number()),
            set: |settings, value| {
                if let Some(control) = &mut settings.drive.control {
                    control.$($field).+.assign(value);
                }
            },
            range: |settings| {
                let ($s, $c) = (&settings.drive, settings.drive.control.unwrap_or_default());
                let _ = ($s, $c);
                ($min, $max)
            },
        }
    };
}

/// Whether a row is the board's.
const BOARD: bool = true;
const FREE: bool = false;

/// Every setting.
#[rustfmt::skip]
pub const TABLE: &[Entry] = &[
    row!("adc_bits", "bit", Whole, BOARD, drive.adc_bits, |s| 8.0, 16.0, "resolution of the ADC"),
    row!("timer_hz", "Hz", Real, BOARD, drive.timer_hz, |s| 1e6, 1e9, "clock of the PWM timer"),
    row!("pwm_hz", "Hz", Real, BOARD, drive.pwm_hz, |s| 1e3, 200e3, "switching frequency and rate of the control"),
    row!("dead_time_s", "s", Real, BOARD, drive.dead_time_s, |s| 0.0, 0.1 / s.pwm_hz, "dead time of a leg"),
    row!("sampling_window_s", "s", Real, BOARD, drive.sampling_window_s, |s| 0.0, 20e-6, "time for which sampling needs the lower transistors to conduct"),
    row!("delay_periods", "periods", Real, BOARD, drive.delay_periods, |s| 0.0, 16.0, "from a sample to the middle of the PWM period that acts on it"),
    row!("record_hz", "Hz", Real, BOARD, drive.record_hz, |s| 1.0, s.pwm_hz / 2.0, "samples a second that reach the tasks"),
    row!("calibration_record_hz", "Hz", Real, BOARD, drive.calibration_record_hz, |s| 1.0, s.pwm_hz, "the same while calibrating"),
    row!("pole_pairs", "", Whole, FREE, drive.pole_pairs, |s| 1.0, 64.0, "pole pairs of the rotor"),
    row!("reversed", "", Switch, FREE, drive.reversed, |s| 0.0, 1.0, "count positive against the order of the phases A, B, C"),
    row!("commutation", "", Choice("block|sinusoidal|field-oriented"), FREE, drive.commutation, |s| 0.0, if s.control.is_some() { 2.0 } else { 1.0 }, "how the phases are driven"),
    row!("phase_advance_deg", "°", Real, FREE, drive.phase_advance_deg, |s| -60.0, 60.0, "how far ahead of the quarter turn the field is set, electrical"),
    row!("max_modulation", "", Real, FREE, drive.max_modulation, |s| 0.0, 1.0, "largest voltage command"),
    row!("tracking_bandwidth_hz", "Hz", Real, FREE, drive.tracking_bandwidth_hz, |s| 5.0, 5000.0, "natural frequency of the tracker, rounded to the next octave"),
    row!("max_electrical_hz", "Hz", Real, FREE, drive.max_electrical_hz, |s| 1.0, s.pwm_hz / 20.0, "faster is a fault"),
    row!("tolerated_samples", "", Whole, FREE, drive.tolerated_samples, |s| 0.0, 100.0, "successive samples without an angle that are bridged; one more is a fault"),
    row!("run_on_two_halls", "", Switch, FREE, drive.run_on_two_halls, |s| 0.0, 1.0, "a running drive that loses a Hall runs on until it is stopped"),
    row!("calibration_modulation", "", Real, FREE, drive.calibration_modulation, |s| 0.01, 0.5, "voltage of the calibration's field"),
    row!("calibration_align_s", "s", Real, FREE, drive.calibration_align_s, |s| 0.05, 10.0, "time to raise the field, and again to let the rotor settle"),
    row!("calibration_hz", "Hz", Real, FREE, drive.calibration_hz, |s| 0.5, 50.0, "speed of the calibration's field, electrical"),
    row!("calibration_turns", "", Whole, FREE, drive.calibration_turns, |s| 2.0, 64.0, "least electrical turns to calibrate by in each direction"),
    row!("adaptation", "", Switch, FREE, adaptation, |s| 0.0, 1.0, "learn the sensors while the motor turns"),
    row!("anti_cogging", "", Switch, FREE, anti_cogging, |s| 0.0, 1.0, "balance the cogging, once it has been learnt"),
    row!("current_full_scale_a", "A", Real, BOARD, control.current_full_scale_a, |s, c| 0.1, 1000.0, "current at the end of the ADC's range"),
    row!("bus_full_scale_v", "V", Real, BOARD, control.bus_full_scale_v, |s, c| 5.0, 1000.0, "bus voltage at the end of the ADC's range"),
    row!("resistance_ohm", "Ω", Real, FREE, control.resistance_ohm, |s, c| 1e-3, 100.0, "resistance of a phase, star"),
    row!("inductance_h", "H", Real, FREE, control.inductance_h, |s, c| 1e-6, 0.1, "inductance of a phase, star"),
    row!("flux_linkage_wb", "Wb", Real, FREE, control.flux_linkage_wb, |s, c| 1e-5, 1.0, "flux linkage of a phase: back-EMF per electrical rad/s"),
    row!("inertia_kgm2", "kg·m²", Real, FREE, control.inertia_kgm2, |s, c| 1e-9, 1.0, "inertia of all that turns"),
    row!("current_bandwidth_hz", "Hz", Real, FREE, control.current_bandwidth_hz, |s, c| 10.0, s.pwm_hz / 20.0, "bandwidth of the current control"),
    row!("feedback", "", Choice("p|pi|pd|pid"), FREE, control.feedback, |s, c| 0.0, 3.0, "current feedback with block and sinusoidal commutation"),
    row!("speed_bandwidth_hz", "Hz", Real, FREE, control.speed_bandwidth_hz, |s, c| 0.5, c.current_bandwidth_hz / 4.0, "bandwidth of the speed control"),
    row!("position_bandwidth_hz", "Hz", Real, FREE, control.position_bandwidth_hz, |s, c| 0.1, c.speed_bandwidth_hz / 2.0, "bandwidth of the position control"),
    row!("dead_time_ramp_a", "A", Real, FREE, control.dead_time_ramp_a, |s, c| 1e-3, c.current_full_scale_a, "current below which the dead time acts in part only"),
    row!("max_current_a", "A", Real, FREE, control.max_current_a, |s, c| 0.0, 0.9 * c.current_full_scale_a, "largest current"),
    row!("max_speed_rad_s", "rad/s", Real, FREE, control.max_speed_rad_s, |s, c| 0.1, TAU * s.max_electrical_hz / f32::from(s.pole_pairs), "largest speed of a command, mechanical"),
    row!("max_acceleration_rad_s2", "rad/s²", Real, FREE, control.max_acceleration_rad_s2, |s, c| 1.0, 1e6, "largest acceleration of a trajectory, mechanical"),
    row!("under_voltage_v", "V", Real, FREE, control.guard.under_voltage_v, |s, c| c.bus_full_scale_v / 20.0, 0.9 * c.bus_full_scale_v, "a lower bus voltage is a fault"),
    row!("over_voltage_v", "V", Real, FREE, control.guard.over_voltage_v, |s, c| c.guard.under_voltage_v, c.bus_full_scale_v, "a higher bus voltage is a fault"),
    row!("over_current_a", "A", Real, FREE, control.guard.over_current_a, |s, c| 0.0, 0.99 * c.current_full_scale_a, "a larger phase current is a fault"),
    row!("imbalance_a", "A", Real, FREE, control.guard.imbalance_a, |s, c| 0.0, c.current_full_scale_a, "a larger sum of the phase currents is a fault"),
    row!("offset_a", "A", Real, FREE, control.guard.offset_a, |s, c| 0.0, c.current_full_scale_a, "most that an amplifier may show while no current flows"),
    row!("stall_s", "s", Real, FREE, control.guard.stall_s, |s, c| 0.01, 100.0, "at rest at the largest current for longer is a fault"),
    row!("command_timeout_s", "s", Real, FREE, control.guard.command_timeout_s, |s, c| 1e-3, f32::INFINITY, "how long a command holds, up to 1000; inf: for ever"),
    row!("on_timeout", "", Choice("fault|stop"), FREE, control.guard.on_timeout, |s, c| 0.0, 1.0, "what happens then"),
    row!("bridge_pull_up_ohm", "Ω", Real, BOARD, control.guard.bridge.pull_up_ohm, |s, c| 10.0, 1e7, "pull-up of the bridge's thermistor"),
    row!("bridge_nominal_ohm", "Ω", Real, BOARD, control.guard.bridge.nominal_ohm, |s, c| 10.0, 1e7, "the bridge's thermistor at 25 °C"),
    row!("bridge_beta_k", "K", Real, BOARD, control.guard.bridge.beta_k, |s, c| 1e3, 1e4, "B of the bridge's thermistor"),
    row!("bridge_warn_c", "°C", Real, FREE, control.guard.bridge.warn_c, |s, c| -40.0, c.guard.bridge.max_c - 1.0, "a hotter bridge gets less current"),
    row!("bridge_max_c", "°C", Real, FREE, control.guard.bridge.max_c, |s, c| c.guard.bridge.warn_c + 1.0, 200.0, "a hotter bridge is a fault"),
    row!("motor_pull_up_ohm", "Ω", Real, BOARD, control.guard.motor.pull_up_ohm, |s, c| 10.0, 1e7, "pull-up of the motor's thermistor"),
    row!("motor_nominal_ohm", "Ω", Real, FREE, control.guard.motor.nominal_ohm, |s, c| 10.0, 1e7, "the motor's thermistor at 25 °C"),
    row!("motor_beta_k", "K", Real, FREE, control.guard.motor.beta_k, |s, c| 1e3, 1e4, "B of the motor's thermistor"),
    row!("motor_warn_c", "°C", Real, FREE, control.guard.motor.warn_c, |s, c| -40.0, c.guard.motor.max_c - 1.0, "a hotter motor gets less current"),
    row!("motor_max_c", "°C", Real, FREE, control.guard.motor.max_c, |s, c| c.guard.motor.warn_c + 1.0, 200.0, "a hotter motor is a fault"),
];
