//! The kinds of injections: what breaks, when, and by when it has to be named.

use super::bench::{Bench, SLOW_RAD_S};
use super::defect::Defect;
use plant::ThermistorFault::{Open, Shorted};

/// When it breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// While a demand of any sort is followed.
    Running,
    /// While turning at a speed.
    Turning,
    /// The same against a load.
    Loaded,
    /// While a torque holds against a load, or a locked shaft.
    Holding,
    /// Switched on and at rest; the command comes a while later.
    BeforeCommand,
    /// While the bridge is off.
    BeforeArming,
    /// A torque at a free shaft.
    FreeTorque,
    /// At speed, then the other way round at once.
    Reversal,
}

/// What has to come of it, and by when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outcome {
    /// A fault that names it, after so many seconds.
    Named(f64),
    /// A fault that names it within an electrical turn of the rotor, and the periods that a wrong sample is tolerated
    /// for: it looks like a healthy sensor where the rotor stands or where the sensors happen to agree.
    NamedInATurn,
    /// The rotor is at rest after so many seconds and the command time-out, with or without a fault.
    AtRest(f64),
    /// No fault for so many seconds.
    NoFault(f64),
    /// A fault that names it, or tells that the rotor does not follow, or none, and no harm for so many seconds: a
    /// rotor that a wrong commutation holds fast, or moves with less torque, cannot be told from one with a heavy load;
    /// what breaks without a current shows by nothing. Over-speed, in time, where a torque asks for so little current
    /// that an open phase cannot show.
    NamedOrHarmless(f64),
    /// The rotor stays within its speed limit for so many seconds, or over-speed is named.
    NotTooFast(f64),
    /// A fault that names it, or tells that the rotor does not follow, or none; and by the truth of the plant no harm for
    /// so many seconds: the current below its limit, the rotor no faster than it may be and not too long the wrong way.
    NoHarm(f64),
}

/// A kind of injection.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    pub name: &'static str,
    pub defect: Defect,
    pub stage: Stage,
    pub outcome: Outcome,
}

pub(super) const fn kind(name: &'static str, defect: Defect, stage: Stage, outcome: Outcome) -> Kind {
    Kind { name, defect, stage, outcome }
}

/// A period of 40 kHz, s.
const PERIOD: f64 = 25e-6;
/// What a sample shows.
const AT_ONCE: Outcome = Outcome::Named(PERIOD);
/// What all else is given.
const SOON: Outcome = Outcome::Named(0.05);
/// Temperatures are looked at in turns; they take seconds.
const WARM: Outcome = Outcome::Named(0.1);
/// What shows only where a current flows, the rotor turns and the noise is exceeded.
const SHOWN: Outcome = Outcome::NamedOrHarmless(0.5);
/// What the loops' time constants and `stall_s` are given.
const LATE: Outcome = Outcome::Named(1.2);

/// Where the commutation is wrong.
const HARMLESS: Outcome = Outcome::NamedOrHarmless(0.5);

/// Largest motion the wrong way, mechanical degrees and seconds.
pub(super) const MOST_WRONG: (f64, f64) = (30.0, 0.05);

use Defect::*;
use Stage::*;

/// All of them, but for those of [two Halls](super::two_halls).
pub(super) const KINDS: &[Kind] = &[
    kind("over-voltage", OverVoltage, Running, AT_ONCE),
    kind("under-voltage", UnderVoltage, Running, AT_ONCE),
    kind("over-current", OverCurrent, Running, AT_ONCE),
    kind("control period lost", LostPeriod, Running, AT_ONCE),
    kind("trigger stuck for up to 10 ms", StuckTrigger, Loaded, Outcome::Named(12e-3)),
    kind("current imbalance", Imbalance, Running, SOON),
    kind("current offset at arming", Offset, BeforeArming, SOON),
    kind("bridge too hot", Hot(0), Running, WARM),
    kind("motor too hot", Hot(1), Running, WARM),
    kind("bridge thermistor open", Thermistor(0, Open), Running, WARM),
    kind("bridge thermistor shorted", Thermistor(0, Shorted), Running, WARM),
    kind("motor thermistor open", Thermistor(1, Open), Running, WARM),
    kind("motor thermistor shorted", Thermistor(1, Shorted), Running, WARM),
    kind("bridge thermistor open at arming", Thermistor(0, Open), BeforeArming, SOON),
    kind("Hall at the upper rail", HallAtRail, Running, Outcome::Named(2.0 * PERIOD)),
    kind("Hall at ground", HallAtGround, Running, Outcome::Named(2.0 * PERIOD)),
    kind("two Halls shorted", HallsShorted, Turning, Outcome::NamedInATurn),
    kind("Hall frozen at its value", HallFrozen, Turning, Outcome::NamedInATurn),
    kind("Halls' wires moved on", HallWiresMoved, BeforeArming, HARMLESS),
    kind("two Halls' wires swapped", HallWiresSwapped, BeforeArming, HARMLESS),
    kind("motor wires moved on", MotorWiresMoved, BeforeArming, HARMLESS),
    kind("two motor wires swapped", MotorWiresSwapped, BeforeArming, HARMLESS),
    kind("calibration off by 60°", WrongAngle(60.0), BeforeArming, HARMLESS),
    kind("calibration off by 90°", WrongAngle(90.0), BeforeArming, HARMLESS),
    kind("calibration off by 120°", WrongAngle(120.0), BeforeArming, HARMLESS),
    kind("calibration off by 180°", WrongAngle(180.0), BeforeArming, HARMLESS),
    kind("calibration of the wrong direction", WrongDirection, BeforeArming, HARMLESS),
    kind("open phase at speed", OpenPhase, Loaded, SHOWN),
    kind("open phase under torque", OpenPhase, Holding, SHOWN),
    kind("open phase from rest", OpenPhase, BeforeCommand, SHOWN),
    kind("open phase before arming", OpenPhase, BeforeArming, SOON),
    kind("dead transistor at speed", DeadTransistor, Loaded, SHOWN),
    kind("dead transistor before arming", DeadTransistor, BeforeArming, SOON),
    kind("amplifier dead at speed", AmplifierDead, Loaded, SHOWN),
    kind("amplifier dead under torque", AmplifierDead, Holding, SHOWN),
    kind("amplifier dead before arming", AmplifierDead, BeforeArming, SOON),
    kind("amplifier frozen", AmplifierFrozen, Loaded, SHOWN),
    kind("amplifier of a wrong gain", AmplifierGain, Loaded, SHOWN),
    kind("all amplifiers dead at speed", AmplifiersDead, Loaded, SHOWN),
    kind("all amplifiers dead under torque", AmplifiersDead, Holding, SHOWN),
    kind("all amplifiers dead before arming", AmplifiersDead, BeforeArming, SOON),
    kind("over-speed, driven", Driven, Turning, Outcome::Named(0.12)),
    kind("over-speed by torque", Nothing, FreeTorque, Outcome::NotTooFast(0.4)),
    kind("stall at a blocked shaft", Blocked, Turning, LATE),
    kind("dragged away from its position", Dragged, Holding, LATE),
    kind("command time-out", Silence, Turning, Outcome::AtRest(0.1)),
    kind("command time-out, driven on", Driven, Turning, Outcome::Named(1.5)),
    kind("reversal on a supply that takes nothing", Nothing, Reversal, Outcome::NoFault(0.15)),
];

impl Kind {
    /// Whether the bench has what it takes.
    pub fn fits(&self, bench: &Bench) -> bool {
        let Some(control) = &bench.settings.control else { return false };
        let slow = control.max_speed_rad_s <= SLOW_RAD_S;
        let motor = &bench.parameters.motor;
        let emf_v = |speed: f64| 1.8 * speed * f64::from(motor.pole_pairs) * motor.back_emf.flux_linkage_vs;
        let bus_v = bench.parameters.bus.supply_v;
        match (self.defect, self.stage) {
            // With two it is another matter.
            _ if self.outcome == Outcome::NamedInATurn && bench.halls() == 2 => false,
            (Hot(1) | Thermistor(1, _), _) => bench.thermistors[1].is_some(),
            // Beyond the bus, the diodes pump it up first.
            (Driven, _) => slow && emf_v(1.5 * f64::from(SLOW_RAD_S)) < 0.9 * bus_v,
            (_, FreeTorque) => slow && emf_v(1.5 * f64::from(SLOW_RAD_S)) < 0.7 * bus_v,
            (_, Reversal) => !bench.parameters.bus.regenerative,
            _ => true,
        }
    }

    /// Runs of a second or more are made more rarely.
    pub fn is_long(&self) -> bool {
        matches!(self.outcome, Outcome::AtRest(_)) || matches!(self.outcome, Outcome::Named(time) if time > 1.0)
    }
}
