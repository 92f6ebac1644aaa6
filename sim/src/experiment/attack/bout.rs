//! One scenario from power-up to its end.

mod end;
mod obey;

use super::disturbance::Disturbance;
use super::judge::{Breach, Judge, Verdict};
use super::scenario::{Event, Happening, Scenario, Temper};
use super::tool::{Heard, PATIENCE_MS, Tool};
use super::trace::Trace;
use super::wish::Wish;
use super::world::World;
use anyhow::{Context, Result};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use hallservo_protocol::{Activity, Ask, Status};
use simulator::Simulator;
use simulator::flash::Flash;
use std::cell::RefCell;
use std::rc::Rc;

/// What is wrong with a drive that is attacked to see whether the judge sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Sabotage {
    /// Nothing.
    #[default]
    None,
    /// The motor stands only so much of the current that the settings say.
    WeakMotor(f64),
    /// It says that it has disarmed, and goes on.
    Deaf,
    /// The rotor slips an electrical turn that no sensor sees.
    Slips,
    /// Its line is dead.
    Mute,
}

/// How it ended.
#[derive(Clone, Debug)]
pub(super) struct Outcome {
    pub verdicts: Vec<Verdict>,
    /// Faults that it told, in order.
    pub faults: Vec<Fault>,
    /// Why nothing was attacked.
    pub idle: Option<String>,
    pub trace: Trace,
}

/// How often a tool looks at the drive, ms.
const LOOK_MS: u64 = 50;
/// Ways to calibrate, as commissioning tries them: speed of the field, Hz, share of the largest current, and time to raise
/// it, s.
const SWEEPS: [[f32; 3]; 4] = [[10.0, 0.33, 0.3], [4.0, 0.45, 6.0], [20.0, 0.45, 1.0], [2.0, 0.45, 6.0]];
/// After a shaft was seized or let go, its voltage is not what it was a sample before, ms.
const LEAP_MS: u64 = 50;
/// After this long with the bridge off no current is left in a winding, ms.
const DECAYED_MS: u64 = 60;

/// A drive under attack.
pub(super) struct Bout<'a> {
    scenario: &'a Scenario,
    drive: Simulator,
    tool: Tool,
    world: World,
    judge: Rc<RefCell<Judge>>,
    sabotage: Sabotage,
    settings: Settings,
    /// What it was told last.
    wish: Option<Wish>,
    /// Its bridge has been off, or has had to be, since, ms.
    off_since_ms: Option<u64>,
    /// A procedure turns the motor.
    turns: bool,
    faults: Vec<Fault>,
    faulted: bool,
    /// By how much the position that it tells differs from the true one, turns; none where it may begin anew.
    offset: Option<f64>,
    status: Status,
    looked_ms: u64,
}

impl<'a> Bout<'a> {
    /// At power-up.
    ///
    /// # Errors
    /// Settings or a plant that the simulator refuses.
    pub fn new(scenario: &'a Scenario, sabotage: Sabotage) -> Result<Self> {
        let Scenario { seed, plant, settings, .. } = scenario;
        let mut drive = Simulator::with(*settings, plant, *seed, Flash::blank(), Vec::new())?;
        let mut judge = Judge::new(scenario).context("a drive without current sensing")?;
        if let Sabotage::WeakMotor(share) = sabotage {
            judge.strictness = share;
        }
        let judge = Rc::new(RefCell::new(judge));
        let world = World::new(scenario);
        let (watch, converter) = (judge.clone(), world.converter());
        drive.observe = Some(Box::new(move |sample, truth| {
            watch.borrow_mut().look(truth);
            converter(sample);
        }));
        Ok(Self {
            scenario,
            drive,
            tool: Tool::default(),
            world,
            judge,
            sabotage,
            settings: *settings,
            wish: None,
            off_since_ms: Some(0),
            turns: false,
            faults: Vec::new(),
            faulted: false,
            offset: None,
            status: Status::default(),
            looked_ms: 0,
        })
    }

    /// Keeps what leads to a breach.
    pub fn tracing(self) -> Self {
        self.judge.borrow_mut().trace = Some(Trace::default());
        self
    }

    /// All of it.
    ///
    /// # Errors
    /// What the simulator cannot do.
    pub fn run(mut self) -> Result<Outcome> {
        self.wait(20)?;
        let mut idle = self.calibrate()?;
        if idle.is_none() {
            // A heavy rotor rocks on for long, and a user waits for it.
            self.coast()?;
            let from_ms = self.drive.now_ms();
            self.judge.borrow_mut().began_s = self.drive.plant.truth().time_s;
            for event in &self.scenario.events {
                self.wait_until(from_ms, event.at_s)?;
                self.happen(event)?;
            }
            self.wait_until(from_ms, self.scenario.last_s)?;
            if self.is_calm() {
                self.rest()?;
            }
            self.come_back()?;
        } else if self.scenario.temper == Temper::Calm && !self.faults.is_empty() {
            idle = idle.map(|why| format!("{why}, {:?}", self.faults));
        }
        self.drive.observe = None;
        let mut judge = self.judge.borrow_mut();
        let verdicts = std::mem::take(&mut judge.verdicts);
        let trace = judge.trace.take().unwrap_or_default();
        Ok(Outcome { verdicts, faults: std::mem::take(&mut self.faults), idle, trace })
    }

    fn is_calm(&self) -> bool {
        self.scenario.temper == Temper::Calm
    }

    fn say(&mut self, breach: Breach, said: String) {
        let at_s = self.drive.plant.truth().time_s;
        self.judge.borrow_mut().say_at(breach, at_s, said);
    }

    fn happen(&mut self, event: &Event) -> Result<()> {
        match event.what {
            Happening::Wish(wish) => self.obey(wish),
            Happening::Disturbance(disturbance) => self.befall(disturbance),
        }
    }

    fn befall(&mut self, what: Disturbance) -> Result<()> {
        self.world.happen(what, &mut self.drive)
    }

    /// Calibrates, as commissioning does, until a sweep succeeds; why none did.
    fn calibrate(&mut self) -> Result<Option<String>> {
        let largest_a = self.settings.control.map_or(0.0, |control| control.max_current_a);
        for [hertz, share, align_s] in SWEEPS {
            for (name, value) in [
                ("calibration_hz", hertz),
                ("calibration_align_s", align_s),
                ("calibration_current_a", share * largest_a),
                ("calibration_turns", 3.0),
            ] {
                self.ask(Ask::Set { name, value })?;
            }
            self.obey(Wish::Calibrate)?;
            self.finish_procedure(60_000)?;
            if self.drive.drive().mode() == Mode::Ready && self.ask(Ask::Calibration)? == Heard::Calibrated(true) {
                return Ok(None);
            }
            self.obey(Wish::Clear)?;
        }
        Ok(Some("no good calibration".into()))
    }

    /// Waits for what goes on; it may take so many ms.
    fn finish_procedure(&mut self, most_ms: u64) -> Result<()> {
        let until_ms = self.drive.now_ms() + most_ms;
        while self.drive.now_ms() < until_ms {
            self.wait(20)?;
            self.look()?;
            if self.status.activity == Activity::None {
                return Ok(());
            }
        }
        self.obey(Wish::Disarm)
    }

    fn wait_until(&mut self, from_ms: u64, seconds: f64) -> Result<()> {
        let until_ms = from_ms + (1000.0 * seconds) as u64;
        while self.drive.now_ms() < until_ms {
            self.pass()?;
            if self.drive.now_ms() >= self.looked_ms + LOOK_MS {
                self.look()?;
            }
        }
        Ok(())
    }

    fn wait(&mut self, milliseconds: u64) -> Result<()> {
        let from_ms = self.drive.now_ms();
        self.wait_until(from_ms, 1e-3 * milliseconds as f64)
    }

    /// A millisecond.
    fn pass(&mut self) -> Result<()> {
        self.drive.step();
        self.world.pass(&mut self.drive)?;
        let (mode, now_ms) = (self.drive.drive().mode(), self.drive.now_ms());
        if let Mode::Faulted(fault) = mode {
            self.off_since_ms = self.off_since_ms.or(Some(now_ms));
            if !self.faulted {
                self.on_fault(fault);
            }
        }
        self.faulted = matches!(mode, Mode::Faulted(_));
        let mut judge = self.judge.borrow_mut();
        judge.allowed.is_off = self.off_since_ms.is_some();
        judge.allowed.is_still = self.off_since_ms.is_some_and(|since| now_ms > since + DECAYED_MS);
        judge.allowed.is_driven = now_ms < self.world.driven_ms + 500 && self.world.driven_ms > 0;
        judge.allowed.is_blind = self.world.blind;
        judge.allowed.is_lost = self.world.broken;
        Ok(())
    }

    fn on_fault(&mut self, fault: Fault) {
        self.faults.push(fault);
        (self.offset, self.turns) = (None, false);
        let excused = fault == Fault::CommandTimeout || fault == Fault::Calibration;
        if self.is_calm() && !excused && self.wish != Some(Wish::Calibrate) {
            let truth = self.drive.plant.truth();
            let said = format!("{fault:?} after {:?}, at {:.1} rad/s", self.wish, truth.speed_rad_s);
            self.say(Breach::FalseAlarm, said);
        }
        // A supply that falls below the rotor's voltage lets the diodes drive the current.
        let generated_s = self.judge.borrow().generated_s;
        let generated = self.drive.plant.truth().time_s < generated_s + 1e-3 * LEAP_MS as f64;
        let leapt = self.world.leapt_ms.is_some_and(|at_ms| self.drive.now_ms() < at_ms + LEAP_MS);
        if self.scenario.temper == Temper::Driven && fault == Fault::OverCurrent && !leapt && !generated {
            let said = format!("after {:?}, at {:.1} rad/s", self.wish, self.drive.plant.truth().speed_rad_s);
            self.say(Breach::Overshoot, said);
        }
    }

    /// Sends a request and lets time pass until it is answered.
    fn ask(&mut self, ask: Ask<'_>) -> Result<Heard> {
        if self.sabotage == Sabotage::Deaf && ask == Ask::Disarm {
            return Ok(Heard::Done);
        }
        if self.sabotage != Sabotage::Mute {
            self.tool.send(&mut self.drive, ask)?;
        }
        for _ in 0..PATIENCE_MS {
            self.pass()?;
            if let Some(heard) = self.tool.hear(&mut self.drive) {
                return Ok(heard);
            }
        }
        self.say(Breach::Mute, format!("no answer to {ask:?}"));
        Ok(Heard::Other)
    }

    /// How it says that it is, which has to be true.
    fn look(&mut self) -> Result<()> {
        self.looked_ms = self.drive.now_ms();
        if let Heard::Status(status) = self.ask(Ask::Status)? {
            self.status = *status;
            self.compare_position();
        }
        Ok(())
    }

    /// A position that is counted from when the bridge was switched on.
    fn compare_position(&mut self) {
        if self.status.mode != Mode::Running {
            self.offset = None;
            return;
        }
        let truth = self.drive.plant.truth();
        let pairs = f64::from(self.scenario.plant.motor.pole_pairs);
        // What the answer is late by must not count.
        if truth.speed_rad_s.abs() * pairs > 60.0 {
            return;
        }
        let turns = truth.mechanical_angle_rad / std::f64::consts::TAU;
        let way = if self.settings.reversed { -1.0 } else { 1.0 };
        let offset = way * self.status.position_turns - turns;
        let before = *self.offset.get_or_insert(offset);
        // Halls that slip by so much count so.
        if !self.world.blind && (offset - before).abs() > 1.1 * super::judge::half_turn(pairs) {
            self.say(Breach::LostTurn, format!("{:.3} turns off", offset - before));
        }
    }
}
