//! What is done to the drive, and what it should say.

use super::summary::{TIMEOUT_PERIODS, TOLERATED};
use crate::rig::Disturb;
use hallservo::board::{LostPeriods, Sample, TemperatureCode};
use hallservo::fault::Fault;
use rand::RngExt;
use rand_pcg::Pcg64;

/// When a fault has to be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Deadline {
    /// Within so many control periods.
    Periods(u32),
    /// Within an electrical turn of the rotor and the periods that a wrong sample is tolerated for: it looks like a
    /// healthy sensor where the rotor stands or where the sensors happen to agree.
    Turn,
}

/// Periods in which a rotor that turns has made its turn.
pub(super) const LONGEST_TURN: u32 = 40_000;

impl Deadline {
    /// Whether it has passed after so many periods and electrical turns.
    pub fn has_passed(self, periods: u32, turns: f64) -> bool {
        match self {
            Self::Periods(most) => periods >= most,
            // The rotor goes on turning in the periods that are tolerated: two at the fastest speed are 0.01 turns.
            Self::Turn => turns >= 1.01 || periods >= LONGEST_TURN,
        }
    }
}

/// What is done to the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Injection {
    OverVoltage,
    UnderVoltage,
    OverCurrent,
    CurrentImbalance,
    CurrentOffset,
    BridgeHot,
    MotorHot,
    Deadline,
    HallAtRail,
    HallAtGround,
    HallsShorted,
    HallFrozen,
    OverSpeed,
    Stall,
    CommandTimeout,
}

pub(super) const INJECTIONS: [Injection; 15] = [
    Injection::OverVoltage,
    Injection::UnderVoltage,
    Injection::OverCurrent,
    Injection::CurrentImbalance,
    Injection::CurrentOffset,
    Injection::BridgeHot,
    Injection::MotorHot,
    Injection::Deadline,
    Injection::HallAtRail,
    Injection::HallAtGround,
    Injection::HallsShorted,
    Injection::HallFrozen,
    Injection::OverSpeed,
    Injection::Stall,
    Injection::CommandTimeout,
];

impl Injection {
    pub fn name(self) -> &'static str {
        match self {
            Self::OverVoltage => "over-voltage",
            Self::UnderVoltage => "under-voltage",
            Self::OverCurrent => "over-current",
            Self::CurrentImbalance => "current imbalance",
            Self::CurrentOffset => "current offset at arming",
            Self::BridgeHot => "bridge too hot",
            Self::MotorHot => "motor too hot",
            Self::Deadline => "deadline missed",
            Self::HallAtRail => "Hall at the upper rail",
            Self::HallAtGround => "Hall at ground",
            Self::HallsShorted => "two Halls shorted",
            Self::HallFrozen => "Hall frozen at its value",
            Self::OverSpeed => "over-speed",
            Self::Stall => "stall",
            Self::CommandTimeout => "command timeout",
        }
    }

    /// Whether one sample shows it.
    pub fn at_once(self) -> bool {
        matches!(self, Self::OverVoltage | Self::UnderVoltage | Self::OverCurrent | Self::Deadline)
    }

    pub fn is(self, fault: Fault) -> bool {
        match self {
            Self::OverVoltage => fault == Fault::OverVoltage,
            Self::UnderVoltage => fault == Fault::UnderVoltage,
            Self::OverCurrent => fault == Fault::OverCurrent,
            Self::CurrentImbalance => fault == Fault::CurrentImbalance,
            Self::CurrentOffset => fault == Fault::CurrentOffset,
            Self::BridgeHot => fault == Fault::BridgeHot,
            Self::MotorHot => fault == Fault::MotorHot,
            Self::Deadline => fault == Fault::Deadline,
            Self::HallAtRail | Self::HallAtGround | Self::HallsShorted => {
                matches!(fault, Fault::Hall(_) | Fault::AngleJump)
            }
            // With one sensor frozen, the angle runs unevenly: once in two thousand times, that looks like over-speed
            // first.
            Self::HallFrozen => matches!(fault, Fault::Hall(_) | Fault::AngleJump | Fault::OverSpeed),
            Self::OverSpeed => fault == Fault::OverSpeed,
            Self::Stall => fault == Fault::Stall,
            Self::CommandTimeout => fault == Fault::CommandTimeout,
        }
    }

    /// How long it may take.
    pub fn deadline(self) -> Deadline {
        Deadline::Periods(match self {
            Self::OverVoltage | Self::UnderVoltage | Self::OverCurrent | Self::Deadline | Self::CurrentOffset => 1,
            Self::BridgeHot | Self::MotorHot => 1100,
            Self::CurrentImbalance => 20,
            Self::HallAtRail | Self::HallAtGround => u32::from(TOLERATED) + 1,
            Self::HallsShorted | Self::HallFrozen => return Deadline::Turn,
            // The tracker has to follow the leap of speed.
            Self::OverSpeed => 400,
            Self::Stall => 8000,
            Self::CommandTimeout => TIMEOUT_PERIODS + 8,
        })
    }

    /// Whether the rotor must be turning for it to show.
    pub fn needs_motion(self) -> bool {
        self.deadline() == Deadline::Turn || self == Self::Stall
    }

    pub fn disturb(self, random: &mut Pcg64) -> Option<Disturb> {
        let channel = random.random_range(0..3_usize);
        let up = random.random_bool(0.5);
        let bus =
            if self == Self::OverVoltage { random.random_range(3620..=4095) } else { random.random_range(0..1340) };
        Some(match self {
            Self::OverVoltage | Self::UnderVoltage => Box::new(move |sample: &mut Sample| sample.bus = bus),
            Self::OverCurrent => {
                let code = if up { random.random_range(3560..=4095) } else { random.random_range(0..530) };
                Box::new(move |sample| sample.currents[channel] = code)
            }
            // At least the 0.5 A that both thresholds are, with a margin for noise and offset.
            Self::CurrentImbalance | Self::CurrentOffset => {
                let off = random.random_range(140..400_u16);
                Box::new(move |sample| {
                    let code = &mut sample.currents[channel];
                    *code = if up { *code + off } else { *code - off };
                })
            }
            Self::BridgeHot => Box::new(|sample| sample.temperatures[0] = TemperatureCode::new(300)),
            Self::MotorHot => Box::new(|sample| sample.temperatures[1] = TemperatureCode::new(200)),
            Self::Deadline => Box::new(|sample| sample.lost = LostPeriods::counted(1)),
            Self::HallAtRail => Box::new(move |sample| sample.halls[channel] = 4095),
            Self::HallAtGround => Box::new(move |sample| sample.halls[channel] = 0),
            Self::HallsShorted => Box::new(move |sample| {
                let other = (channel + 1) % 3;
                let both = (sample.halls[channel] + sample.halls[other]) / 2;
                (sample.halls[channel], sample.halls[other]) = (both, both);
            }),
            Self::HallFrozen => {
                let mut held = None;
                Box::new(move |sample| {
                    let code = &mut sample.halls[channel];
                    *code = *held.get_or_insert(*code);
                })
            }
            Self::OverSpeed | Self::Stall | Self::CommandTimeout => return None,
        })
    }
}
