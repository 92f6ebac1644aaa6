//! What switches the bridge off, and what only holds the drive back.

use crate::hall::Channel;
use crate::hall::normalize::Implausible;
use core::fmt;

/// Latched: the bridge is off until a person or the application clears it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The Halls gave no angle for longer than tolerated.
    Hall(Implausible),
    /// The angle jumped farther from sample to sample than the motor can turn, for longer than tolerated.
    AngleJump,
    /// The rotor turns faster than `max_electrical_hz`.
    OverSpeed,
    /// The calibration failed; the service that ran it knows why.
    Calibration,
    /// The absolute encoder gave no angle for longer than tolerated.
    Encoder,
    /// The Halls' turn counter and the absolute encoder disagree.
    Turns,
}

impl Fault {
    /// A number that stays the same from version to version: 1 to 3 a Hall at a rail, 4 to 6 one out of range, 7 to 9 the Halls
    /// together, 16 and above the rest.
    pub const fn code(self) -> u8 {
        match self {
            Self::Hall(Implausible::AtRail(Channel(channel))) => 1 + channel % 3,
            Self::Hall(Implausible::OutOfRange(Channel(channel))) => 4 + channel % 3,
            Self::Hall(Implausible::Inconsistent) => 7,
            Self::Hall(Implausible::Weak) => 8,
            Self::Hall(Implausible::Strong) => 9,
            Self::AngleJump => 16,
            Self::OverSpeed => 17,
            Self::Calibration => 18,
            Self::Encoder => 32,
            Self::Turns => 33,
        }
    }

    /// The fault with a number, if there is one.
    pub const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            1..=3 => Self::Hall(Implausible::AtRail(Channel(code - 1))),
            4..=6 => Self::Hall(Implausible::OutOfRange(Channel(code - 4))),
            7 => Self::Hall(Implausible::Inconsistent),
            8 => Self::Hall(Implausible::Weak),
            9 => Self::Hall(Implausible::Strong),
            16 => Self::AngleJump,
            17 => Self::OverSpeed,
            18 => Self::Calibration,
            32 => Self::Encoder,
            33 => Self::Turns,
            _ => return None,
        })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hall(why) => why.fmt(f),
            Self::AngleJump => write!(f, "the angle jumps from sample to sample: a loose connection or interference"),
            Self::OverSpeed => write!(f, "the rotor turned faster than allowed"),
            Self::Calibration => write!(f, "the calibration failed"),
            Self::Encoder => write!(f, "the absolute encoder gives no trustworthy angle"),
            Self::Turns => write!(f, "the Halls and the absolute encoder disagree"),
        }
    }
}

impl core::error::Error for Fault {}

/// Reported, still running: what holds the drive back at the moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits(u8);

impl Limits {
    /// Nothing.
    pub const NONE: Self = Self(0);
    /// The command asks for more than the duty limit allows.
    pub const DUTY: Self = Self(1);
    /// The last sample was implausible and the angle is extrapolated.
    pub const EXTRAPOLATED: Self = Self(2);
    /// A Hall is lost and the angle comes from the other two: to be stopped, and not armed again.
    pub const TWO_HALLS: Self = Self(4);

    /// Whether all of `other` are active.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Without those of `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}
