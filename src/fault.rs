//! What switches the bridge off, and what only holds the drive back.

use crate::hall::Channel;
use crate::hall::plausibility::Implausible;
use core::fmt;

/// Latched: the bridge is off until a person or the application clears it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(into = "u8", try_from = "u8"))]
pub enum Fault {
    /// The Halls gave no angle for longer than tolerated.
    Hall(Implausible),
    /// The angle jumped farther from sample to sample than the motor can turn, for longer than tolerated.
    AngleJump,
    /// The rotor turns faster than `max_electrical_hz`.
    OverSpeed,
    /// The calibration failed; the service that ran it knows why.
    Calibration,
    /// The bus voltage is above `over_voltage_v`.
    OverVoltage,
    /// The bus voltage is below `under_voltage_v`.
    UnderVoltage,
    /// A phase current is beyond `over_current_a`.
    OverCurrent,
    /// The bridge is hotter than its `max_c`, or its thermistor shorted.
    BridgeHot,
    /// The motor is hotter than its `max_c`, or its thermistor shorted.
    MotorHot,
    /// The rotor does not turn though the current is at its limit.
    Stall,
    /// A current amplifier shows more than `offset_a` while no current flows.
    CurrentOffset,
    /// The three currents do not sum to zero.
    CurrentImbalance,
    /// No command came for `command_timeout_s`.
    CommandTimeout,
    /// Control periods passed without a step.
    Deadline,
    /// The absolute encoder gave no angle for longer than tolerated.
    Encoder,
    /// The Halls' turn counter and the absolute encoder disagree.
    Turns,
}

/// Those that have no parts, in the order of their codes.
const PLAIN: [Fault; 13] = [
    Fault::AngleJump,
    Fault::OverSpeed,
    Fault::Calibration,
    Fault::OverVoltage,
    Fault::UnderVoltage,
    Fault::OverCurrent,
    Fault::BridgeHot,
    Fault::MotorHot,
    Fault::Stall,
    Fault::CurrentOffset,
    Fault::CurrentImbalance,
    Fault::CommandTimeout,
    Fault::Deadline,
];

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
            Self::OverVoltage => 19,
            Self::UnderVoltage => 20,
            Self::OverCurrent => 21,
            Self::BridgeHot => 22,
            Self::MotorHot => 23,
            Self::Stall => 24,
            Self::CurrentOffset => 25,
            Self::CurrentImbalance => 26,
            Self::CommandTimeout => 27,
            Self::Deadline => 28,
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
            16..=28 => PLAIN[code as usize - 16],
            32 => Self::Encoder,
            33 => Self::Turns,
            _ => return None,
        })
    }
}

impl From<Fault> for u8 {
    fn from(fault: Fault) -> Self {
        fault.code()
    }
}

/// A code that stands for no fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UnknownCode(pub u8);

impl fmt::Display for UnknownCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no fault has the code {}", self.0)
    }
}

impl core::error::Error for UnknownCode {}

impl TryFrom<u8> for Fault {
    type Error = UnknownCode;

    fn try_from(code: u8) -> Result<Self, UnknownCode> {
        Self::from_code(code).ok_or(UnknownCode(code))
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hall(why) => why.fmt(f),
            Self::AngleJump => write!(f, "the angle jumps from sample to sample: a loose connection or interference"),
            Self::OverSpeed => write!(f, "the rotor turned faster than allowed"),
            Self::Calibration => write!(f, "the calibration failed"),
            Self::OverVoltage => write!(f, "the bus voltage is too high"),
            Self::UnderVoltage => write!(f, "the bus voltage is too low"),
            Self::OverCurrent => write!(f, "a phase current is too large"),
            Self::BridgeHot => write!(f, "the bridge is too hot, or its thermistor shorted"),
            Self::MotorHot => write!(f, "the motor is too hot, or its thermistor shorted"),
            Self::Stall => write!(f, "the rotor does not turn at the largest current"),
            Self::CurrentOffset => write!(f, "a current amplifier shows a current while none flows"),
            Self::CurrentImbalance => write!(f, "the phase currents do not sum to zero: an amplifier or its wiring"),
            Self::CommandTimeout => write!(f, "no command came for too long"),
            Self::Deadline => write!(f, "control periods passed without a step"),
            Self::Encoder => write!(f, "the absolute encoder gives no trustworthy angle"),
            Self::Turns => write!(f, "the Halls and the absolute encoder disagree"),
        }
    }
}

impl core::error::Error for Fault {}

/// Reported, still running: what holds the drive back at the moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
    /// The command asks for more current than allowed.
    pub const CURRENT: Self = Self(8);
    /// Bridge or motor is warm, and the largest current reduced.
    pub const HEAT: Self = Self(16);
    /// No command came for too long: the drive has stopped.
    pub const TIMEOUT: Self = Self(32);

    /// A bit each, in the order of their numbers: these stay the same from version to version.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Those of a number; bits that stand for none are ignored.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 63)
    }

    /// Whether all of `other` are active.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// With those of `other` if, and only if, they are `active`.
    #[must_use]
    pub const fn set(self, other: Self, active: bool) -> Self {
        if active { self.with(other) } else { self.without(other) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_its_faults() {
        let faults = [1..10, 16..29, 32..34];
        for code in 0..=u8::MAX {
            assert_eq!(
                Fault::from_code(code).map(Fault::code),
                faults.iter().any(|codes| codes.contains(&code)).then_some(code)
            );
        }
    }

    #[test]
    fn limits_are_their_bits() {
        let limits =
            [Limits::DUTY, Limits::EXTRAPOLATED, Limits::TWO_HALLS, Limits::CURRENT, Limits::HEAT, Limits::TIMEOUT];
        for (place, limit) in limits.into_iter().enumerate() {
            assert_eq!(limit.bits(), 1 << place);
        }
        let all = limits.into_iter().fold(Limits::NONE, Limits::with);
        assert_eq!((all.bits(), Limits::from_bits(u8::MAX)), (63, all));
    }
}
