//! Every fault, injected at random times into running drives: found, told from the others, and the bridge off?

use super::Common;
use crate::report::{Plot, Report, Series, print_table};
use crate::rig::{Disturb, Rig};
use anyhow::{Context, Result, anyhow, bail};
use hallservo::commutation::{Commutation, Legs};
use hallservo::control::settings::{GuardSettings, OnTimeout, Settings as Control};
use hallservo::drive::{Command, Sample};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use plant::PlantParameters;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;
use std::collections::BTreeMap;

/// Options of `faults`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Faults to inject
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..))]
    injections: u32,
}

/// One kind of fault.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Kind {
    /// How often it was injected.
    pub injected: u32,
    /// Found, and told from the others.
    pub detected: u32,
    /// Most control periods from the first sample that shows it to the latched fault.
    pub worst_detection_periods: u32,
}

/// The figures of `faults --json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// Faults injected.
    pub injected: u32,
    /// Faults found.
    pub detected: u32,
    /// Faults not found, or taken for another.
    pub missed: u32,
    /// Faults reported where none was.
    pub false_alarms: u32,
    /// Running periods without a fault, in all.
    pub quiet_periods: u64,
    /// Of the faults that one sample of a voltage, a current or the clock shows: most periods to the latched fault.
    pub worst_detection_periods: u32,
    /// Whether the step that latched a fault always switched the bridge off.
    pub bridge_off_within_one_period: bool,
    /// Each kind.
    pub kinds: BTreeMap<&'static str, Kind>,
}

/// What is done to the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Injection {
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
    OverSpeed,
    Stall,
    CommandTimeout,
}

const INJECTIONS: [Injection; 14] = [
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
    Injection::OverSpeed,
    Injection::Stall,
    Injection::CommandTimeout,
];

impl Injection {
    fn name(self) -> &'static str {
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
            Self::OverSpeed => "over-speed",
            Self::Stall => "stall",
            Self::CommandTimeout => "command timeout",
        }
    }

    /// Whether one sample shows it.
    fn at_once(self) -> bool {
        matches!(self, Self::OverVoltage | Self::UnderVoltage | Self::OverCurrent | Self::Deadline)
    }

    fn is(self, fault: Fault) -> bool {
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
            Self::OverSpeed => fault == Fault::OverSpeed,
            Self::Stall => fault == Fault::Stall,
            Self::CommandTimeout => fault == Fault::CommandTimeout,
        }
    }

    /// Longest time that it may take, in periods.
    fn deadline(self) -> u32 {
        match self {
            Self::OverVoltage | Self::UnderVoltage | Self::OverCurrent | Self::Deadline => 1,
            Self::BridgeHot | Self::MotorHot => 8,
            Self::CurrentImbalance => 20,
            Self::HallAtRail | Self::HallAtGround => 9,
            // Where the two agree for the moment, the rotor has to turn on: half a turn at the slowest speed.
            Self::HallsShorted => 8000,
            Self::CurrentOffset => 1,
            // The tracker has to follow the leap of speed.
            Self::OverSpeed => 400,
            Self::Stall => 8000,
            Self::CommandTimeout => TIMEOUT_PERIODS + 8,
        }
    }

    fn disturb(self, random: &mut Pcg64) -> Option<Disturb> {
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
            // At least 0.5 A, with a margin for noise and offset; at most what the offset may not be.
            Self::CurrentImbalance => {
                let off = random.random_range(140..400_u16);
                Box::new(move |sample| {
                    let code = &mut sample.currents[channel];
                    *code = if up { *code + off } else { *code - off };
                })
            }
            Self::CurrentOffset => {
                let off = random.random_range(140..400_u16);
                Box::new(move |sample| {
                    let code = &mut sample.currents[channel];
                    *code = if up { *code + off } else { *code - off };
                })
            }
            Self::BridgeHot => Box::new(|sample| sample.temperatures[0] = 300),
            Self::MotorHot => Box::new(|sample| sample.temperatures[1] = 200),
            Self::Deadline => Box::new(|sample| sample.lost = 1),
            Self::HallAtRail => Box::new(move |sample| sample.halls[channel] = 4095),
            Self::HallAtGround => Box::new(move |sample| sample.halls[channel] = 0),
            Self::HallsShorted => Box::new(move |sample| {
                let other = (channel + 1) % 3;
                let both = (sample.halls[channel] + sample.halls[other]) / 2;
                (sample.halls[channel], sample.halls[other]) = (both, both);
            }),
            Self::OverSpeed | Self::Stall | Self::CommandTimeout => return None,
        })
    }
}

const TIMEOUT_PERIODS: u32 = 1200;

fn settings() -> Settings {
    let guard = GuardSettings {
        stall_s: 0.02,
        command_timeout_s: TIMEOUT_PERIODS as f32 / 40e3,
        on_timeout: OnTimeout::Fault,
        ..GuardSettings::default()
    };
    let control = Control { max_speed_rad_s: 150.0, guard, ..Control::default() };
    Settings { control: Some(control), max_electrical_hz: 150.0, ..Settings::default() }
}

/// `faults`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses without a reason.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let summary = run(options.common.seed, options.injections)?;
    println!("Faults at random times (seed {}):\n", options.common.seed);
    let rows = summary.table();
    print_table(&rows);
    println!(
        "\n  {} injected, {} detected, {} missed, {} false alarms in {} quiet periods",
        summary.injected, summary.detected, summary.missed, summary.false_alarms, summary.quiet_periods
    );
    let mut report = Report::new("Faults");
    report.text("Faults injected at random times into drives that follow currents, speeds and positions with all three commutations.");
    report.table(&rows);
    let points =
        summary.kinds.values().enumerate().map(|(k, kind)| (k as f64, f64::from(kind.worst_detection_periods)));
    let series = vec![Series::new("worst", points)];
    report.plot(
        &Plot::new("Longest detection", "kind, in the order of the table", "control periods", series),
        "A stall, a timeout and two Halls that agree for the moment take the time that is set, or that the rotor needs to turn on.",
    )?;
    options.common.finish("faults", &summary, &report)
}

/// Injects so many faults.
///
/// # Errors
/// A drive that refuses without a reason.
pub fn run(seed: u64, injections: u32) -> Result<Summary> {
    const CAMPAIGNS: u64 = 8;
    let campaign = |number: u64| {
        let share = injections / CAMPAIGNS as u32 + u32::from(number < u64::from(injections) % CAMPAIGNS);
        Campaign::new(seed.wrapping_mul(CAMPAIGNS) + number)?.run(share)
    };
    let mut total = Summary { seed, bridge_off_within_one_period: true, ..Summary::default() };
    for part in crate::parallel(0..CAMPAIGNS, campaign) {
        total.add(&part?);
    }
    Ok(total)
}

impl Summary {
    fn add(&mut self, part: &Self) {
        self.injected += part.injected;
        self.detected += part.detected;
        self.missed += part.missed;
        self.false_alarms += part.false_alarms;
        self.quiet_periods += part.quiet_periods;
        self.worst_detection_periods = self.worst_detection_periods.max(part.worst_detection_periods);
        self.bridge_off_within_one_period &= part.bridge_off_within_one_period;
        for (name, kind) in &part.kinds {
            let sum = self.kinds.entry(name).or_default();
            sum.injected += kind.injected;
            sum.detected += kind.detected;
            sum.worst_detection_periods = sum.worst_detection_periods.max(kind.worst_detection_periods);
        }
    }

    fn table(&self) -> Vec<Vec<String>> {
        let head = ["fault", "injected", "detected", "longest detection, periods"].map(String::from).to_vec();
        let rows = self.kinds.iter().map(|(name, kind)| {
            vec![
                (*name).to_string(),
                kind.injected.to_string(),
                kind.detected.to_string(),
                kind.worst_detection_periods.to_string(),
            ]
        });
        std::iter::once(head).chain(rows).collect()
    }
}

/// One drive and what befalls it.
struct Campaign {
    rig: Rig,
    random: Pcg64,
    summary: Summary,
}

impl Campaign {
    fn new(seed: u64) -> Result<Self> {
        let mut rig = Rig::new(&PlantParameters::unkind(seed), &settings(), seed)?;
        rig.calibrate(|_| ())?;
        let summary = Summary { seed, bridge_off_within_one_period: true, ..Summary::default() };
        Ok(Self { rig, random: Pcg64::seed_from_u64(seed), summary })
    }

    fn run(mut self, injections: u32) -> Result<Summary> {
        for _ in 0..injections {
            let injection = *INJECTIONS.choose(&mut self.random).context("no faults")?;
            self.set_off(injection)?;
            let before = self.quiet()?;
            let (fault, periods) = match (before, injection) {
                (Some(_), _) => {
                    self.summary.false_alarms += 1;
                    (None, 0)
                }
                (None, Injection::CurrentOffset) => self.refused(injection)?,
                (None, _) => self.inject(injection)?,
            };
            self.count(injection, fault, periods);
            self.recover()?;
        }
        Ok(self.summary)
    }

    /// Arms with a random commutation and demand.
    fn set_off(&mut self, injection: Injection) -> Result<()> {
        let commutation = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];
        let commutation = *commutation.choose(&mut self.random).context("no commutation")?;
        self.rig.command(Command::Commutate(commutation))?;
        self.rig.command(Command::Arm)?;
        self.demand(injection)
    }

    /// Commands something at random that lets the injection show.
    fn demand(&mut self, injection: Injection) -> Result<()> {
        let control = *self.rig.control()?;
        let sign = if self.random.random_bool(0.5) { 1.0 } else { -1.0 };
        let turning = matches!(injection, Injection::HallsShorted | Injection::Stall);
        let command = match self.random.random_range(0..3) {
            _ if turning => Command::Speed(control.speed(sign * self.random.random_range(30.0..120.0))?),
            0 => Command::Current(control.current(sign * self.random.random_range(0.0..0.03))?),
            1 => Command::Speed(control.speed(sign * self.random.random_range(0.0..120.0))?),
            _ => {
                let here = self.rig.drive.tracker().position().to_turns() / f64::from(self.rig.config.pole_pairs.get());
                Command::Position(control.position(here + self.random.random_range(-1.0..1.0))?)
            }
        };
        self.rig.command(command)
    }

    /// Runs for a random time with commands that come in time; a fault is a false alarm.
    fn quiet(&mut self) -> Result<Option<Fault>> {
        for k in 0..self.random.random_range(400..2000) {
            self.rig.step();
            self.summary.quiet_periods += 1;
            if let Mode::Faulted(fault) = self.rig.drive.mode() {
                return Ok(Some(fault));
            }
            if k % 400 == 399 {
                self.alive()?;
            }
        }
        Ok(None)
    }

    /// A sign of life that changes nothing.
    fn alive(&mut self) -> Result<()> {
        self.rig.service.send(Command::Balance(None)).map_err(|command| anyhow!("no room for {command:?}"))?;
        self.rig.step();
        self.rig.serve();
        Ok(())
    }

    /// Breaks something; which fault came after how many periods.
    fn inject(&mut self, injection: Injection) -> Result<(Option<Fault>, u32)> {
        self.rig.disturb = injection.disturb(&mut self.random);
        let forward = self.random.random_bool(0.5);
        match injection {
            Injection::OverSpeed => self.dyno(Some(if forward { 260.0 } else { -260.0 }))?,
            Injection::Stall => self.dyno(Some(0.0))?,
            _ => {}
        }
        for period in 1..=injection.deadline() {
            let output = self.rig.step().output;
            if let Mode::Faulted(fault) = self.rig.drive.mode() {
                self.summary.bridge_off_within_one_period &= output.legs == Legs::NONE;
                return Ok((Some(fault), period));
            }
            if period % 400 == 0 && injection != Injection::CommandTimeout {
                self.alive()?;
            }
        }
        Ok((None, injection.deadline()))
    }

    /// An amplifier that is off before arming.
    fn refused(&mut self, injection: Injection) -> Result<(Option<Fault>, u32)> {
        self.rig.command(Command::Disarm)?;
        self.rig.disturb = injection.disturb(&mut self.random);
        self.rig.run(0.1, |_, _| ());
        let refusal = self.rig.command(Command::Arm).err().context("armed with a wrong amplifier")?;
        match refusal.downcast::<hallservo::drive::Refusal>() {
            Ok(hallservo::drive::Refusal::Fault(fault)) => Ok((Some(fault), 1)),
            other => bail!("refused for {other:?}"),
        }
    }

    fn dyno(&mut self, speed: Option<f64>) -> Result<()> {
        self.rig.plant.set_dyno(speed).map_err(|error| anyhow!("{error}"))
    }

    fn count(&mut self, injection: Injection, fault: Option<Fault>, periods: u32) {
        let found = fault.is_some_and(|fault| injection.is(fault));
        let summary = &mut self.summary;
        summary.injected += 1;
        summary.detected += u32::from(found);
        summary.missed += u32::from(!found);
        let kind = summary.kinds.entry(injection.name()).or_default();
        kind.injected += 1;
        kind.detected += u32::from(found);
        if found {
            kind.worst_detection_periods = kind.worst_detection_periods.max(periods);
        }
        if found && injection.at_once() {
            summary.worst_detection_periods = summary.worst_detection_periods.max(periods);
        }
    }

    /// Mends everything and comes to rest.
    fn recover(&mut self) -> Result<()> {
        self.rig.disturb = None;
        self.dyno(Some(0.0))?;
        self.rig.run(0.05, |_, _| ());
        self.dyno(None)?;
        match self.rig.drive.mode() {
            Mode::Faulted(_) => self.rig.command(Command::Clear),
            Mode::Running => self.rig.command(Command::Disarm),
            _ => Ok(()),
        }
    }
}
