//! Tells the drive what a scenario wants.

use super::super::judge::Breach;
use super::super::tool::Heard;
use super::super::wish::Wish;
use super::{Bout, Sabotage};
use anyhow::Result;
use hallservo::control::impedance::{Motion, Request};
use hallservo::mode::Mode;
use hallservo::settings::find;
use hallservo_protocol::{Ask, MagnetsAsk};

impl Bout<'_> {
    /// Tells it, and takes note of what it has to do from now on.
    pub(super) fn obey(&mut self, wish: Wish) -> Result<()> {
        let before = self.wish.replace(wish);
        let heard = match self.request(wish) {
            Some(ask) => {
                if !matches!(wish, Wish::Disarm | Wish::Clear) && turns_on(wish) {
                    // It may do so before the answer is here.
                    self.may_turn_on();
                }
                self.ask(ask)?
            }
            None => Heard::Other,
        };
        let done = heard == Heard::Done;
        let now_ms = self.drive.now_ms();
        match wish {
            Wish::Disarm if done => self.off_since_ms = Some(now_ms),
            Wish::Voltage(_) if done => self.judge.borrow_mut().allowed.controls = false,
            Wish::Torque(_) | Wish::Speed(_) | Wish::Move(_) | Wish::Spring(..) if done => {
                self.judge.borrow_mut().allowed.controls = true;
            }
            Wish::LearnCogging | Wish::LearnMagnets | Wish::Calibrate if done => {
                (self.turns, self.offset) = (true, None);
                self.judge.borrow_mut().allowed.controls = true;
            }
            _ => {}
        }
        if !done && turns_on(wish) && !self.drive.drive().mode().drives() {
            self.off_since_ms = Some(now_ms);
        }
        if let Heard::Setting(value) = heard {
            self.take_up(wish, value);
        }
        // What changes nothing of the motion leaves what it follows.
        if !done || !wish.moves() {
            self.wish = before;
        }
        if self.sabotage == Sabotage::Slips && self.drive.drive().mode() == Mode::Running && wish.moves() {
            self.slip()?;
        }
        Ok(())
    }

    /// The bridge may be on from now on.
    fn may_turn_on(&mut self) {
        self.off_since_ms = None;
        let allowed = &mut self.judge.borrow_mut().allowed;
        (allowed.is_off, allowed.is_still) = (false, false);
    }

    /// A whole electrical turn, which shows nowhere but in where the shaft is.
    fn slip(&mut self) -> Result<()> {
        let truth = self.drive.plant.truth();
        let turn_rad = std::f64::consts::TAU / f64::from(self.scenario.plant.motor.pole_pairs);
        Ok(self.drive.plant.place(truth.mechanical_angle_rad + turn_rad, truth.speed_rad_s)?)
    }

    /// The judge goes by the settings in use.
    fn take_up(&mut self, wish: Wish, value: f32) {
        let (Wish::Scale(name, _) | Wish::Set(name, _)) = wish else { return };
        if let Some(entry) = find(name)
            && entry.assign(&mut self.settings, value).is_ok()
            && let Some(control) = self.settings.control
        {
            self.judge.borrow_mut().configure(control);
        }
    }

    /// The request; none where there is nothing to ask for.
    fn request(&self, wish: Wish) -> Option<Ask<'static>> {
        let control = self.settings.control?;
        let pairs = f32::from(self.settings.pole_pairs);
        let torque_nm = 1.5 * pairs * control.flux_linkage_wb * control.max_current_a;
        let here = self.status.position_turns;
        Some(match wish {
            Wish::Arm => Ask::Arm,
            Wish::Disarm => Ask::Disarm,
            Wish::Clear => Ask::Clear,
            Wish::Voltage(share) => Ask::Voltage(share as f32),
            Wish::Torque(share) => Ask::Torque(0.99 * share as f32 * torque_nm),
            Wish::Speed(share) => Ask::Speed(0.999 * share as f32 * control.max_speed_rad_s),
            Wish::Move(turns) => Ask::Position(here + turns),
            Wish::Spring(stiffness, damping, turns) => {
                let kp = stiffness as f32 * torque_nm;
                let kd = 2.0 * damping as f32 * (kp * control.inertia_kgm2).sqrt();
                let motion = Motion::to(here + turns);
                Ask::Impedance(Request { kp_nm_rad: Some(kp), kd_nms_rad: Some(kd), motion, ..Request::default() })
            }
            Wish::Commutate(commutation) => Ask::Commutate(commutation),
            Wish::Scale(name, times) => {
                let value = find(name)?.get(&self.settings)? * times;
                Ask::Set { name, value }
            }
            Wish::Set(name, value) => Ask::Set { name, value },
            Wish::AntiCogging(on) => Ask::AntiCogging(on),
            Wish::LearnCogging => Ask::LearnCogging,
            Wish::LearnMagnets => Ask::Magnets(MagnetsAsk::Learn),
            Wish::Calibrate => Ask::Calibrate,
        })
    }

    /// A wish that a sound drive has to grant.
    pub(super) fn demand(&mut self, wish: Wish) -> Result<bool> {
        let Some(ask) = self.request(wish) else { return Ok(false) };
        if turns_on(wish) {
            self.may_turn_on();
        }
        match self.ask(ask)? {
            Heard::Refused(why) => {
                self.say(Breach::StaysOff, format!("{wish:?} is refused: {why}"));
                Ok(false)
            }
            _ => {
                self.judge.borrow_mut().allowed.controls = true;
                self.wish = Some(wish);
                Ok(true)
            }
        }
    }
}

/// Whether it may switch the bridge on.
fn turns_on(wish: Wish) -> bool {
    matches!(wish, Wish::Arm | Wish::LearnCogging | Wish::LearnMagnets | Wish::Calibrate)
}

impl Wish {
    /// Whether it says what the motor is to do.
    fn moves(self) -> bool {
        !matches!(self, Self::Clear | Self::Scale(..) | Self::Set(..) | Self::AntiCogging(_) | Self::Commutate(_))
    }
}
