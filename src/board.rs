//! The board contract: what a port gives to the control interrupt, and what it gets.

use crate::hall::Codes;

/// What the ADCs delivered at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// The three Halls.
    pub halls: Codes,
    /// The phase currents; only a drive with [`control`](crate::control) looks at these and at the following.
    pub currents: Codes,
    /// The bus voltage.
    pub bus: u16,
    /// The thermistors of bridge and motor.
    pub temperatures: [u16; 2],
    /// Control periods that passed without a step since the last, by the board's count.
    pub lost: u8,
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
