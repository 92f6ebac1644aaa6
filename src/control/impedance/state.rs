//! What the reference does and how far the rotor is from it, in SI.

use crate::control::config::Config as Control;
use crate::double;
use crate::schedule::OUTER;
use crate::telemetry::Measurement;

/// The reference of an outer loop, and the rotor's distance from it. With a position or a speed commanded, too.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct State {
    /// Reference of the position, mechanical turns as the drive counts them.
    pub position_turns: f64,
    /// Reference of the speed, rad/s.
    pub speed_rad_s: f32,
    /// Torque that is asked for along q, N·m, within all limits; with the anti-cogging current.
    pub torque_nm: f32,
    /// Reference less the rotor's position, turns.
    pub position_error_turns: f32,
    /// Reference less the rotor's speed, rad/s.
    pub speed_error_rad_s: f32,
    /// What is asked for less the torque of the measured current, N·m.
    pub torque_error_nm: f32,
    /// Whether the reference has come to rest, or to its speed, where it was commanded to.
    pub complete: bool,
}

impl Measurement {
    /// The reference and the distance from it.
    pub fn reference(&self, control: &Control) -> State {
        let scale = &control.scale;
        let torque = |current: f32| current / scale.per_ampere() * control.motor.torque_constant(scale.pole_pairs);
        let pole_pairs = (scale.pole_pairs as i64).max(1);
        let error = i64::from(self.reference.ahead) << OUTER.ilog2();
        let position = self.rotor.position().to_bits().wrapping_add(error);
        State {
            position_turns: double::from_fixed(position / pole_pairs),
            speed_rad_s: self.reference.speed as f32 / scale.per_radian_s(),
            torque_nm: torque(self.state.current_reference as f32),
            position_error_turns: error as f32 / crate::angle::TURN / scale.pole_pairs,
            speed_error_rad_s: self.reference.speed.wrapping_sub(self.rotor.speed()) as f32 / scale.per_radian_s(),
            torque_error_nm: torque((self.state.current_reference - self.state.current.q) as f32),
            complete: self.reference.complete,
        }
    }
}
