//! From what a client wants to what the drive is told, one command after the other: a drive whose bridge is off has to
//! be armed first, a faulted one to be cleared.

use super::CLIENT;
use super::goal::{Goal, Order, Wish, turns};
use crate::encoder::Encoder;
use crate::tasks::Tasks;
use embedded_storage::nor_flash::NorFlash;
use hallservo::commutation::Modulation;
use hallservo::drive::{self, Command};
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo_protocol::{Activity, Refusal};
use hallservo_registers::axis::Refused;

/// Ticks until a control interrupt that does not answer is given up.
const PATIENCE: u32 = 100;

/// Ticks after which the drive tells of a new motion.
const UNSETTLED: u8 = 4;

/// What the drive was told and has not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Clear,
    Arm,
    Move,
    #[cfg(feature = "diagnostic")]
    Again,
}

/// The commands that are due.
pub(super) struct Sequence {
    /// What the drive is to do, and what after that.
    wish: Option<Wish>,
    next: Option<Wish>,
    /// What it does.
    pub doing: Option<Wish>,
    /// Whether a fault is to be cleared.
    clears: bool,
    told: Option<(Told, u32)>,
    /// The state that the drive's last answer tells, which its records tell later.
    mode: Option<Mode>,
    /// Why the drive does not do what is wished, until the client stops it.
    pub refused: Option<u8>,
    /// Whether the last command has timed out, until the client stops the drive.
    pub timed_out: bool,
    /// Ticks until what the drive tells is of what it does now.
    unsettled: u8,
    /// Where the client's position is zero, in 2⁻³² turns of the drive; and whether a client has said so.
    pub zero: i64,
    pub is_homed: bool,
}

impl Sequence {
    pub const fn new() -> Self {
        Self {
            wish: None,
            next: None,
            doing: None,
            clears: false,
            told: None,
            mode: None,
            refused: None,
            timed_out: false,
            unsettled: 0,
            zero: 0,
            is_homed: false,
        }
    }

    /// Whether the drive owes an answer.
    pub const fn waits(&self) -> bool {
        self.told.is_some()
    }

    /// Whether something is to be done that the drive has not been told.
    pub const fn has_wish(&self) -> bool {
        self.wish.is_some()
    }

    /// Whether something is to be done that has not begun.
    pub const fn prepares(&self) -> bool {
        self.wish.is_some() && self.doing.is_none()
    }

    /// The drive is to do something, armed if it is not.
    pub fn wish<F: NorFlash, E: Encoder>(&mut self, goal: Goal, tasks: &mut Tasks<F, E>) -> Result<(), Refused> {
        self.prepare(Wish { goal, zero: self.zero }, tasks)
    }

    fn prepare<F: NorFlash, E: Encoder>(&mut self, wish: Wish, tasks: &mut Tasks<F, E>) -> Result<(), Refused> {
        let faulted = matches!(tasks.mode(), Mode::Faulted(_)) || self.refused.is_some() || self.timed_out;
        if faulted || tasks.controller.is_other(CLIENT) || tasks.activity() != Activity::None {
            return Err(Refused);
        }
        wish.goal.order(tasks, wish.zero)?;
        tasks.controller.take(CLIENT, false, tasks.now_ms);
        (self.wish, self.next) = (Some(wish), None);
        Ok(())
    }

    /// The drive is to go on with what it does from where it is.
    pub fn recapture<F: NorFlash, E: Encoder>(&mut self, tasks: &mut Tasks<F, E>) -> Result<(), Refused> {
        let Wish { goal, zero } = self.doing.ok_or(Refused)?;
        let here = turns(tasks.position_fixed().wrapping_sub(zero));
        self.prepare(Wish { goal: goal.from(here).ok_or(Refused)?, zero }, tasks)?;
        self.next = goal.moves_on().map(|goal| Wish { goal, zero });
        Ok(())
    }

    /// Whether what the drive tells is of what the client wants, which may be the same as before.
    pub fn is_settled(&self) -> bool {
        let done = self.wish.is_none_or(|wish| self.doing.is_some_and(|doing| doing.is_same(&wish)));
        done && self.next.is_none() && self.unsettled == 0
    }

    /// What the drive does goes on, if it is this and nobody else has said anything since: false where it is over. Never
    /// a beginning, for somebody may just have stopped the drive.
    #[cfg(feature = "diagnostic")]
    pub fn renew<F: NorFlash, E: Encoder>(
        &mut self,
        motion: &hallservo_registers::axis::Command,
        tasks: &mut Tasks<F, E>,
    ) -> bool {
        let Ok(goal) = Goal::of(motion) else { return false };
        let is_same = |other: &Wish| other.goal.is_same(&goal);
        if self.refused.is_some() || self.timed_out || tasks.controller.client() != CLIENT {
            return false;
        }
        if self.wish.as_ref().is_some_and(is_same) || self.waits() {
            return true;
        }
        let Some(doing) = self.doing.filter(is_same) else { return false };
        self.wish.is_none() && tasks.mode() == Mode::Running && self.order(Told::Again, &doing, tasks).is_ok()
    }

    /// The bridge off at once, whoever controls; a fault is cleared, unless it is another tool's.
    pub fn stop<F: NorFlash, E: Encoder>(&mut self, tasks: &mut Tasks<F, E>) {
        let idle = self.wish.is_none() && self.doing.is_none() && !self.waits() && tasks.is_idle();
        self.clears = !tasks.controller.is_other(CLIENT);
        tasks.controller.end();
        (self.wish, self.doing, self.refused, self.timed_out) = (None, None, None, false);
        if !idle {
            tasks.cancel();
            // What the drive still owes is not for the next command.
            if self.told.take().is_some() {
                tasks.abandon_reply();
            }
            if tasks.disarm().is_ok() {
                tasks.abandon_reply();
            }
            self.mode = None;
        }
    }

    /// Once a millisecond.
    pub fn tick<F: NorFlash, E: Encoder>(&mut self, tasks: &mut Tasks<F, E>) {
        let checks = tasks.limits().contains(Limits::CHECKING);
        self.unsettled = if checks { UNSETTLED } else { self.unsettled.saturating_sub(1) };
        self.watch(tasks);
        if let Some((told, ticks)) = self.told {
            match tasks.take_reply() {
                Some(reply) => self.on_reply(told, reply, tasks),
                None if ticks < PATIENCE => {
                    self.told = Some((told, ticks + 1));
                    return;
                }
                None => {
                    tasks.abandon_reply();
                    self.give_up(Fault::Deadline.code());
                }
            }
        }
        self.proceed(tasks);
    }

    /// What ends a motion without the client.
    fn watch<F: NorFlash, E: Encoder>(&mut self, tasks: &mut Tasks<F, E>) {
        if tasks.controller.is_other(CLIENT) {
            (self.wish, self.doing) = (None, None);
        }
        if self.doing.is_some() {
            let timed_out = tasks.limits().contains(Limits::TIMEOUT);
            self.timed_out |= timed_out || tasks.mode() == Mode::Faulted(Fault::CommandTimeout);
        }
        if matches!(self.doing, Some(Wish { goal: Goal::Brake, .. }))
            && tasks.mode() == Mode::Running
            && !tasks.may_short()
        {
            // Something drives the rotor faster than the windings may be shorted.
            if self.told.is_some() {
                tasks.abandon_reply();
            }
            self.switch_off(super::axis::fault_code(Fault::OverCurrent), tasks);
        }
        if matches!(tasks.mode(), Mode::Faulted(_)) {
            (self.wish, self.doing) = (None, None);
        } else if self.timed_out {
            self.wish = None;
        }
    }

    /// Tells the drive what is next.
    fn proceed<F: NorFlash, E: Encoder>(&mut self, tasks: &mut Tasks<F, E>) {
        let mode = self.mode.take().unwrap_or(tasks.mode());
        let faulted = matches!(mode, Mode::Faulted(_));
        if core::mem::take(&mut self.clears) && faulted {
            self.clears = !self.tell(Told::Clear, Command::Clear, tasks);
            return;
        }
        let Some(wish) = self.wish else { return };
        match mode {
            Mode::Running => {
                if self.order(Told::Move, &wish, tasks).is_err() {
                    self.wish = None;
                }
            }
            Mode::Ready => match may_arm(tasks) {
                Ok(()) => _ = self.tell(Told::Arm, Command::Arm, tasks),
                Err(code) => self.give_up(code),
            },
            Mode::Unarmed => self.give_up(NOT_CALIBRATED),
            Mode::Aligning | Mode::Calibrating | Mode::Faulted(_) => self.wish = None,
        }
    }

    /// Tells the drive what to do.
    fn order<F: NorFlash, E: Encoder>(
        &mut self,
        told: Told,
        wish: &Wish,
        tasks: &mut Tasks<F, E>,
    ) -> Result<(), Refused> {
        match wish.goal.order(tasks, wish.zero)? {
            Order::Current(current) => _ = self.tell(told, Command::Current(current), tasks),
            Order::Short => _ = self.tell(told, Command::Drive(Modulation::ZERO), tasks),
            Order::Impedance(request) => match tasks.impedance(&request) {
                Ok(()) => self.told = Some((told, 0)),
                // The drive is still busy: at the next tick.
                Err(Refusal::NoAnswer) => {}
                Err(_) => return Err(Refused),
            },
        }
        Ok(())
    }

    fn give_up(&mut self, code: u8) {
        self.told = None;
        (self.wish, self.doing, self.refused) = (None, None, Some(code));
    }

    /// The same with the bridge off.
    fn switch_off<F: NorFlash, E: Encoder>(&mut self, code: u8, tasks: &mut Tasks<F, E>) {
        self.give_up(code);
        if tasks.mode().drives() && tasks.disarm().is_ok() {
            tasks.abandon_reply();
        }
    }

    /// False where the drive is still busy with another command: it is to be told at the next tick.
    fn tell<F: NorFlash, E: Encoder>(&mut self, told: Told, command: Command, tasks: &mut Tasks<F, E>) -> bool {
        let sent = tasks.send(command).is_ok();
        if sent {
            self.told = Some((told, 0));
        }
        sent
    }

    fn on_reply<F: NorFlash, E: Encoder>(&mut self, told: Told, reply: drive::Reply, tasks: &mut Tasks<F, E>) {
        self.told = None;
        match (told, reply) {
            (Told::Clear, Ok(())) => tasks.on_cleared(),
            (Told::Clear, Err(_)) => {}
            (Told::Arm, Ok(())) => self.mode = Some(Mode::Running),
            (Told::Move, Ok(())) => {
                if !self.doing.zip(self.wish).is_some_and(|(doing, wish)| doing.is_same(&wish)) {
                    self.unsettled = UNSETTLED;
                }
                self.doing = self.wish.take();
                self.wish = self.next.take();
            }
            #[cfg(feature = "diagnostic")]
            (Told::Again, Ok(())) => {}
            // It is in another state than its last record said.
            (_, Err(drive::Refusal::Mode(mode))) => self.mode = Some(mode),
            (_, Err(refusal)) => {
                self.next = None;
                if told == Told::Arm || self.doing.is_none() {
                    self.switch_off(code_of(&refusal), tasks);
                } else {
                    // It goes on with what it does.
                    self.wish = None;
                }
            }
        }
    }
}

/// Their number for a motor that was not calibrated.
const NOT_CALIBRATED: u8 = 36;
/// … for a position that is not known.
const POSITION_INVALID: u8 = 43;
/// … for settings that were changed.
const CONFIG_CHANGED: u8 = 41;

fn may_arm<F: NorFlash, E: Encoder>(tasks: &Tasks<F, E>) -> Result<(), u8> {
    if tasks.unconfirmed {
        return Err(CONFIG_CHANGED);
    }
    tasks.encoder.may_move(true, &tasks.settings).map_err(|refusal| match refusal {
        Refusal::Drive(refusal) => code_of(&refusal),
        _ => POSITION_INVALID,
    })
}

/// The number of what the drive refuses.
fn code_of(refusal: &drive::Refusal) -> u8 {
    match refusal {
        drive::Refusal::Fault(fault) => super::axis::fault_code(*fault),
        drive::Refusal::NotCalibrated => NOT_CALIBRATED,
        drive::Refusal::OutOfBounds => super::axis::fault_code(Fault::PositionBounds),
        drive::Refusal::HallLost | drive::Refusal::NoAngle => 42,
        _ => super::axis::fault_code(Fault::FollowingError),
    }
}
