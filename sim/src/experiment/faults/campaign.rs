//! Faults injected at random times into running drives.

use super::injection::{INJECTIONS, Injection};
use super::summary::{Found, Summary, settings};
use crate::rig::Rig;
use anyhow::{Context, Result, bail};
use hallservo::board::Legs;
use hallservo::commutation::Commutation;
use hallservo::drive::{Command, Demand, Refusal};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use plant::PlantParameters;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// One drive and what befalls it.
pub(super) struct Campaign {
    rig: Rig,
    random: Pcg64,
    summary: Summary,
    /// What the drive was last told to follow.
    demand: Demand,
}

impl Campaign {
    pub fn new(seed: u64) -> Result<Self> {
        let mut rig = Rig::new(&PlantParameters::imperfect(seed), &settings(), seed)?;
        rig.calibrate(|_| ())?;
        let summary = Summary { seed, bridge_off_within_one_period: true, ..Summary::default() };
        Ok(Self { rig, random: Pcg64::seed_from_u64(seed), summary, demand: Demand::Voltage })
    }

    pub fn run(mut self, injections: u32) -> Result<Summary> {
        for _ in 0..injections {
            let injection = *INJECTIONS.choose(&mut self.random).context("no faults")?;
            self.set_off(injection)?;
            let before = self.quiet()?;
            let found = match (before, injection) {
                (Some(_), _) => {
                    self.summary.false_alarms += 1;
                    Found::default()
                }
                (None, Injection::CurrentOffset) => self.refused(injection)?,
                (None, _) => self.inject(injection)?,
            };
            let right = found.fault.is_some_and(|fault| injection.is(fault));
            self.summary.count(injection.name(), right, &found, injection.at_once());
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
        self.demand = match self.random.random_range(0..3) {
            _ if injection.needs_motion() => {
                Demand::Speed(control.speed(sign * self.random.random_range(30.0..120.0))?)
            }
            0 => Demand::Current(control.current(sign * self.random.random_range(0.0..0.03))?),
            1 => Demand::Speed(control.speed(sign * self.random.random_range(0.0..120.0))?),
            _ => {
                let here = self.rig.drive.tracker().position().to_turns() / f64::from(self.rig.config.pole_pairs.get());
                Demand::Position(control.position(here + self.random.random_range(-1.0..1.0))?)
            }
        };
        self.follow_demand()
    }

    /// Commands what is to be followed, once more: a sign of life that changes nothing.
    fn follow_demand(&mut self) -> Result<()> {
        self.rig.command(match self.demand {
            Demand::Current(current) => Command::Current(current),
            Demand::Speed(speed) => Command::Speed(speed),
            Demand::Position(position) => Command::Position(position),
            Demand::Voltage => bail!("no demand was made"),
        })
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

    /// A sign of life, which a drive that has failed meanwhile refuses.
    fn alive(&mut self) -> Result<()> {
        match self.follow_demand() {
            Err(error) if !error.is::<Refusal>() => Err(error),
            _ => Ok(()),
        }
    }

    /// Breaks something.
    fn inject(&mut self, injection: Injection) -> Result<Found> {
        self.rig.disturb = injection.disturb(&mut self.random);
        let forward = self.random.random_bool(0.5);
        match injection {
            Injection::OverSpeed => self.dyno(Some(if forward { 260.0 } else { -260.0 }))?,
            Injection::Stall => self.dyno(Some(0.0))?,
            _ => {}
        }
        let start = self.electrical_turns();
        let mut found = Found::default();
        while !injection.deadline().has_passed(found.periods, found.turns) {
            let output = self.rig.step().output;
            found.periods += 1;
            found.turns = (self.electrical_turns() - start).abs();
            if let Mode::Faulted(fault) = self.rig.drive.mode() {
                self.summary.bridge_off_within_one_period &= output.legs == Legs::NONE;
                found.fault = Some(fault);
                break;
            }
            if found.periods % 400 == 0 && injection != Injection::CommandTimeout {
                self.alive()?;
            }
        }
        Ok(found)
    }

    /// Where the rotor really is.
    fn electrical_turns(&self) -> f64 {
        self.rig.plant.truth().mechanical_angle_rad / TAU * f64::from(self.rig.config.pole_pairs.get())
    }

    /// An amplifier that is off before arming.
    fn refused(&mut self, injection: Injection) -> Result<Found> {
        self.rig.command(Command::Disarm)?;
        self.rig.disturb = injection.disturb(&mut self.random);
        self.rig.run(0.1, |_, _| ());
        let refusal = self.rig.command(Command::Arm).err().context("armed with a wrong amplifier")?;
        match refusal.downcast::<hallservo::drive::Refusal>() {
            Ok(hallservo::drive::Refusal::Fault(fault)) => Ok(Found { fault: Some(fault), periods: 1, turns: 0.0 }),
            other => bail!("refused for {other:?}"),
        }
    }

    fn dyno(&mut self, speed: Option<f64>) -> Result<()> {
        Ok(self.rig.plant.set_dyno(speed)?)
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
