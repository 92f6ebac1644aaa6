//! What the reference does and how far the rotor is from it, in SI.

use super::Spring;
use crate::angle::{Position, TURN};
use crate::control::config::Config as Control;
use crate::double;
use crate::float::whole;
use crate::telemetry::{Measurement, Reference};

/// The reference of the spring and the damper, and the rotor's distance from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct State {
    /// Reference of the position, mechanical turns; within a range: the rotor's.
    pub position_turns: f64,
    /// Reference of the speed, rad/s.
    pub speed_rad_s: f32,
    /// Torque that is asked for, N·m, within all limits; with the anti-cogging current.
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

impl Reference {
    /// In SI, for the rotor and the currents of a measurement; positions count from an origin.
    pub fn state(&self, measurement: &Measurement, control: &Control, origin: Position) -> State {
        let scale = &control.scale;
        let torque =
            |current: i32| current as f32 / scale.per_ampere() * control.motor.torque_constant(scale.pole_pairs);
        let Measurement { rotor, state, .. } = measurement;
        let electrical = Spring::turns(self.strain);
        let position = rotor.position().to_bits().wrapping_add(whole(electrical * TURN)).wrapping_sub(origin.to_bits());
        State {
            position_turns: double::from_fixed(position / scale.whole_pole_pairs().max(1)),
            speed_rad_s: self.speed as f32 / scale.per_radian_s(),
            torque_nm: torque(state.current_reference),
            position_error_turns: electrical / scale.pole_pairs,
            speed_error_rad_s: self.speed.wrapping_sub(rotor.speed()) as f32 / scale.per_radian_s(),
            torque_error_nm: torque(state.current_reference - state.current.q),
            complete: self.complete,
        }
    }
}
