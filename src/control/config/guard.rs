//! Thresholds of the faults in the units of the interrupt.

use crate::control::{Motor, Scale};
use crate::schedule::LONG;
use crate::settings::{Control, OnTimeout, Thermistor};

/// Sum of the currents over the largest by the amplifiers' gains:
/// [`GuardSettings::for_full_scale`](crate::settings::GuardSettings::for_full_scale).
const GAINS: f32 = 0.04;

/// Thresholds of a temperature, and the derating of the current above its warning, in codes of 16 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Heat {
    /// Code below which the thermistor is shorted: that of 250 °C.
    pub shorted: i32,
    /// Code above which it is open: that of −40 °C, and always one that an open input shows.
    pub open: i32,
    /// Code below which it is too hot.
    pub fault: i32,
    /// Codes from there to the warning, above which the current is not reduced.
    pub room: i32,
    /// Share of the current per code, in 2⁻²⁴.
    pub slope: i32,
}

/// Thresholds in the units of the interrupt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Guard {
    /// Least bus voltage and the range above it, in codes.
    pub under: u32,
    pub range: u32,
    /// Largest current of a phase, in codes from its zero.
    pub over_current: u32,
    /// Largest sum of the three currents, in codes from that of their zeros.
    pub imbalance: u32,
    /// Largest distance of an amplifier's zero from the middle of the range, in 2⁻¹⁵ of the full scale.
    pub offset: i32,
    /// Of bridge and motor.
    pub heat: [Heat; 2],
    /// Time at rest with the largest current until a stall is a fault, in [`LONG`]s.
    pub stall: u32,
    /// Command time-out in steps of the outer loops.
    pub timeout: u32,
    /// Whether the time-out stops the motor by the speed loop instead of being a fault.
    pub stops: bool,
    /// Speed below which the rotor is at rest for the stall, in 2⁻³² electrical turns a step: 1 rad/s mechanical, or what
    /// the largest current gives the inertia in an eighth of `stall_s`, for a heavy rotor reverses slowly.
    pub rest_speed: i32,
}

impl Heat {
    fn new(thermistor: &Thermistor, adc_bits: u8) -> Self {
        // An open input is within two codes of the end of the range.
        let end = 65_536.0 - 3.0 * (1_u32 << (16 - adc_bits)) as f32;
        let (fault, warn) = (thermistor.code(thermistor.max_c), thermistor.code(thermistor.warn_c));
        let room = (warn - fault).max(1.0);
        Self {
            shorted: thermistor.code(250.0).min(fault) as i32,
            open: thermistor.code(-40.0).min(end) as i32,
            fault: fault as i32,
            room: room as i32,
            slope: (16_777_216.0 / room) as i32,
        }
    }
}

/// A speed that its noise does not hide.
const SLOWEST_REST_RAD_S: f32 = 0.12;

impl Guard {
    /// Of settings that are in their ranges.
    pub fn new(control: &Control, adc_bits: u8, loop_hz: f32, scale: &Scale, motor: &Motor) -> Self {
        let settings = &control.guard;
        let fastest_rad_s2 = control.max_current_a * motor.torque_constant(scale.pole_pairs) / motor.inertia_kgm2;
        let rest_rad_s = (settings.stall_s * fastest_rad_s2 / 8.0).clamp(SLOWEST_REST_RAD_S, 1.0);
        let codes = (1_u32 << adc_bits) as f32;
        let per_volt = codes / scale.volts;
        let per_ampere = codes / 2.0 / scale.amperes;
        Self {
            under: crate::float::ceil(settings.under_voltage_v * per_volt) as u32,
            range: ((settings.over_voltage_v - settings.under_voltage_v) * per_volt) as u32,
            over_current: (settings.over_current_a * per_ampere) as u32,
            imbalance: ((settings.imbalance_a + GAINS * control.max_current_a) * per_ampere) as u32,
            offset: (settings.offset_a * scale.per_ampere()) as i32,
            heat: [Heat::new(&settings.bridge, adc_bits), Heat::new(&settings.motor, adc_bits)],
            stall: (settings.stall_s * scale.step_hz / LONG as f32) as u32,
            timeout: crate::float::ceil(settings.command_timeout_s * loop_hz) as u32,
            stops: settings.on_timeout == OnTimeout::Stop,
            rest_speed: (rest_rad_s * scale.per_radian_s()) as i32,
        }
    }
}
