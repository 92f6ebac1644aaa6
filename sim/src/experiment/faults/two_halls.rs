//! What befalls the sensors of a drive with two Halls, where no third one contradicts.
//!
//! A sensor that is wrong may be as good as any where the rotor stands, and two angles have the same signals. So it is
//! not asked that each is named at once, but that none does harm: the shaft neither turns the wrong way for long nor
//! faster than it may, the current stays below its limit, and what is never named leaves the drive doing what it was
//! told, or at rest.

use super::defect::Defect::*;
use super::kind::Stage::{self, *};
use super::kind::{Kind, Outcome, kind};

/// What the loops' time constants and `stall_s` are given, and a half more.
const HARMLESS: Outcome = Outcome::NoHarm(1.8);

const fn harmless(name: &'static str, defect: super::defect::Defect, stage: Stage) -> Kind {
    kind(name, defect, stage, HARMLESS)
}

/// All of them, beside those of every drive.
pub(super) const KINDS: &[Kind] = &[
    harmless("one of two Halls frozen at speed", HallFrozen, Turning),
    harmless("one of two Halls frozen at speed against a load", HallFrozen, Loaded),
    harmless("one of two Halls frozen, any command", HallFrozen, Running),
    harmless("one of two Halls frozen under torque", HallFrozen, FreeTorque),
    harmless("one of two Halls frozen while it holds", HallFrozen, Holding),
    harmless("one of two Halls frozen before a command", HallFrozen, BeforeCommand),
    harmless("one of two Halls frozen, then a reversal", HallFrozen, Reversal),
    harmless("one of two Halls frozen before arming", HallFrozen, BeforeArming),
    harmless("both Halls shorted to each other", HallsShorted, Running),
    harmless("two Halls swapped at speed", HallsSwapped, Running),
    harmless("one of two Halls weaker", HallWeak, Running),
    harmless("one of two Halls stronger", HallStrong, Running),
    harmless("one of two Halls with another offset", HallOffset, Running),
    harmless("one of two Halls noisy", HallNoisy, Running),
    harmless("both Halls weaker", HallsWeak, Running),
    kind("third input at a rail", ThirdAtRail, Running, Outcome::NoFault(0.15)),
];
