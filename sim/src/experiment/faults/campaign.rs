//! Faults injected at random times into running drives.

use super::bench::{Bench, SLOW_RAD_S};
use super::defect::{Broken, Defect, mend};
use super::kind::{KINDS, Kind, MOST_WRONG, Outcome, Stage};
use super::machine::{Machine, Verdict};
use super::motion::Way;
use super::summary::{Found, Summary};
use super::two_halls;
use super::words;
use anyhow::{Context, Result, bail};
use hallservo::commutation::{Commutation, Modulation};
use hallservo::drive::{Command, Demand};
use hallservo::fault::Fault;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Periods in which a rotor that turns has made its electrical turn.
const LONGEST_TURN: u32 = 40_000;
/// Longest time in which a shaft comes to rest by its friction, s, and how slow one is that rests, rad/s.
const LONGEST_REST_S: f64 = 10.0;
const RESTS_RAD_S: f64 = 0.1;
/// Periods between a command and the next sign of life.
const ALIVE: u32 = 400;
/// Least current that a phase has to be due to be told open, a share of the full scale: what SAFETY.md says, not taken
/// from the code that is judged.
const SHOWS: f64 = 1.0 / 64.0;
/// By so much the check at arming turns a sound motor to and fro, electrical degrees.
const CHECK_DEG: f64 = 45.0;

/// A demand as a user makes it: positive is the user's positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wish {
    /// Share of the largest.
    Voltage(f64),
    /// A.
    Current(f64),
    /// rad/s.
    Speed(f64),
    /// So far from here, turns.
    By(f64),
}

/// One drive and what befalls it.
pub(super) struct Campaign {
    machine: Machine,
    random: Pcg64,
    summary: Summary,
    /// What the drive was last told to follow.
    wish: Wish,
    demand: Demand,
    commutation: Commutation,
}

impl Campaign {
    /// A machine at random, of which the calibration refuses none: it need not, but says so.
    ///
    /// # Errors
    /// The calibration refused one motor after the other.
    pub fn new(seed: u64, halls: u8) -> Result<Self> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut refused_motors = 0;
        let machine = loop {
            match Machine::new(Bench::draw(&mut random, seed, halls)?, seed) {
                Ok(machine) => break machine,
                Err(error) if refused_motors == 5 => return Err(error),
                Err(_) => refused_motors += 1,
            }
        };
        let commutation = Commutation::FieldOriented;
        let (wish, demand) = (Wish::Current(0.0), Demand::Voltage);
        Ok(Self {
            machine,
            random,
            summary: Summary { refused_motors, ..Summary::new(seed, halls) },
            wish,
            demand,
            commutation,
        })
    }

    /// Injects kinds whose name contains `only`.
    pub fn run(mut self, injections: u32, only: &str) -> Summary {
        let of_two = if self.machine.bench.halls() == 2 { two_halls::KINDS } else { &[] };
        let wanted = |kind: &&Kind| kind.fits(&self.machine.bench) && kind.name.contains(only);
        let kinds: Vec<_> = KINDS.iter().chain(of_two).filter(wanted).collect();
        for _ in 0..injections {
            let Some(mut kind) = kinds.choose(&mut self.random) else { break };
            while kind.is_long() && kinds.len() > 2 && self.random.random_bool(0.75) {
                let Some(another) = kinds.choose(&mut self.random) else { break };
                kind = another;
            }
            if let Err(error) = self.inject(kind).and_then(|()| self.recover()) {
                let why = format!("after {}: {error:#}", kind.name);
                *self.summary.abandoned.entry(why).or_default() += 1;
                break;
            }
        }
        self.summary.bridge_off_within_one_period = self.machine.off_at_once;
        self.summary
    }

    fn recover(&mut self) -> Result<()> {
        mend(&mut self.machine.rig, &mut self.machine.bench)?;
        self.machine.recover()
    }

    /// One injection from arming to its end.
    fn inject(&mut self, kind: &Kind) -> Result<()> {
        let commutation = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];
        self.commutation = *commutation.choose(&mut self.random).context("no commutation")?;
        self.machine.ask(Command::Commutate(self.commutation))??;
        if kind.stage == Stage::BeforeArming {
            return self.inject_before_arming(kind);
        }
        if let Some(verdict) = self.machine.arm()? {
            self.false_alarm(verdict, "arming");
            return Ok(());
        }
        self.wish = self.wish_for(kind);
        self.demand = Demand::Voltage;
        self.follow()??;
        self.load(kind)?;
        // A reversal from the speed that was commanded, not from the way there.
        let quiet = if kind.stage == Stage::Reversal { 10_000 } else { self.random.random_range(600..2400) };
        if let Some(verdict) = self.wait(quiet)? {
            self.false_alarm(verdict, "quiet");
            return Ok(());
        }
        self.machine.watch(self.way());
        let broken = self.break_it(kind)?;
        let mut verdict = None;
        if kind.stage == Stage::BeforeCommand {
            verdict = self.wait(400)?;
            if verdict.is_none() {
                self.wish = self.moving_wish();
                self.command_anew()?;
                self.machine.periods = 0;
            }
        }
        if kind.stage == Stage::Reversal
            && let Wish::Speed(speed) = self.wish
        {
            self.wish = Wish::Speed(-speed);
            self.command_anew()?;
        }
        self.judge(kind, broken, verdict)
    }

    /// What is wrong before the bridge is switched on, and came while the supply was off.
    fn inject_before_arming(&mut self, kind: &Kind) -> Result<()> {
        let supply_v = self.machine.bench.parameters.bus.supply_v;
        self.rest_at(0.0)?;
        let broken = self.break_it(kind)?;
        self.rest_at(supply_v)?;
        let pole_pairs = f64::from(self.machine.bench.parameters.motor.pole_pairs);
        self.machine.watch(Way::Check((CHECK_DEG / pole_pairs).to_radians()));
        let verdict = self.machine.arm()?;
        if verdict.is_none() {
            self.wish = self.moving_wish();
            self.command_anew()?;
        }
        self.judge(kind, broken, verdict)
    }

    /// A tenth of a second and more with the bridge off, at a voltage of the supply, until the shaft rests: nobody works
    /// at the wires of a motor that turns.
    fn rest_at(&mut self, supply_v: f64) -> Result<()> {
        self.machine.rig.plant.set_supply(supply_v)?;
        for _ in 0..self.machine.rig.periods(0.1) {
            self.machine.step();
        }
        for _ in 0..self.machine.rig.periods(LONGEST_REST_S) {
            if self.machine.rig.plant.truth().speed_rad_s.abs() < RESTS_RAD_S {
                return Ok(());
            }
            self.machine.step();
        }
        bail!("the shaft does not come to rest")
    }

    fn break_it(&mut self, kind: &Kind) -> Result<Broken> {
        let Machine { rig, bench, model, .. } = &mut self.machine;
        let broken = Broken::set(kind.defect, rig, bench, model, &mut self.random)?;
        self.machine.in_use = broken.model;
        match kind.defect {
            Defect::StuckTrigger => {
                let periods = self.random.random_range(2..400);
                self.machine.lose_trigger(periods);
            }
            Defect::Blocked => self.machine.held = true,
            Defect::Dragged => {
                let speed = 20.0 * self.sign();
                self.machine.hold(Some(speed))?;
            }
            _ => {}
        }
        Ok(broken)
    }

    /// Waits for what has to come, and counts it.
    fn judge(&mut self, kind: &Kind, broken: Broken, mut verdict: Option<Verdict>) -> Result<()> {
        let guard = self.machine.bench.settings.control.context("no current sensing")?.guard;
        let timeout_s = f64::from(guard.command_timeout_s);
        let start_turns = self.machine.electrical_turns();
        let before = self.machine.periods;
        let outcome = kind.outcome;
        let seconds = match outcome {
            Outcome::Named(seconds)
            | Outcome::NamedOrHarmless(seconds)
            | Outcome::NoFault(seconds)
            | Outcome::NotTooFast(seconds)
            | Outcome::NoHarm(seconds) => seconds,
            Outcome::AtRest(seconds) => seconds + timeout_s + f64::from(guard.stop_s),
            Outcome::NamedInATurn => f64::from(LONGEST_TURN) * self.machine.rig.period_s(),
        };
        let periods = self.machine.rig.periods(seconds);
        let silent = kind.is_long();
        let timeout = self.machine.rig.periods(timeout_s);
        let mut turns = 0.0;
        while verdict.is_none() && self.machine.periods - before < periods {
            if kind.defect == Defect::Driven {
                self.drive_on(self.machine.periods - before)?;
            }
            if silent && self.machine.periods - before == timeout {
                self.machine.go(Way::Stay);
            }
            verdict = self.machine.step().map(Verdict::Fault);
            turns = (self.machine.electrical_turns() - start_turns).abs();
            // The rotor goes on turning in the periods that are tolerated: two at the fastest speed are 0.01 turns.
            if outcome == Outcome::NamedInATurn && turns > 1.01 {
                break;
            }
            if verdict.is_none() && !silent && self.machine.periods.is_multiple_of(ALIVE) {
                let _ = self.follow()?;
            }
        }
        let found = self.found(kind, broken, verdict, turns);
        self.summary.count(kind.name, found, MOST_WRONG);
        Ok(())
    }

    fn found(&self, kind: &Kind, broken: Broken, verdict: Option<Verdict>, turns: f64) -> Found {
        let machine = &self.machine;
        let truth = machine.rig.plant.truth();
        let control = machine.bench.settings.control.unwrap_or_default();
        let motion = machine.motion.as_ref();
        let current_a = motion.map_or(0.0, |motion| motion.current_a);
        let harmless = current_a < f64::from(control.guard.over_current_a);
        let named = verdict.is_some_and(|verdict| {
            // Where it really was too large, that is what is wrong.
            let too_large = verdict == Verdict::Fault(Fault::OverCurrent)
                && broken.overloads()
                && current_a > 0.97 * f64::from(control.guard.over_current_a);
            too_large || broken.is_named_by(verdict, machine.bench.halls())
        });
        let over_speed = verdict.and_then(Verdict::fault) == Some(Fault::OverSpeed);
        let in_time = motion.map_or(0.0, |motion| motion.speed_rad_s) < self.over_speed_rad_s();
        let right = match kind.outcome {
            Outcome::Named(_) | Outcome::NamedInATurn => named,
            Outcome::AtRest(_) => (verdict.is_none() || named) && truth.speed_rad_s.abs() < 1.0,
            Outcome::NoFault(_) => verdict.is_none(),
            Outcome::NamedOrHarmless(_) => {
                let held = matches!(verdict, None | Some(Verdict::Fault(Fault::Stall | Fault::FollowingError)));
                // A phase is told to be open by its current: with a torque that asks for less than shows, the end is
                // the limit of the speed.
                let faint = broken.overloads() && self.asks_for_less_than_shows() && over_speed && in_time;
                named || (held || faint) && harmless
            }
            Outcome::NoHarm(_) => {
                let fault = verdict.and_then(Verdict::fault);
                named || matches!(fault, None | Some(Fault::Stall | Fault::FollowingError | Fault::OverSpeed))
            }
            Outcome::NotTooFast(_) => (verdict.is_none() || over_speed) && in_time,
        };
        let period_s = machine.rig.period_s();
        let fast_rad_s = motion.map_or(0.0, |motion| motion.speed_rad_s) - self.allowed_rad_s();
        let judged = matches!(kind.outcome, Outcome::NoHarm(_));
        Found {
            named: verdict.is_some(),
            fast: judged && fast_rad_s > 0.0,
            overloaded: judged && !harmless,
            reported: verdict.map_or("nothing".into(), Verdict::name),
            right,
            misnamed: !right && verdict.is_some(),
            seconds: f64::from(machine.periods) * period_s,
            turns,
            current_a,
            current: current_a / f64::from(control.guard.over_current_a),
            bus: motion.map_or(0.0, |motion| motion.bus_v) / f64::from(control.guard.over_voltage_v),
            wrong_deg: motion.map_or(0.0, |motion| motion.wrong_rad) / TAU * 360.0,
            wrong_ms: 1e3 * period_s * motion.map_or(0.0, |motion| f64::from(motion.wrong_periods)),
            on: format!("{}, {}", machine.bench.board.name, words::commutation(self.commutation)),
            at: format!(
                "{} wanted, at {:.0} rad/s, {} {}, {}",
                self.wish,
                truth.speed_rad_s,
                kind.name,
                broken.channel + 1,
                self.describe()
            ),
        }
    }

    fn describe(&self) -> String {
        let commutation = words::commutation(self.commutation);
        format!("{commutation}, seed {}, {}", self.summary.seed, self.machine.bench.describe())
    }

    fn false_alarm(&mut self, verdict: Verdict, when: &str) {
        let (wish, name) = (self.wish, verdict.name());
        let sort = match wish {
            _ if when == "arming" => "",
            Wish::Voltage(_) => " (voltage)",
            Wish::Current(_) => " (torque)",
            Wish::Speed(_) => " (speed)",
            Wish::By(_) => " (position)",
        };
        let at = format!("{wish} wanted, {}", self.describe());
        let commutation = words::commutation(self.commutation);
        self.summary.false_alarm(format!("{name}, {when}{sort}, {commutation}"), at);
    }

    /// Periods in which nothing should happen.
    fn wait(&mut self, periods: u32) -> Result<Option<Verdict>> {
        for k in 0..periods {
            self.summary.quiet_periods += 1;
            if let Some(fault) = self.machine.step() {
                return Ok(Some(Verdict::Fault(fault)));
            }
            if k % ALIVE == ALIVE - 1 {
                let _ = self.follow()?;
            }
        }
        Ok(None)
    }

    fn sign(&mut self) -> f64 {
        if self.random.random_bool(0.5) { 1.0 } else { -1.0 }
    }

    /// Something outside takes the shaft from its speed to beyond the limit, with 3000 rad/s².
    fn drive_on(&mut self, periods: u32) -> Result<()> {
        let direction = self.truth_sign() * self.wish_sign();
        let ramp = 60.0 + 3000.0 * f64::from(periods) * self.machine.rig.period_s();
        self.machine.hold(Some(direction * ramp.min(1.4 * f64::from(SLOW_RAD_S))))
    }

    fn wish_sign(&self) -> f64 {
        let (Wish::Voltage(value) | Wish::Current(value) | Wish::Speed(value) | Wish::By(value)) = self.wish;
        if value == 0.0 { 0.0 } else { value.signum() }
    }

    /// The plant's direction of the user's positive.
    fn truth_sign(&self) -> f64 {
        if self.machine.bench.settings.reversed { -1.0 } else { 1.0 }
    }

    /// Where the shaft has to go by the wish.
    fn way(&self) -> Way {
        let here = self.machine.rig.plant.truth().mechanical_angle_rad;
        let sign = self.truth_sign() * self.wish_sign();
        match (self.wish, self.demand) {
            (_, _) if sign == 0.0 => Way::Stay,
            (Wish::By(_), Demand::Position(target)) => {
                let by = target.to_turns() - self.machine.rig.drive.tracker().position().to_turns();
                Way::To(here + self.truth_sign() * by * TAU / f64::from(self.machine.bench.parameters.motor.pole_pairs))
            }
            _ => Way::Round(sign),
        }
    }

    fn wish_for(&mut self, kind: &Kind) -> Wish {
        let sign = self.sign();
        match kind.stage {
            Stage::Turning | Stage::Loaded => Wish::Speed(sign * self.random.random_range(30.0..120.0)),
            Stage::Holding if kind.defect != Defect::Dragged && self.random.random_bool(0.5) => {
                Wish::Current(sign * self.random.random_range(0.3..0.6) * self.max_current())
            }
            Stage::Holding => Wish::By(0.0),
            Stage::BeforeCommand => Wish::Speed(0.0),
            Stage::FreeTorque => Wish::Current(sign * self.random.random_range(0.3..0.9) * self.max_current()),
            Stage::Reversal => Wish::Speed(sign * self.random.random_range(100.0..190.0)),
            Stage::Running | Stage::BeforeArming => self.moving_wish(),
        }
    }

    /// The speed that is a fault: a fifth above the largest, and 10 Hz electrical.
    fn over_speed_rad_s(&self) -> f64 {
        let max_speed_rad_s = self.machine.bench.settings.control.unwrap_or_default().max_speed_rad_s;
        1.2 * f64::from(max_speed_rad_s) + 10.0 * TAU / f64::from(self.machine.bench.parameters.motor.pole_pairs)
    }

    /// What a rotor may turn at: what was commanded, and what over-speed leaves above the largest speed; of a torque or
    /// a position that.
    fn allowed_rad_s(&self) -> f64 {
        let over_rad_s = self.over_speed_rad_s();
        let max_rad_s = f64::from(self.machine.bench.settings.control.unwrap_or_default().max_speed_rad_s);
        match self.wish {
            Wish::Speed(speed_rad_s) => speed_rad_s.abs() + over_rad_s - max_rad_s,
            Wish::Voltage(_) | Wish::Current(_) | Wish::By(_) => over_rad_s,
        }
    }

    /// A torque whose current is less than [`SHOWS`].
    fn asks_for_less_than_shows(&self) -> bool {
        let full_scale_a = self.machine.bench.settings.control.unwrap_or_default().current_full_scale_a;
        matches!(self.wish, Wish::Current(current_a) if current_a.abs() < SHOWS * f64::from(full_scale_a))
    }

    fn max_current(&self) -> f64 {
        f64::from(self.machine.bench.settings.control.unwrap_or_default().max_current_a)
    }

    /// The modulation at which the motor idles at a speed.
    fn modulation_of(&self, speed_rad_s: f64) -> f64 {
        let plant::PlantParameters { motor, bus, .. } = &self.machine.bench.parameters;
        let emf_v = speed_rad_s * f64::from(motor.pole_pairs) * motor.back_emf.flux_linkage_vs;
        (3_f64.sqrt() * emf_v / bus.supply_v).min(1.0)
    }

    /// Anything that moves the shaft.
    fn moving_wish(&mut self) -> Wish {
        let sign = self.sign();
        match self.random.random_range(0..7) {
            0 => Wish::Voltage(sign * self.random.random_range(0.2..0.6) * self.modulation_of(f64::from(SLOW_RAD_S))),
            1 | 2 => Wish::Current(sign * self.random.random_range(0.07..0.2)),
            3 | 4 => Wish::Speed(sign * self.random.random_range(20.0..120.0)),
            _ => Wish::By(sign * self.random.random_range(0.1..1.0)),
        }
    }

    /// What works against it.
    fn load(&mut self, kind: &Kind) -> Result<()> {
        let load_nm = self.random.random_range(8e-3..25e-3);
        match (kind.stage, self.wish) {
            (Stage::Loaded, _) => {
                let sign = self.truth_sign() * self.wish_sign();
                self.machine.rig.plant.set_load(sign * load_nm)?;
            }
            (Stage::Holding, Wish::Current(_)) => self.machine.hold(Some(0.0))?,
            (Stage::Holding, _) => {
                let sign = self.sign();
                self.machine.rig.plant.set_load(sign * load_nm)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Commands the wish from where the shaft is.
    fn follow(&mut self) -> Result<hallservo::drive::Reply> {
        let control = *self.machine.rig.control()?;
        if let Wish::By(turns) = self.wish {
            // Commanded once more, it is still the same place.
            if !matches!(self.demand, Demand::Position(_)) {
                let electrical = self.machine.rig.drive.tracker().position().to_turns();
                let here = electrical / f64::from(self.machine.rig.config.pole_pairs.get());
                self.demand = Demand::Position(control.position(here + turns)?);
            }
        } else {
            self.demand = Demand::Voltage;
        }
        let command = match (self.wish, self.demand) {
            (Wish::Voltage(modulation), _) => Command::Drive(Modulation::saturating_from_num(modulation)),
            (Wish::Current(amperes), _) => Command::Current(control.current(amperes as f32)?),
            (Wish::Speed(speed), _) => Command::Speed(control.speed(speed as f32)?),
            (Wish::By(_), Demand::Position(position)) => Command::Position(position),
            (Wish::By(_), _) => bail!("no position"),
        };
        self.machine.ask(command)
    }

    /// Another wish; the shaft is watched the way it is to go now. A refusal is the drive's to explain by a fault.
    fn command_anew(&mut self) -> Result<()> {
        self.demand = Demand::Voltage;
        let _ = self.follow()?;
        self.machine.go(self.way());
        Ok(())
    }
}
