//! A drive at a bench, watched.

use super::bench::{Bench, COOL};
use super::defect::WATCHDOG_S;
use super::motion::{Motion, Way};
use anyhow::{Context, Result, bail};
use hallservo::board::{Legs, LostPeriods};
use hallservo::drive::{Command, Refusal, Reply};
use hallservo::fault::{Fault, Limits};
use hallservo::hall::model::Model;
use hallservo::hall::plausibility::Implausible;
use hallservo::mode::Mode;
use hallservo::service::Event;
use hallservo::service::adaptation::{Watch, torque_nm};
use hallservo::telemetry::Record;
use rig::Rig;
use std::f64::consts::TAU;

/// Longest check when the bridge is switched on, s.
const LONGEST_CHECK_S: f64 = 1.3;

/// A drive that has been calibrated, its motor, and the watch on its shaft.
pub(super) struct Machine {
    pub rig: Rig,
    pub bench: Bench,
    /// As it was calibrated, and what it takes for that.
    pub model: Model,
    pub in_use: Model,
    pub motion: Option<Motion>,
    /// Something outside imposes the motion.
    pub held: bool,
    /// Periods since the watch began.
    pub periods: u32,
    /// Whether every step that latched a fault switched the bridge off.
    pub off_at_once: bool,
    /// What the tasks make of the records of two Halls.
    watch: Watch,
    reply: Option<Reply>,
}

/// How the drive ended, or why it did not begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    Fault(Fault),
    Refused(Refusal),
}

impl Verdict {
    pub fn name(self) -> String {
        match self {
            Self::Fault(fault) | Self::Refused(Refusal::Fault(fault)) => fault.to_string(),
            Self::Refused(refusal) => format!("refused: {refusal}"),
        }
    }

    /// A refusal names the fault, too.
    pub fn fault(self) -> Option<Fault> {
        match self {
            Self::Fault(fault) | Self::Refused(Refusal::Fault(fault)) => Some(fault),
            Self::Refused(_) => None,
        }
    }
}

impl Machine {
    pub fn new(bench: Bench, seed: u64) -> Result<Self> {
        let mut rig = Rig::new(&bench.parameters, &bench.settings, seed)?;
        rig.temperatures = bench.temperatures();
        let model = rig.calibrate(|_| ()).with_context(|| bench.describe())?.model;
        rig.wait(0.2);
        let mut watch = Watch::none();
        watch.begin(bench.halls() == 2);
        Ok(Self {
            rig,
            bench,
            model,
            in_use: model,
            motion: None,
            held: false,
            periods: 0,
            off_at_once: true,
            watch,
            reply: None,
        })
    }

    /// Watches the shaft from here on.
    pub fn watch(&mut self, way: Way) {
        self.motion = Some(Motion::new(way, &self.bench.parameters.motor, &self.rig.plant.truth()));
        self.periods = 0;
    }

    /// The shaft is to go this way now.
    pub fn go(&mut self, way: Way) {
        let truth = self.rig.plant.truth();
        if let Some(motion) = &mut self.motion {
            motion.turn_to(way, &truth);
        }
    }

    /// One period; the fault if there is one.
    pub fn step(&mut self) -> Option<Fault> {
        self.rig.temperatures = self.bench.temperatures();
        let before = self.rig.drive.mode();
        let period = self.rig.step();
        self.periods += 1;
        if let Some(motion) = &mut self.motion {
            // What rolls on with the bridge off, as while a rotor is watched before a wrong commutation is named, is driven
            // no more; where the bridge is on again, all of the way since counts.
            let is_driven = !self.held && period.output.legs != Legs::NONE;
            motion.look(&period.truth, !is_driven, self.rig.period_s());
        }
        if self.periods.is_multiple_of(40) {
            self.serve();
        }
        let Mode::Faulted(fault) = self.rig.drive.mode() else { return None };
        self.off_at_once &= before == Mode::Faulted(fault) || period.output.legs == Legs::NONE;
        Some(fault)
    }

    fn serve(&mut self) {
        let torque_nm = self.mean_torque_nm();
        while let Some(event) = self.rig.service.poll() {
            match event {
                Event::Reply(reply) => self.reply = Some(reply),
                Event::Record(record) => self.watch_halls(&record, torque_nm),
                _ => {}
            }
        }
    }

    /// Since the tasks looked last, as the drive measured it.
    fn mean_torque_nm(&mut self) -> f32 {
        let (mut sum, mut count) = (0.0, 0.0);
        while let Some(measurement) = self.rig.service.measurement() {
            sum += self.rig.config.control.map_or(0.0, |control| torque_nm(&measurement, &control));
            count += 1.0;
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// What the boards' tasks do with two Halls.
    fn watch_halls(&mut self, record: &Record, torque_nm: f32) {
        if self.watch.contradicts(record, &self.in_use, torque_nm, &self.rig.config) {
            let _ = self.rig.service.trip(Fault::Hall(Implausible::Inconsistent));
        }
    }

    /// Sends a command and waits for its answer.
    pub fn ask(&mut self, command: Command) -> Result<Reply> {
        self.serve();
        self.reply = None;
        self.rig.service.send(command)?;
        for _ in 0..400 {
            self.step();
            self.serve();
            if let Some(reply) = self.reply.take() {
                return Ok(reply);
            }
        }
        bail!("the drive did not answer")
    }

    /// Switches the bridge on and waits until it has been checked.
    pub fn arm(&mut self) -> Result<Option<Verdict>> {
        if let Err(refusal) = self.ask(Command::Arm)? {
            return Ok(Some(Verdict::Refused(refusal)));
        }
        for _ in 0..self.rig.periods(LONGEST_CHECK_S) {
            if let Some(fault) = self.step() {
                return Ok(Some(Verdict::Fault(fault)));
            }
            if !self.rig.drive.limits().contains(Limits::CHECKING) {
                return Ok(None);
            }
        }
        bail!("the check of the bridge did not come to an end")
    }

    /// No step for so many periods, and the board's watchdog.
    pub fn lose_trigger(&mut self, periods: u32) {
        let watchdog = self.rig.periods(WATCHDOG_S);
        for k in 0..periods {
            if k < watchdog {
                self.rig.plant.advance_untriggered(1);
            } else {
                self.rig.plant.advance(&plant::Legs::OFF);
            }
            self.periods += 1;
            if let Some(motion) = &mut self.motion {
                motion.look(&self.rig.plant.truth(), self.held, self.rig.period_s());
            }
        }
        let lost = LostPeriods::counted(periods.min(255) as u8);
        self.rig.disturb = Some(Box::new(move |sample| sample.lost = lost));
    }

    /// Where the rotor really is, in electrical turns.
    pub fn electrical_turns(&self) -> f64 {
        self.rig.plant.truth().mechanical_angle_rad / TAU * f64::from(self.bench.parameters.motor.pole_pairs)
    }

    /// Something outside imposes a speed, or lets go.
    pub fn hold(&mut self, speed_rad_s: Option<f64>) -> Result<()> {
        self.held = speed_rad_s.is_some();
        Ok(self.rig.plant.set_dyno(speed_rad_s)?)
    }

    /// Comes to rest, and leaves the faulted state.
    pub fn recover(&mut self) -> Result<()> {
        self.motion = None;
        self.bench.celsius = COOL;
        if self.rig.drive.mode() == Mode::Running {
            let _ = self.ask(Command::Disarm)?;
        }
        self.hold(Some(0.0))?;
        for _ in 0..self.rig.periods(0.05) {
            self.step();
        }
        self.hold(None)?;
        if matches!(self.rig.drive.mode(), Mode::Faulted(_)) {
            self.ask(Command::Clear)??;
        }
        self.in_use = self.model;
        super::defect::install(&mut self.rig, &self.model)?;
        match self.rig.drive.mode() {
            Mode::Ready => Ok(()),
            mode => bail!("not ready but {mode:?}"),
        }
    }
}
