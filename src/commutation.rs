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

/// Which legs of the bridge switch; the others are open, both transistors off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Legs(u8);

impl Legs {
    /// The bridge is off.
    pub const NONE: Self = Self(0);
    /// All three switch.
    pub const ALL: Self = Self(7);

    /// All but one, 0 to 2; any other number is none to leave out.
    pub const fn without(leg: u8) -> Self {
        Self(if leg < 3 { 7 & !(1 << leg) } else { 7 })
    }

    /// Whether a leg, 0 to 2, switches.
    pub const fn contains(self, leg: u8) -> bool {
        leg < 3 && self.0 >> leg & 1 != 0
    }

    /// Bit 0 is phase A.
    pub const fn bits(self) -> u8 {
        self.0
    }
}

/// What the board writes to the timer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output {
    /// Compare values of phases A, B and C in timer counts: the leg's upper transistor conducts for `compare` of the
    /// `period` counts of a half cycle.
    pub compare: [u16; 3],
    /// Which legs switch at all; [`Legs::NONE`] turns the bridge off at once.
    pub legs: Legs,
}

impl Output {
    /// The bridge is off.
    pub const OFF: Self = Self { compare: [0; 3], legs: Legs::NONE };

    /// In two words, which functions return in registers.
    #[inline(always)]
    pub(crate) const fn pack(self) -> u64 {
        let [a, b, c] = self.compare;
        a as u64 | (b as u64) << 16 | (c as u64) << 32 | (self.legs.0 as u64) << 48
    }

    /// From what [`Self::pack`] has made.
    #[inline(always)]
    pub(crate) const fn unpack(bits: u64) -> Self {
        Self { compare: [bits as u16, (bits >> 16) as u16, (bits >> 32) as u16], legs: Legs((bits >> 48) as u8) }
    }
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
