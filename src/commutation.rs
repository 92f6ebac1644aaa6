//! From the rotor's angle and a command to what the bridge's three legs do.
//!
//! The command is a modulation M from −1 to 1; its sign is the direction of the torque. Angles are electrical: zero is
//! the axis of phase A, and the field that pulls hardest stands a quarter turn ahead of the rotor, or behind it for a
//! negative command.

pub mod block;
pub mod frames;
pub mod sinusoidal;
pub mod svpwm;

pub use crate::pwm::{Modulation, modulation};

/// How the phases are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Commutation {
    /// Six steps a turn, two phases at a time. Simpkins and Todorov, section III.A.
    Block,
    /// Three sines. Simpkins and Todorov, section III.B.
    #[default]
    Sinusoidal,
    /// Currents controlled in the frame of the rotor, with space-vector modulation.
    FieldOriented,
}
