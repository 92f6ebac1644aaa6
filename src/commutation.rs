//! From the rotor's angle and a command to what the bridge's three legs do.
//!
//! The command is a modulation M from −1 to 1; its sign is the direction of the torque. Angles are electrical: zero is the axis of
//! phase A, and the field that pulls hardest stands a quarter turn ahead of the rotor, or behind it for a negative command.

pub mod block;
pub mod frames;
pub mod sinusoidal;
pub mod svpwm;

use fixed::types::I1F15;

/// A voltage command as a fraction of what the bridge can do without over-modulation: the amplitude of the phase
/// voltages is `M · V_bus / 2`.
pub type Modulation = I1F15;

/// A fraction as a [`Modulation`], the nearest there is; zero for what is not a number.
pub fn modulation(share: f32) -> Modulation {
    Modulation::from_bits(libm::roundf(share * 32_768.0) as i16)
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fraction_is_rounded_and_saturates() {
        for (fraction, bits) in [(0.5, 16_384), (-0.100_02, -3277), (1.0, 32_767), (-7.0, -32_768), (f32::NAN, 0)] {
            assert_eq!(modulation(fraction).to_bits(), bits, "{fraction}");
        }
    }
}
