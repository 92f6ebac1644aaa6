//! What switches the bridge off, and what only holds the drive back.

use crate::hall::Channel;
use crate::hall::plausibility::Implausible;
use core::fmt;

/// The faults, from the table below. A row: documentation, `variant = number, what it says, what to do about it`. A
/// number that has been in a release is never given to another fault. A Hall's fault has parts, which [`hall_code`]
/// numbers.
macro_rules! faults {
    ($($(#[$meta:meta])* $variant:ident = $code:literal, $sentence:literal, $advice:literal;)*) => {
        /// Latched: the bridge is off until a person or the application clears it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "serde", serde(into = "u8", try_from = "u8"))]
        pub enum Fault {
            /// The Halls gave no angle for longer than tolerated.
            Hall(Implausible),
            $($(#[$meta])* $variant,)*
        }

        impl Fault {
            /// A number that stays the same from version to version: 1 to 3 a Hall at a rail, 4 to 6 one out of range,
            /// 7 to 9 the Halls together, 16 and above the rest.
            pub const fn code(self) -> u8 {
                match self {
                    Self::Hall(why) => hall_code(why),
                    _ => self.other_code(),
                }
            }

            /// That of any but a Hall's: apart, so that it is one table.
            #[inline(never)]
            const fn other_code(self) -> u8 {
                match self {
                    Self::Hall(_) => 0,
                    $(Self::$variant => $code,)*
                }
            }

            /// The fault with a number, if there is one.
            pub const fn from_code(code: u8) -> Option<Self> {
                match code {
                    $($code => Some(Self::$variant),)*
                    _ => match hall_from_code(code) {
                        Some(why) => Some(Self::Hall(why)),
                        None => None,
                    },
                }
            }

            /// What a person does about it, with the tool `hallctl`.
            pub const fn advice(self) -> &'static str {
                match self {
                    Self::Hall(Implausible::AtRail(_) | Implausible::OutOfRange(_)) => {
                        "check that Hall's supply, wire and distance to the magnet"
                    }
                    Self::Hall(_) => {
                        "check the Halls' supply, their wires (are two swapped?) and the distance to the magnet"
                    }
                    $(Self::$variant => $advice,)*
                }
            }
        }

        impl fmt::Display for Fault {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    Self::Hall(why) => why.fmt(f),
                    $(Self::$variant => f.write_str($sentence),)*
                }
            }
        }
    };
}

faults! {
    /// The angle jumped farther from sample to sample than the motor can turn, for longer than tolerated.
    AngleJump = 16,
        "the angle jumps from sample to sample: a loose connection or interference",
        "look for a loose connector and for motor wires beside those of the Halls";
    /// The rotor turns faster than `max_electrical_hz`, or by a fifth faster than `max_speed_rad_s`.
    OverSpeed = 17,
        "the rotor turned faster than allowed",
        "lower the command; if the motor may turn so fast, raise max_speed_rad_s (the limit is a fifth above it) or \
         max_electrical_hz, whichever is lower";
    /// The calibration failed; the service that ran it knows why.
    Calibration = 18,
        "the calibration failed",
        "mend what the calibration named";
    /// The bus voltage is above `over_voltage_v`.
    OverVoltage = 19,
        "the bus voltage is too high",
        "braking feeds the supply: set max_regeneration_a to what it takes back (0: nothing), add a capacitor or a brake \
         resistor, or use field-oriented commutation; wait until the bus is down";
    /// The bus voltage is below `under_voltage_v`.
    UnderVoltage = 20,
        "the bus voltage is too low",
        "check the supply and its current limit; under_voltage_v is the threshold";
    /// A phase current is beyond `over_current_a`.
    OverCurrent = 21,
        "a phase current is too large",
        "check for a short; a wrong resistance_ohm or inductance_h makes the current control overshoot";
    /// The bridge is hotter than its `max_c`.
    BridgeHot = 22,
        "the bridge is too hot",
        "let it cool, improve the cooling, or lower max_current_a";
    /// The motor is hotter than its `max_c`.
    MotorHot = 23,
        "the motor is too hot",
        "let it cool, lower the load or max_current_a";
    /// The rotor does not turn though the current is at its limit.
    Stall = 24,
        "the rotor does not turn at the largest current",
        "free the shaft, or raise max_current_a, max_supply_a or stall_s";
    /// A current amplifier shows more than `offset_a` while no current flows.
    CurrentOffset = 25,
        "a current amplifier shows a current while none flows",
        "check the current amplifiers and their reference; offset_a is the threshold";
    /// The three currents do not sum to zero.
    CurrentImbalance = 26,
        "the phase currents do not sum to zero: an amplifier or its wiring",
        "check the shunts, the amplifiers and the motor's insulation";
    /// No command came for `command_timeout_s`.
    CommandTimeout = 27,
        "no command came for too long",
        "keep hallctl running while the motor is to turn, or raise command_timeout_s";
    /// Control periods passed without a step.
    Deadline = 28,
        "control periods passed without a step",
        "the control interrupt was late: report it, with the firmware's version";
    /// The rotor moves against the torque that the drive applies, or its back-EMF is not where the Halls say: motor wires,
    /// Halls or calibration do not belong together, or no longer.
    Commutation = 29,
        "the motor does not turn where its Halls say: wires, Halls and calibration do not belong together",
        "see whether a motor wire is broken, motor or Halls were rewired or exchanged, or the Halls' magnets or board came \
         loose; else the load is stronger, or tracking_bandwidth_hz is below 100 Hz";
    /// The rotor did not follow the commanded position or speed.
    FollowingError = 30,
        "the rotor did not follow the command",
        "look for a blocked or too heavy load; following_error_turns and following_error_rad_s are the limits";
    /// The rotor is outside of `min_position_turns` to `max_position_turns`.
    PositionBounds = 31,
        "the rotor is outside of its position bounds",
        "turn it back by hand, or change min_position_turns and max_position_turns";
    /// The absolute encoder gave no angle for longer than tolerated.
    Encoder = 32,
        "the absolute encoder gives no trustworthy angle",
        "check the ring magnets' heads and their wires";
    /// The Halls' turn counter and the absolute encoder disagree.
    Turns = 33,
        "the Halls and the absolute encoder disagree",
        "a Hall or the encoder has lost turns: calibrate both";
    /// The gate driver reports a fault, or does not answer.
    GateDriver = 34,
        "the gate driver reports a fault, or does not answer",
        "read the gate driver's registers: a short circuit, its supply, or its SPI lines";
    /// Arming found no current in phase A.
    OpenPhaseA = 35,
        "phase A carries no current",
        "check the wire of phase A, its terminal and its half bridge";
    /// Arming found no current in phase B.
    OpenPhaseB = 36,
        "phase B carries no current",
        "check the wire of phase B, its terminal and its half bridge";
    /// Arming found no current in phase C.
    OpenPhaseC = 37,
        "phase C carries no current",
        "check the wire of phase C, its terminal and its half bridge";
    /// Arming found that the amplifier of phase A does not show its current.
    AmplifierA = 38,
        "the current amplifier of phase A does not show the phase's current",
        "check the shunt and the amplifier of phase A";
    /// Arming found that the amplifier of phase B does not show its current.
    AmplifierB = 39,
        "the current amplifier of phase B does not show the phase's current",
        "check the shunt and the amplifier of phase B";
    /// Arming found that the amplifier of phase C does not show its current.
    AmplifierC = 40,
        "the current amplifier of phase C does not show the phase's current",
        "check the shunt and the amplifier of phase C";
    /// Arming found no current in any phase.
    NoCurrent = 41,
        "no phase carries a current",
        "check that the motor is connected and the bridge is supplied; resistance_ohm may be far too low";
    /// Currents and voltages contradict the motor's resistance, inductance and flux linkage.
    CurrentModel = 42,
        "currents and voltages do not fit the motor: an open phase, a blind amplifier, or wrong settings",
        "check the motor's wires and the shunts";
    /// The thermal model of the winding is beyond its limit, or what its resistance tells is.
    WindingHot = 43,
        "the winding is too hot by its current or resistance",
        "let it cool; lower the load; see continuous_current_a, max_winding_rise_k";
    /// The thermal model of the bridge is beyond its limit.
    BridgeOverload = 44,
        "the bridge is overloaded by the current that has flowed",
        "let it cool; lower the load";
    /// The bridge's thermistor is open or shorted.
    BridgeThermistor = 45,
        "the thermistor of the bridge is open or shorted",
        "check the thermistor and its pull-up";
    /// The motor's thermistor is open or shorted.
    MotorThermistor = 46,
        "the thermistor of the motor is open or shorted",
        "check the thermistor and its wires";
    /// The motor was not at rest in `stop_s` after a stop.
    NotStopped = 47,
        "the motor did not come to rest in time",
        "something drives the shaft, or stop_s is too short for the load's inertia";
    /// The enable input is off.
    Disabled = 48,
        "the enable input is off",
        "close the enable contact";
    /// The brake resistor was on for longer than it may be, and has to cool down.
    BrakeResistor = 49,
        "the brake resistor was on for too long and has to cool down",
        "wait; then see why the bus stays above chopper_v: the supply, a shaft that is driven, or too weak a resistor";
}

const fn hall_code(why: Implausible) -> u8 {
    match why {
        Implausible::AtRail(Channel(channel)) => 1 + channel % 3,
        Implausible::OutOfRange(Channel(channel)) => 4 + channel % 3,
        Implausible::Inconsistent => 7,
        Implausible::Weak => 8,
        Implausible::Strong => 9,
    }
}

const fn hall_from_code(code: u8) -> Option<Implausible> {
    Some(match code {
        1..=3 => Implausible::AtRail(Channel(code - 1)),
        4..=6 => Implausible::OutOfRange(Channel(code - 4)),
        7 => Implausible::Inconsistent,
        8 => Implausible::Weak,
        9 => Implausible::Strong,
        _ => return None,
    })
}

impl Fault {
    /// What is to be done about some of them when they are cleared: a drive with a fault refuses it.
    pub const fn after_clearing(self) -> Option<&'static str> {
        Some(match self {
            Self::Hall(_) => "after a repair, `hallctl calibrate`",
            Self::Calibration => "`hallctl calibrate` again",
            Self::OverCurrent => "if the motor is another one, `hallctl identify`",
            Self::Commutation => "after a change, `hallctl calibrate`",
            Self::CurrentModel => "if the motor is new, `hallctl identify`",
            _ => return None,
        })
    }

    /// All of them, in the order of their numbers.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..=u8::MAX).filter_map(Self::from_code)
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
    /// The bridge was just switched on: wires, amplifiers and commutation are being checked.
    pub const CHECKING: Self = Self(64);
    /// The supply takes no more back or gives no more, and the torque is reduced.
    pub const SUPPLY: Self = Self(128);

    /// A bit each, in the order of their numbers: these stay the same from version to version.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Those of a number; bits that stand for none are ignored.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
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

    /// What is in flashes, logs and other versions of the tools: a row is added, none is changed.
    const NUMBERS: [(u8, Fault); 43] = [
        (1, Fault::Hall(Implausible::AtRail(Channel(0)))),
        (2, Fault::Hall(Implausible::AtRail(Channel(1)))),
        (3, Fault::Hall(Implausible::AtRail(Channel(2)))),
        (4, Fault::Hall(Implausible::OutOfRange(Channel(0)))),
        (5, Fault::Hall(Implausible::OutOfRange(Channel(1)))),
        (6, Fault::Hall(Implausible::OutOfRange(Channel(2)))),
        (7, Fault::Hall(Implausible::Inconsistent)),
        (8, Fault::Hall(Implausible::Weak)),
        (9, Fault::Hall(Implausible::Strong)),
        (16, Fault::AngleJump),
        (17, Fault::OverSpeed),
        (18, Fault::Calibration),
        (19, Fault::OverVoltage),
        (20, Fault::UnderVoltage),
        (21, Fault::OverCurrent),
        (22, Fault::BridgeHot),
        (23, Fault::MotorHot),
        (24, Fault::Stall),
        (25, Fault::CurrentOffset),
        (26, Fault::CurrentImbalance),
        (27, Fault::CommandTimeout),
        (28, Fault::Deadline),
        (29, Fault::Commutation),
        (30, Fault::FollowingError),
        (31, Fault::PositionBounds),
        (32, Fault::Encoder),
        (33, Fault::Turns),
        (34, Fault::GateDriver),
        (35, Fault::OpenPhaseA),
        (36, Fault::OpenPhaseB),
        (37, Fault::OpenPhaseC),
        (38, Fault::AmplifierA),
        (39, Fault::AmplifierB),
        (40, Fault::AmplifierC),
        (41, Fault::NoCurrent),
        (42, Fault::CurrentModel),
        (43, Fault::WindingHot),
        (44, Fault::BridgeOverload),
        (45, Fault::BridgeThermistor),
        (46, Fault::MotorThermistor),
        (47, Fault::NotStopped),
        (48, Fault::Disabled),
        (49, Fault::BrakeResistor),
    ];

    #[test]
    fn numbers_are_frozen() {
        for code in 0..=u8::MAX {
            let frozen = NUMBERS.iter().find(|(number, _)| *number == code).map(|(_, fault)| *fault);
            assert_eq!(Fault::from_code(code), frozen, "{code}");
        }
        for (number, fault) in NUMBERS {
            assert_eq!(fault.code(), number, "{fault:?}");
        }
        assert!(Fault::all().eq(NUMBERS.into_iter().map(|(_, fault)| fault)));
    }

    #[test]
    fn limits_are_their_bits() {
        let limits = [
            Limits::DUTY,
            Limits::EXTRAPOLATED,
            Limits::TWO_HALLS,
            Limits::CURRENT,
            Limits::HEAT,
            Limits::TIMEOUT,
            Limits::CHECKING,
            Limits::SUPPLY,
        ];
        for (place, limit) in limits.into_iter().enumerate() {
            assert_eq!(limit.bits(), 1 << place);
        }
        let all = limits.into_iter().fold(Limits::NONE, Limits::with);
        assert_eq!((all.bits(), Limits::from_bits(u8::MAX)), (255, all));
    }
}
