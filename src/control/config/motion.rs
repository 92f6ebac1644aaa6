//! What the supervision of the motion asks for, in the units of the interrupt.

use super::Frame;
use crate::angle::TURN;
use crate::control::{Motor, Scale};
use crate::drive::{PARTS, SETTLING};
use crate::float::{whole, whole_i16, whole_u16};
use crate::schedule::{LONG, OUTER};
use crate::settings::{Control, OnStopFailure};
use core::f32::consts::TAU;

/// Currents and voltages in 2⁻¹⁵ of their full scales, speeds in 2⁻³² electrical turns a step, positions in those of
/// the outer loops, times in rounds of the supervision once the commutation is proven: a part in a [`LONG`] cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Motion {
    /// Sum of the currents, one every [`LONG`] cycle, that makes a torque plain.
    pub impulse: i32,
    /// Speed from which on the rotor counts as turning.
    pub turning_speed: i32,
    /// Farthest from the reference of a position, and of a speed.
    pub far: i64,
    pub far_speed: i32,
    /// Time that a speed may be far from its reference.
    pub late: u16,
    /// Least and largest position.
    pub bounds: [i64; 2],
    /// Eight steps of the outer loops each in which a rotor goes on before it brakes: from one look at its position to the
    /// next, and what the speed loop lags by.
    pub reserve: u8,
    /// Time to come to rest after a stop, and whether it is braked then.
    pub stop: u16,
    pub brakes: bool,
    /// Largest current while a position is held.
    pub hold: i16,
    pub model: Model,
}

/// The motor as the check of voltages against currents has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Model {
    /// Voltage per current, in 2⁻¹⁶.
    pub resistance: i32,
    /// Voltage per current that changes in the time that it has to settle, in 2⁻¹⁶.
    pub change: i32,
    /// Voltage per current that does not flow yet, in 2⁻¹⁶: that of the proportional control.
    pub proportional: i32,
    /// Voltage per current and speed: 2⁻¹⁶ by the product with a speed over 2³². That of the current along q: where the one
    /// along d is large, it is against the field, and what is too much for it looks like more back-EMF.
    pub reactance: i32,
    /// Voltage per speed, by the product over 2³².
    pub flux: i32,
    /// Voltage that the dead time and the noise explain.
    pub dead: i32,
    /// The same by the voltage that the bus has, in 2⁻¹⁶.
    pub dead_of_bus: i32,
    /// Sum of unexplained voltages that is a fault.
    pub most: i32,
}

/// That of the looks: every 512 steps for a spring, every 256 for a speed.
const LOOK: f32 = (LONG / OUTER) as f32;

/// Steps of a round.
const ROUND: u32 = PARTS as u32 * LONG;
/// Time in which an unexplained voltage of a tenth of the bus's full scale is a fault, s.
const MISFIT_S: f32 = 0.02;

impl Motion {
    /// Makes it of settings that are in their ranges.
    pub fn fill(&mut self, settings: &Control, frame: &Frame, motor: &Motor, scale: &Scale) {
        let checks = |seconds: f32| whole_u16((seconds * scale.step_hz / ROUND as f32).max(1.0));
        let turns = scale.pole_pairs * TURN;
        // Each to its place: a whole one would be made on the stack.
        let Self { impulse, turning_speed, far, far_speed, late, bounds, reserve, stop, brakes, hold, model } = self;
        *impulse = (0.1 * settings.max_current_a * scale.per_ampere()).max(128.0) as i32;
        *turning_speed = (3.0 / scale.step_hz * TURN) as i32;
        *far = whole(settings.following_error_turns * turns / OUTER as f32);
        *far_speed = (settings.following_error_rad_s * scale.per_radian_s()).min(1_073_741_824.0) as i32;
        *late = checks(settings.guard.stall_s);
        bounds[0] = bound(settings.min_position_turns, turns);
        bounds[1] = bound(settings.max_position_turns, turns);
        *reserve = (LOOK + scale.step_hz / (8 * OUTER) as f32 / (TAU * settings.speed_bandwidth_hz)) as u8;
        *stop = checks(settings.guard.stop_s);
        *brakes = settings.guard.if_stop_fails == OnStopFailure::Brake;
        *hold = whole_i16(settings.hold_current_a * scale.per_ampere());
        model.fill(frame, settings.current_bandwidth_hz, motor, scale);
    }
}

#[inline(never)]
fn bound(limit: f32, turns: f32) -> i64 {
    // The ends of the range are none: four times what a position can be, so that nothing ends where its count does.
    if limit.abs() >= 1e6 { whole(limit * f32::MAX) >> 1 } else { whole(limit * turns) >> OUTER.ilog2() }
}

/// A positive number of up to 30 bits.
#[inline(never)]
fn fixed(value: f32) -> i32 {
    (value as i32).clamp(1, 1 << 30)
}

impl Model {
    fn fill(&mut self, frame: &Frame, current_hz: f32, motor: &Motor, scale: &Scale) {
        let per_current = scale.amperes / scale.volts * 65_536.0;
        let check_s = ROUND as f32 / scale.step_hz;
        let radians_s = TAU * scale.step_hz;
        let [along_d, along_q] = motor.inductances_h();
        let largest_h = along_d.max(along_q);
        let Self { resistance, change, proportional, reactance, flux, dead, dead_of_bus, most } = self;
        *resistance = fixed(motor.resistance_ohm * per_current);
        *change = fixed(largest_h * scale.step_hz / SETTLING as f32 * per_current);
        *proportional = fixed(TAU * current_hz * largest_h * per_current);
        *reactance = fixed(along_q * radians_s * per_current);
        *flux = fixed(motor.flux_linkage_wb * radians_s / scale.volts * 32_768.0);
        *dead = fixed((2.0 * frame.dead_time_s * frame.pwm_hz + 0.01) * 32_768.0);
        *dead_of_bus = fixed((frame.dead_time_s * frame.pwm_hz + 0.01) * 65_536.0);
        *most = fixed(0.1 * 32_768.0 * MISFIT_S / check_s);
    }
}
