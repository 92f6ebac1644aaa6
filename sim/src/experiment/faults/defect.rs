//! What is done to a drive and its motor, and the names that it may be given.

use super::bench::{Bench, COOL};
use super::machine::Verdict;
use anyhow::{Context, Result};
use hallservo::angle::ElectricalAngle;
use hallservo::board::{LostPeriods, Sample};
use hallservo::drive::Refusal;
use hallservo::fault::Fault;
use hallservo::hall::model::{Model, Sensor};
use plant::{AmplifierFault, HallFault, HallParameters, PlantParameters, ThermistorFault, Transistor, Wires};
use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_pcg::Pcg64;
use rig::{Disturb, Rig};
use std::ops::Range;

/// What breaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Defect {
    OverVoltage,
    UnderVoltage,
    OverCurrent,
    Imbalance,
    Offset,
    /// A thermistor, of bridge (0) or motor (1), shows more than its limit.
    Hot(usize),
    Thermistor(usize, ThermistorFault),
    /// One control period is lost.
    LostPeriod,
    /// The trigger is stuck for a while; the hardware switches the bridge off after [`WATCHDOG_S`].
    StuckTrigger,
    HallAtRail,
    HallAtGround,
    HallsShorted,
    HallFrozen,
    /// One sensor shows less, or more, of its field than it was calibrated with.
    HallWeak,
    HallStrong,
    /// All of them show less.
    HallsWeak,
    HallOffset,
    HallNoisy,
    /// While the drive runs.
    HallsSwapped,
    /// The input that a drive with two Halls does not use.
    ThirdAtRail,
    HallWiresMoved,
    HallWiresSwapped,
    OpenPhase,
    DeadTransistor,
    AmplifierDead,
    AmplifierFrozen,
    AmplifierGain,
    AmplifiersDead,
    MotorWiresMoved,
    MotorWiresSwapped,
    /// The calibration of another motor: its angle is off by so many electrical degrees, either way.
    WrongAngle(f32),
    /// It counts the wrong way.
    WrongDirection,
    /// Something outside holds the shaft.
    Blocked,
    /// Something outside turns the shaft beyond its speed limit.
    Driven,
    /// The same against the command, slowly.
    Dragged,
    /// No commands come any more.
    Silence,
    /// Nothing is wrong, but the command is a hard one.
    Nothing,
}

impl Defect {
    /// Whether one of the sensors that the drive uses is what breaks.
    fn is_of_a_hall(self) -> bool {
        use Defect::*;
        matches!(
            self,
            HallAtRail | HallAtGround | HallsShorted | HallFrozen | HallWeak | HallStrong | HallOffset | HallNoisy
        )
    }
}

/// After so long without a step, a board's hardware has switched the bridge off, s.
pub(super) const WATCHDOG_S: f64 = 1e-3;

/// A defect as it was set, with what is needed to judge and to mend it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Broken {
    pub defect: Defect,
    /// Leg, winding or sensor.
    pub channel: usize,
    /// What the drive takes for its calibration.
    pub model: Model,
}

impl Broken {
    /// Whether a fault or a refusal says what is wrong.
    pub fn is_named_by(self, verdict: Verdict, halls: usize) -> bool {
        match (self.defect, verdict) {
            // Two Halls that are wrong make a rotor seem to turn against its torque, as what is stronger than it does.
            (Defect::Driven | Defect::Dragged, Verdict::Fault(Fault::Hall(_))) if halls == 2 => true,
            (Defect::HallWiresMoved | Defect::HallWiresSwapped, Verdict::Refused(Refusal::NoAngle)) => true,
            _ => verdict.fault().is_some_and(|fault| self.is_named_by_fault(fault)),
        }
    }

    /// Whether it can make a current flow that is too large, or show one.
    pub fn overloads(self) -> bool {
        use Defect::*;
        matches!(
            self.defect,
            OpenPhase | DeadTransistor | AmplifierDead | AmplifierFrozen | AmplifierGain | AmplifiersDead
        )
    }

    fn is_named_by_fault(self, fault: Fault) -> bool {
        use Fault::*;
        let open = [OpenPhaseA, OpenPhaseB, OpenPhaseC][self.channel];
        let amplifier = [AmplifierA, AmplifierB, AmplifierC][self.channel];
        match self.defect {
            Defect::OverVoltage => fault == OverVoltage,
            Defect::UnderVoltage => fault == UnderVoltage,
            Defect::OverCurrent => fault == OverCurrent,
            Defect::Imbalance => matches!(fault, CurrentImbalance | CurrentModel),
            Defect::Offset => fault == CurrentOffset,
            Defect::Hot(0) => fault == BridgeHot,
            Defect::Hot(_) => fault == MotorHot,
            Defect::Thermistor(0, _) => fault == BridgeThermistor,
            Defect::Thermistor(..) => fault == MotorThermistor,
            Defect::LostPeriod | Defect::StuckTrigger => fault == Deadline,
            Defect::HallAtRail | Defect::HallAtGround => matches!(fault, Hall(_) | AngleJump),
            // The angle is wrong, and so the torque.
            Defect::HallsShorted
            | Defect::HallWeak
            | Defect::HallStrong
            | Defect::HallsWeak
            | Defect::HallOffset
            | Defect::HallNoisy
            | Defect::HallsSwapped => matches!(fault, Hall(_) | AngleJump | Commutation),
            // With one sensor frozen, the angle runs unevenly: once in two thousand times, that looks like over-speed
            // first. Of two, at arming, the rotor does not go where it is pushed.
            Defect::HallFrozen => matches!(fault, Hall(_) | AngleJump | OverSpeed | Commutation),
            // The sensors may contradict each other by then.
            Defect::HallWiresMoved | Defect::HallWiresSwapped | Defect::WrongDirection => {
                matches!(fault, Hall(_) | AngleJump | Commutation)
            }
            // A load may turn the rotor against the torque that is left.
            Defect::OpenPhase => fault == open || matches!(fault, CurrentModel | Commutation),
            Defect::DeadTransistor => {
                fault == open || fault == amplifier || matches!(fault, CurrentModel | Commutation)
            }
            Defect::AmplifierDead | Defect::AmplifierFrozen => {
                fault == amplifier || matches!(fault, CurrentModel | CurrentImbalance)
            }
            // Twice the current is shown, and that may be too large.
            Defect::AmplifierGain => {
                fault == amplifier || matches!(fault, CurrentModel | CurrentImbalance | OverCurrent)
            }
            Defect::AmplifiersDead => matches!(fault, NoCurrent | CurrentModel),
            Defect::MotorWiresMoved | Defect::MotorWiresSwapped | Defect::WrongAngle(_) => fault == Commutation,
            Defect::Blocked => matches!(fault, Stall | FollowingError),
            // What is stronger than the motor turns the rotor against it, as a wrong commutation does.
            Defect::Driven => matches!(fault, OverSpeed | FollowingError | Commutation),
            Defect::Dragged => matches!(fault, FollowingError | Stall | Commutation),
            Defect::Silence => matches!(fault, CommandTimeout | NotStopped),
            Defect::ThirdAtRail | Defect::Nothing => false,
        }
    }

    /// Breaks it.
    pub fn set(defect: Defect, rig: &mut Rig, bench: &mut Bench, model: &Model, random: &mut Pcg64) -> Result<Self> {
        let channel = match defect {
            // Where a current flows, for without one nothing can show.
            Defect::OpenPhase | Defect::DeadTransistor | Defect::AmplifierDead | Defect::AmplifierGain => {
                largest(rig.plant.currents_a()).unwrap_or(random.random_range(0..3))
            }
            // The wire of the one that stays.
            Defect::HallWiresSwapped if bench.halls() == 2 => 2,
            Defect::ThirdAtRail => 2,
            _ if defect.is_of_a_hall() => random.random_range(0..bench.halls()),
            _ => random.random_range(0..3),
        };
        let mut broken = Self { defect, channel, model: *model };
        let plant = &mut rig.plant;
        match defect {
            Defect::Thermistor(which, fault) => {
                bench.thermistors[which].as_mut().context("no such thermistor")?.fault = Some(fault);
            }
            Defect::Hot(which) => {
                let guard = bench.settings.control.context("no current sensing")?.guard;
                bench.celsius[which] = f64::from([guard.bridge, guard.motor][which].max_c) + 5.0;
            }
            Defect::HallWiresMoved => plant.set_hall_wires(Wires::moved_on(random.random_range(1..3))),
            Defect::HallWiresSwapped => plant.set_hall_wires(Wires::swapped(channel)),
            Defect::MotorWiresMoved => plant.set_motor_wires(Wires::moved_on(random.random_range(1..3))),
            Defect::MotorWiresSwapped => plant.set_motor_wires(Wires::swapped(channel)),
            Defect::OpenPhase => plant.set_phase_open(channel, true),
            Defect::DeadTransistor => {
                let upper = random.random_bool(0.5);
                plant.set_dead_transistor(channel, Some(if upper { Transistor::Upper } else { Transistor::Lower }));
            }
            Defect::AmplifierDead => plant.set_amplifier_fault(channel, Some(AmplifierFault::Dead))?,
            Defect::AmplifierFrozen => {
                let shown_a = plant.currents_a()[channel];
                plant.set_amplifier_fault(channel, Some(AmplifierFault::Frozen(shown_a)))?;
            }
            Defect::AmplifierGain => {
                let gain = *[0.3, 0.5, 2.0].choose(random).context("no gain")?;
                plant.set_amplifier_fault(channel, Some(AmplifierFault::Gain(gain)))?;
            }
            Defect::AmplifiersDead => {
                for leg in 0..3 {
                    plant.set_amplifier_fault(leg, Some(AmplifierFault::Dead))?;
                }
            }
            Defect::WrongAngle(degrees) => {
                let off = ElectricalAngle::from_degrees(if random.random_bool(0.5) { degrees } else { -degrees });
                broken.model.alignment += off;
                install(rig, &broken.model)?;
            }
            Defect::WrongDirection => {
                broken.model.sensors = model.sensors.map(|sensor| Sensor { placement: -sensor.placement, ..sensor });
                install(rig, &broken.model)?;
            }
            Defect::Blocked => plant.set_dyno(Some(0.0))?,
            Defect::HallNoisy => {
                let noise_v = random.random_range(0.05..0.5) * bench.parameters.halls[channel].amplitude_v;
                plant.set_hall_fault(channel, Some(HallFault::Noisy(noise_v)));
            }
            _ => rig.disturb = disturbance(defect, channel, bench, random)?,
        }
        Ok(broken)
    }
}

/// Mends everything but the drive's model.
pub(super) fn mend(rig: &mut Rig, bench: &mut Bench) -> Result<()> {
    rig.disturb = None;
    let plant = &mut rig.plant;
    for channel in 0..3 {
        plant.set_phase_open(channel, false);
        plant.set_dead_transistor(channel, None);
        plant.set_amplifier_fault(channel, None)?;
        plant.set_hall_fault(channel, None);
    }
    plant.set_motor_wires(Wires::STRAIGHT);
    plant.set_hall_wires(Wires::STRAIGHT);
    plant.set_load(0.0)?;
    bench.celsius = COOL;
    for thermistor in bench.thermistors.iter_mut().flatten() {
        thermistor.fault = None;
    }
    Ok(())
}

/// Gives the drive a model.
pub(super) fn install(rig: &mut Rig, model: &Model) -> Result<()> {
    for _ in 0..100 {
        if rig.service.install(model).is_ok() {
            rig.wait(2e-3);
            return Ok(());
        }
        rig.wait(1e-3);
    }
    anyhow::bail!("the drive takes no model")
}

/// The phase with the largest current, if any flows.
fn largest(currents_a: [f64; 3]) -> Option<usize> {
    let most = (0..3).max_by(|&a, &b| currents_a[a].abs().total_cmp(&currents_a[b].abs()))?;
    (currents_a[most].abs() > 0.05).then_some(most)
}

/// What changes the samples on their way to the drive.
fn disturbance(defect: Defect, channel: usize, bench: &Bench, random: &mut Pcg64) -> Result<Option<Disturb>> {
    let control = bench.settings.control.as_ref().context("a board without current sensing")?;
    let guard = &control.guard;
    let (up, halls) = (random.random_bool(0.5), bench.halls());
    let volts = |volts: f32| (volts / control.bus_full_scale_v * 4096.0) as u16;
    let amperes = |amperes: f32| (amperes / control.current_full_scale_a * 2048.0) as u16;
    let margin = amperes(0.2 * guard.over_current_a) + 8;
    Ok(Some(match defect {
        Defect::OverVoltage => {
            let code = random.random_range(volts(guard.over_voltage_v) + 8..=4095);
            Box::new(move |sample: &mut Sample| sample.bus = code)
        }
        Defect::UnderVoltage => {
            let code = random.random_range(0..volts(guard.under_voltage_v) - 8);
            Box::new(move |sample| sample.bus = code)
        }
        Defect::OverCurrent => {
            let off = (amperes(guard.over_current_a) + margin).min(2047);
            let code = if up { 2048 + off } else { 2048 - off };
            Box::new(move |sample| sample.currents[channel] = code)
        }
        Defect::Imbalance | Defect::Offset => {
            // The sum of the currents may be off by the amplifiers' gains beside.
            let imbalance_a = guard.imbalance_a + 0.04 * control.max_current_a;
            let threshold = if defect == Defect::Offset { guard.offset_a } else { imbalance_a };
            let off = amperes(threshold * random.random_range(1.1..1.5)) + 12;
            let mut up = None;
            Box::new(move |sample| {
                let code = &mut sample.currents[channel];
                // Toward zero, for a large current would be found as such.
                *code =
                    if *up.get_or_insert(*code < 2048) { (*code + off).min(4095) } else { code.saturating_sub(off) };
            })
        }
        Defect::LostPeriod => Box::new(|sample| sample.lost = LostPeriods::counted(1)),
        Defect::HallAtRail => Box::new(move |sample| sample.halls[channel] = 4095),
        Defect::HallAtGround => Box::new(move |sample| sample.halls[channel] = 0),
        Defect::HallsShorted => Box::new(move |sample| {
            let other = (channel + 1) % halls;
            let both = (sample.halls[channel] + sample.halls[other]) / 2;
            (sample.halls[channel], sample.halls[other]) = (both, both);
        }),
        Defect::HallFrozen => {
            let mut held = None;
            Box::new(move |sample| {
                let code = &mut sample.halls[channel];
                *code = *held.get_or_insert(*code);
            })
        }
        Defect::HallWeak => {
            let gain = random.random_range(0.1..0.9);
            scaled(&bench.parameters, channel..channel + 1, gain)
        }
        Defect::HallStrong => {
            let gain = random.random_range(1.1..1.6);
            scaled(&bench.parameters, channel..channel + 1, gain)
        }
        Defect::HallsWeak => {
            let gain = random.random_range(0.1..0.9);
            scaled(&bench.parameters, 0..halls, gain)
        }
        Defect::HallOffset => {
            let amplitude = bench.parameters.halls[channel].amplitude_v * random.random_range(0.1..1.2);
            let off = codes_of(&bench.parameters, if up { amplitude } else { -amplitude });
            Box::new(move |sample| sample.halls[channel] = in_range(f64::from(sample.halls[channel]) + off))
        }
        Defect::HallsSwapped => Box::new(move |sample| sample.halls.swap(channel % 2, 1 - channel % 2)),
        Defect::ThirdAtRail => Box::new(move |sample| sample.halls[channel] = if up { 4095 } else { 0 }),
        _ => return Ok(None),
    }))
}

/// Some of the sensors show so much of their field.
fn scaled(parameters: &PlantParameters, which: Range<usize>, gain: f64) -> Disturb {
    let zero = parameters.halls.map(|hall: HallParameters| codes_of(parameters, hall.offset_v));
    Box::new(move |sample| {
        for channel in which.clone() {
            let code = &mut sample.halls[channel];
            *code = in_range(zero[channel] + gain * (f64::from(*code) - zero[channel]));
        }
    })
}

/// What a voltage is to the ADC.
fn codes_of(parameters: &PlantParameters, volts: f64) -> f64 {
    volts / parameters.adc.reference_v * 4096.0
}

/// A code that the ADC has.
fn in_range(code: f64) -> u16 {
    code.round().clamp(0.0, 4095.0) as u16
}
