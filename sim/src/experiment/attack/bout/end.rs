//! What a drive has to do in the end: rest where it was told to, and run again.

use super::super::dice::Dice;
use super::super::disturbance::torque_nm;
use super::super::judge::Breach;
use super::super::wish::Wish;
use super::Bout;
use anyhow::Result;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use std::f64::consts::TAU;

/// Longest check at arming, ms, a rotor that is held once more included.
const CHECK_MS: u64 = 2500;
/// Time in which a rotor coasts, before a hand stops it, ms.
const COAST_MS: u64 = 300;
/// Time for which the hand holds it, ms.
const HELD_MS: u64 = 150;
/// The last part of a rest, which is judged, ms.
const JUDGED_MS: u64 = 1000;
/// Share of the largest torque, effective, beyond its mean, from which on a rotor is swung.
const SWUNG: f64 = 0.15;

/// What a shaft did for a while.
#[derive(Default)]
struct Watched {
    count: f64,
    torque: f64,
    square: f64,
    least_rad: f64,
    most_rad: f64,
}

impl Bout<'_> {
    /// Arms where it is off, tells it a last thing, and judges what has become of that.
    pub(super) fn rest(&mut self) -> Result<()> {
        if self.judge.borrow().verdicts.iter().any(|verdict| verdict.breach == Breach::FalseAlarm) {
            return Ok(());
        }
        if self.turns {
            self.obey(Wish::Disarm)?;
            self.wait(100)?;
        }
        if self.drive.drive().mode() == Mode::Ready {
            self.coast()?;
            if !self.demand(Wish::Arm)? {
                return Ok(());
            }
            self.check()?;
        }
        let mut dice = Dice::new(self.scenario.seed, 6);
        let wish = match dice.below(4) {
            0 => Wish::Speed(0.0),
            1 => Wish::Speed(dice.share()),
            _ => Wish::Move(dice.share().signum() * dice.between(1e-3, 2.0)),
        };
        self.look()?;
        let here = self.status.position_turns;
        if !self.demand(wish)? {
            return Ok(());
        }
        self.wait((1000.0 * (self.scenario.rest_s + self.longest_s(wish))) as u64)?;
        self.judge_rest(wish, here)
    }

    /// How long a move or a change of the speed may take, s, from any speed.
    fn longest_s(&self, wish: Wish) -> f64 {
        let Some(control) = self.settings.control else { return 0.0 };
        let (speed, acceleration) = (f64::from(control.max_speed_rad_s), f64::from(control.max_acceleration_rad_s2));
        let turns = if let Wish::Move(turns) = wish { turns.abs() } else { 0.0 };
        (4.0 * speed / acceleration + 2.0 * TAU * turns / speed + 1.0 / f64::from(control.position_bandwidth_hz))
            .min(20.0)
    }

    fn judge_rest(&mut self, wish: Wish, here: f64) -> Result<()> {
        let watched = self.watch()?;
        let limits = self.drive.drive().limits();
        let fine = self.drive.drive().mode() == Mode::Running
            && !limits.contains(Limits::HEAT)
            && !limits.contains(Limits::TIMEOUT)
            && !limits.contains(Limits::CHECKING);
        if !fine {
            return Ok(());
        }
        let rms = watched.swing() / torque_nm(&self.scenario.motor);
        let turned = (watched.most_rad - watched.least_rad) / TAU;
        let pairs = f64::from(self.scenario.plant.motor.pole_pairs);
        let rests = !matches!(wish, Wish::Speed(share) if share != 0.0);
        if rests && rms > SWUNG && self.scenario.rest_s > 5.0 {
            self.say(Breach::Swings, format!("{rms:.2} of the largest torque, over {turned:.4} turns, after {wish:?}"));
        }
        match wish {
            Wish::Move(turns) => {
                self.look()?;
                let off = self.status.position_turns - (here + turns);
                if off.abs() > 0.03 + 0.05 / pairs {
                    self.say(Breach::Elsewhere, format!("{off:.3} turns from where it was told to be, {wish:?}"));
                }
            }
            Wish::Speed(share) => self.judge_speed(share, turned),
            _ => {}
        }
        Ok(())
    }

    fn judge_speed(&mut self, share: f64, turned: f64) {
        let Some(control) = self.settings.control else { return };
        let told = share * f64::from(control.max_speed_rad_s);
        let found = turned * TAU / (1e-3 * JUDGED_MS as f64);
        if (found - told.abs()).abs() > 0.05 * told.abs() + 0.02 * f64::from(control.max_speed_rad_s) + 1.0 {
            self.say(Breach::Elsewhere, format!("{found:.2} rad/s where {told:.2} were told"));
        }
    }

    /// What the shaft does for the last part of its rest.
    fn watch(&mut self) -> Result<Watched> {
        let truth = self.drive.plant.truth();
        let mut watched = Watched {
            least_rad: truth.mechanical_angle_rad,
            most_rad: truth.mechanical_angle_rad,
            ..Watched::default()
        };
        let until_ms = self.drive.now_ms() + JUDGED_MS;
        while self.drive.now_ms() < until_ms {
            self.pass()?;
            let truth = self.drive.plant.truth();
            watched.count += 1.0;
            watched.torque += truth.torque_nm;
            watched.square += truth.torque_nm * truth.torque_nm;
            watched.least_rad = watched.least_rad.min(truth.mechanical_angle_rad);
            watched.most_rad = watched.most_rad.max(truth.mechanical_angle_rad);
        }
        Ok(watched)
    }

    /// Waits for the check at arming.
    fn check(&mut self) -> Result<()> {
        self.wait(100)?;
        let until_ms = self.drive.now_ms() + CHECK_MS;
        while self.drive.now_ms() < until_ms && self.drive.drive().limits().contains(Limits::CHECKING) {
            self.wait(20)?;
        }
        Ok(())
    }

    /// Lets a rotor roll out; a hand stops it at last, and holds it until any tracker knows: nothing stops in no time.
    pub(super) fn coast(&mut self) -> Result<()> {
        let until_ms = self.drive.now_ms() + COAST_MS;
        while self.drive.now_ms() < until_ms && self.drive.plant.truth().speed_rad_s.abs() > 0.1 {
            self.wait(20)?;
        }
        self.drive.plant.set_dyno(Some(0.0))?;
        self.wait(HELD_MS)?;
        Ok(self.drive.plant.set_dyno(None)?)
    }

    /// All is mended, the shaft is at rest: it has to run again, if it has a calibration.
    pub(super) fn come_back(&mut self) -> Result<()> {
        self.world.mend(&mut self.drive)?;
        self.obey(Wish::Disarm)?;
        self.wait(300)?;
        self.coast()?;
        self.wait(700)?;
        if matches!(self.drive.drive().mode(), Mode::Faulted(_)) && !self.demand(Wish::Clear)? {
            return Ok(());
        }
        self.wait(300)?;
        self.look()?;
        // What was learnt or calibrated of broken Halls is another matter.
        if self.world.broken || self.drive.drive().mode() != Mode::Ready {
            return Ok(());
        }
        if !self.demand(Wish::Arm)? {
            return Ok(());
        }
        self.check()?;
        let mode = self.drive.drive().mode();
        if mode != Mode::Running && self.is_calm() {
            self.say(Breach::StaysOff, format!("{mode:?} when it is armed again"));
        }
        self.obey(Wish::Disarm)?;
        self.wait(200)
    }
}

impl Watched {
    /// Effective torque beyond its mean, N·m.
    fn swing(&self) -> f64 {
        let mean = self.torque / self.count;
        (self.square / self.count - mean * mean).max(0.0).sqrt()
    }
}
