//! One scenario, all of it drawn from its seed: a machine, its settings, and what happens when.

use super::dice::Dice;
use super::disturbance::{self, Disturbance};
use super::wish::{self, Wish};
use super::{machine, setup};
use anyhow::{Context, Result};
use clap::ValueEnum;
use hallservo::settings::Settings;
use plant::PlantParameters;
use rig::motors::Motor;
use std::fmt::{self, Display};

/// How much is done to a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, clap::ValueEnum)]
pub enum Temper {
    /// Settings that fit, loads that the motor carries: nothing that a sound drive would have to end.
    Calm,
    /// Settings that fit, loads that drive it, shocks, supplies that dip: it may be switched off, by no current of its own.
    Driven,
    /// Settings hardly right, loads that drive it, shocks, supplies that dip: hardware that is whole.
    Rough,
    /// And something breaks.
    Broken,
}

/// Which scenarios.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Only {
    /// Only motors of the list whose name contains this
    #[arg(long, value_name = "TEXT")]
    pub motor: Option<String>,
    /// Only so much done to the drives
    #[arg(long, value_enum)]
    pub temper: Option<Temper>,
}

impl Display for Only {
    /// As options of the command line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(motor) = &self.motor {
            write!(f, " --motor {motor}")?;
        }
        match self.temper.and_then(|temper| temper.to_possible_value()) {
            Some(temper) => write!(f, " --temper {}", temper.get_name()),
            None => Ok(()),
        }
    }
}

/// What happens.
#[derive(Clone, Copy, Debug)]
pub(super) enum Happening {
    Wish(Wish),
    Disturbance(Disturbance),
}

/// What happens, and when, s.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event {
    pub at_s: f64,
    pub what: Happening,
}

/// A scenario.
pub(super) struct Scenario {
    pub seed: u64,
    pub temper: Temper,
    pub motor: Motor,
    pub plant: PlantParameters,
    pub settings: Settings,
    pub events: Vec<Event>,
    /// When the last of it is told, and how long it is left alone then, s.
    pub last_s: f64,
    pub rest_s: f64,
}

/// Of a drive that has been told its last for so long, it is asked whether it rests.
const LONG_REST_S: f64 = 12.0;

/// Motors that are tried.
const TRIES: u64 = 10;

impl Scenario {
    /// That of a seed.
    ///
    /// # Errors
    /// No settings fit the motor.
    pub fn new(seed: u64, only: &Only) -> Result<Self> {
        let mut dice = Dice::new(seed, 0);
        let temper = match dice.below(20) {
            0..9 => Temper::Calm,
            9..12 => Temper::Driven,
            12..15 => Temper::Rough,
            _ => Temper::Broken,
        };
        let temper = only.temper.unwrap_or(temper);
        let halls = if dice.chance(0.15) { 2 } else { 3 };
        let (last_s, rests) = (dice.between(1.0, 10.0), dice.chance(0.15));
        let (motor, plant, settings) = fitting(temper, seed, halls, only).context("no settings fit the motor")?;
        let mut events = commands(&mut Dice::new(seed, 3), temper, last_s);
        events.extend(disturbances(&mut Dice::new(seed, 4), temper, &motor, last_s));
        events.sort_by(|one, other| one.at_s.total_cmp(&other.at_s));
        let rest_s = if rests { LONG_REST_S } else { 3.0 };
        Ok(Self { seed, temper, motor, plant, settings, events, last_s, rest_s })
    }
}

/// A machine, and settings that the drive takes for it: some motors fit no board.
fn fitting(temper: Temper, seed: u64, halls: u8, only: &Only) -> Option<(Motor, PlantParameters, Settings)> {
    let mut dice = Dice::new(seed, 1);
    (0..TRIES).find_map(|number| {
        let motor = machine::motor(&mut dice, seed.wrapping_add(number << 32), only.motor.as_deref())?;
        let mut plant = machine::plant(&mut dice, &motor, temper, seed, halls);
        let settings = setup::draw(&mut Dice::new(seed, 2), &motor, &plant, temper, halls)?;
        machine::warms(&mut plant, &settings);
        Some((motor, plant, settings))
    })
}

/// What a user tells it: first of all to arm, then anything.
fn commands(dice: &mut Dice, temper: Temper, last_s: f64) -> Vec<Event> {
    let event = |at_s, wish| Event { at_s, what: Happening::Wish(wish) };
    let mut events = vec![event(0.02, Wish::Arm)];
    let pause_s = dice.between(0.05, 1.0);
    let mut at_s = 0.02;
    loop {
        at_s += pause_s * dice.between(0.2, 3.0);
        if at_s >= last_s {
            return events;
        }
        events.push(event(at_s, wish::draw(dice, temper)));
    }
}

/// What befalls it.
fn disturbances(dice: &mut Dice, temper: Temper, motor: &Motor, last_s: f64) -> Vec<Event> {
    let count = match temper {
        Temper::Calm => dice.below(4),
        Temper::Driven | Temper::Rough => 1 + dice.below(5),
        Temper::Broken => 1 + dice.below(4),
    };
    let mut events: Vec<_> = (0..count)
        .map(|_| Event {
            at_s: dice.within(0.5, last_s),
            what: Happening::Disturbance(disturbance::draw(dice, temper, motor)),
        })
        .collect();
    if temper == Temper::Broken {
        let breaks = |dice: &mut Dice| Event {
            at_s: dice.within(0.3, last_s),
            what: Happening::Disturbance(disturbance::breakage(dice)),
        };
        events.push(breaks(dice));
        if dice.chance(0.3) {
            events.push(breaks(dice));
        }
    }
    events
}

impl Display for Scenario {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "  {:?}", self.temper)?;
        writeln!(f, "  {}", machine::words(&self.motor, &self.plant))?;
        writeln!(f, "  {}", setup::words(&self.settings))?;
        for Event { at_s, what } in &self.events {
            match what {
                Happening::Wish(wish) => writeln!(f, "  {at_s:7.3} s  {wish:?}")?,
                Happening::Disturbance(disturbance) => writeln!(f, "  {at_s:7.3} s      {disturbance:?}")?,
            }
        }
        write!(f, "  {:7.3} s  left alone for {} s", self.last_s, self.rest_s)
    }
}
