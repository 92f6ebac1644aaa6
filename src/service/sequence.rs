//! The sequence of every procedure that turns the motor: arming, demands, time-outs, braking, disarming.

use super::procedure::{Error, LEAST_RECORD_HZ, State};
use super::{Event, Service};
use crate::commutation::Commutation;
use crate::config::Config;
use crate::control::{self, Current, Speed};
use crate::drive::{Command, Refusal};
use crate::fault::Limits;
use crate::mode::Mode;
use crate::telemetry::Record;

/// Longest wait for an answer or a record beside three records' time, ms.
const ANSWER_MS: u32 = 200;
/// Time of braking beyond what the largest acceleration needs, in which the rotor has to lose an eighth of its speed: a
/// heavy one brakes slowly on a supply that takes nothing back. And from then to rest, ms.
const BRAKING_MS: u32 = 1000;
const REST_MS: u32 = 100;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Preparing,
    Arming,
    /// The drive has agreed to arm, and checks what it is connected to.
    Armed,
    Running,
    Braking,
    Disarming,
    Restoring,
    Over,
}

/// What a sequence asks the drive to follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Demand {
    Speed(Speed),
    Current(Current),
}

impl Demand {
    const REST: Self = Self::Speed(Speed(0));
}

/// Takes a drive from rest to running and back.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Sequence {
    phase: Phase,
    /// To return to at the end.
    commutation: Commutation,
    /// The phase whose command is not answered yet.
    unanswered: Option<Phase>,
    started: bool,
    /// Whether one came since the last step.
    has_record: bool,
    failure: Option<Error>,
    now_ms: u32,
    record_ms: u32,
    since_ms: u32,
    answer_ms: u32,
    braking_ms: u32,
    /// Speed at the begin of that.
    slowing: i32,
    /// Speed below which the rotor is at rest, in 2⁻³² electrical turns a step.
    rest: i32,
    demand: Demand,
    /// The last record, and when it came.
    record: Option<Record>,
}

impl Sequence {
    /// The current control of a drive that can do one.
    pub fn possible(config: &Config) -> Result<&control::Config, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        if control.scale.step_hz / (config.record_every as f32) < LEAST_RECORD_HZ {
            return Err(Error::FewRecords);
        }
        Ok(control)
    }

    /// For a drive, which returns to a commutation at the end.
    // Made of what has been looked at, it is not moved with a result over the stack.
    pub fn new(config: &Config, control: &control::Config, commutation: Commutation) -> Self {
        let record_hz = control.scale.step_hz / config.record_every as f32;
        let braking_s = control.braking_s();
        Self {
            phase: Phase::Preparing,
            commutation,
            demand: Demand::REST,
            failure: None,
            unanswered: None,
            started: false,
            record: None,
            has_record: false,
            now_ms: 0,
            record_ms: 0,
            since_ms: 0,
            answer_ms: ANSWER_MS + (3000.0 / record_hz) as u32,
            braking_ms: BRAKING_MS + (1000.0 * braking_s) as u32,
            slowing: i32::MAX,
            rest: control.trajectory.speed() / 50,
        }
    }

    /// Takes what the service delivered.
    pub fn event(&mut self, event: &Event) {
        if let Event::Record(record) = event {
            self.record = Some(*record);
            self.has_record = true;
        }
    }

    /// One step; true while the drive runs and follows the demand of the procedure.
    pub fn step(&mut self, service: &mut Service, now_ms: u32) -> bool {
        self.now_ms = now_ms;
        if !core::mem::replace(&mut self.started, true) {
            self.since_ms = now_ms;
            self.has_record = true;
        }
        if core::mem::take(&mut self.has_record) {
            self.record_ms = now_ms;
        }
        if self.phase == Phase::Over {
            return false;
        }
        if let Some(reply) = service.procedure_answer()
            && self.unanswered.take() == Some(self.phase)
        {
            self.on_reply(reply);
        }
        self.check_drive();
        self.check_time();
        if self.phase == Phase::Over && self.failure == Some(Error::NoAnswer) {
            // Should it recover, it is not to turn on.
            let _ = service.send_internal(Command::Disarm);
        }
        if self.unanswered.is_none()
            && let Some(command) = self.command()
            && service.send_for_procedure(command).is_ok()
        {
            self.unanswered = Some(self.phase);
        }
        self.phase == Phase::Running
    }

    fn on_reply(&mut self, reply: Result<(), Refusal>) {
        match (self.phase, reply) {
            (Phase::Preparing, Ok(())) => self.enter(Phase::Arming),
            (Phase::Arming, Ok(())) => self.enter(Phase::Armed),
            (Phase::Disarming, _) => self.enter(Phase::Restoring),
            (Phase::Restoring, _) => self.enter(Phase::Over),
            (_, Ok(())) => {}
            // The drive has left the state running; its next record says why.
            (Phase::Armed | Phase::Running | Phase::Braking, Err(Refusal::Mode(_))) => {}
            (_, Err(refusal)) => self.fail(Error::Refused(refusal)),
        }
    }

    /// Checks what the drive has done by itself: a fault, or no record for too long.
    fn check_drive(&mut self) {
        if self.now_ms.wrapping_sub(self.record_ms) > self.answer_ms {
            // No command would be answered.
            self.failure.get_or_insert(Error::NoAnswer);
            self.enter(Phase::Over);
        }
        let mode = self.mode();
        match (self.phase, mode) {
            (Phase::Armed | Phase::Running | Phase::Braking, Some(Mode::Faulted(fault))) => {
                self.failure.get_or_insert(Error::Fault(fault));
                self.enter(Phase::Restoring);
            }
            (Phase::Running | Phase::Braking, Some(mode)) if mode != Mode::Running => {
                self.failure.get_or_insert(Error::Disarmed);
                self.enter(Phase::Restoring);
            }
            // The check takes its time, which is not that of the procedure.
            (Phase::Armed, Some(Mode::Running)) if !self.checks() => self.enter(Phase::Running),
            _ => {}
        }
    }

    /// What has taken its time, or too long.
    fn check_time(&mut self) {
        let elapsed = self.elapsed_ms();
        match self.phase {
            Phase::Preparing | Phase::Arming if elapsed > self.answer_ms => self.fail(Error::NoAnswer),
            // It was switched on, and its records say that it is off: a command has come during the check.
            Phase::Armed if elapsed > self.answer_ms && !self.checks() => self.fail(Error::Disarmed),
            Phase::Disarming | Phase::Restoring if elapsed > self.answer_ms => {
                self.failure.get_or_insert(Error::NoAnswer);
                self.enter(Phase::Over);
            }
            Phase::Braking if elapsed > self.braking_ms => self.fail(Error::NotReached),
            Phase::Braking if elapsed > REST_MS && self.speed().abs() <= self.rest => self.enter(Phase::Disarming),
            Phase::Braking if self.speed().abs() < self.slowing - (self.slowing >> 3) => {
                (self.slowing, self.since_ms) = (self.speed().abs(), self.now_ms);
            }
            _ => {}
        }
    }

    /// The command for the drive now. A demand is repeated, for the drive has a command time-out.
    fn command(&self) -> Option<Command> {
        Some(match self.phase {
            Phase::Preparing => Command::Commutate(Commutation::FieldOriented),
            Phase::Arming => Command::Arm,
            Phase::Running | Phase::Braking => match self.demand {
                Demand::Speed(speed) => Command::Speed(speed),
                Demand::Current(current) => Command::Current(current),
            },
            Phase::Armed if self.checks() => Command::Speed(Speed(0)),
            Phase::Disarming => Command::Disarm,
            Phase::Restoring => Command::Commutate(self.commutation),
            Phase::Armed | Phase::Over => return None,
        })
    }

    /// Whether the drive checks what it is connected to.
    fn checks(&self) -> bool {
        self.record.is_some_and(|record| record.status.limits().contains(Limits::CHECKING))
    }

    fn enter(&mut self, phase: Phase) {
        if self.phase != phase {
            self.phase = phase;
            self.since_ms = self.now_ms;
        }
    }

    /// Follows a demand from now on.
    pub fn follow(&mut self, demand: Demand) {
        if self.phase == Phase::Running {
            self.demand = demand;
        }
    }

    /// Goes to rest and ends.
    pub fn finish(&mut self) {
        if self.phase == Phase::Running {
            self.demand = Demand::REST;
            self.enter(Phase::Braking);
        }
    }

    /// Ends at once, with the rotor at rest.
    pub fn release(&mut self) {
        if self.phase == Phase::Running {
            self.enter(Phase::Disarming);
        }
    }

    /// Ends without a result: from turning, by braking.
    pub fn cancel(&mut self, error: Error) {
        if self.phase == Phase::Over {
            return;
        }
        self.failure.get_or_insert(error);
        match self.phase {
            Phase::Preparing => self.enter(Phase::Restoring),
            Phase::Arming | Phase::Armed => self.enter(Phase::Disarming),
            _ => self.finish(),
        }
    }

    /// Ends with the bridge off at once.
    fn fail(&mut self, error: Error) {
        self.failure.get_or_insert(error);
        match self.phase {
            Phase::Preparing => self.enter(Phase::Restoring),
            Phase::Arming | Phase::Armed | Phase::Running | Phase::Braking => self.enter(Phase::Disarming),
            Phase::Disarming | Phase::Restoring | Phase::Over => {}
        }
    }

    /// Where the procedure is; `result` when it went well.
    #[inline(never)]
    pub const fn state(&self) -> State {
        match (self.phase, self.failure) {
            (Phase::Over, Some(error)) => State::Failed(error),
            (Phase::Over, None) => State::Done,
            _ => State::Running,
        }
    }

    /// Time in this phase, ms.
    pub const fn elapsed_ms(&self) -> u32 {
        self.now_ms.wrapping_sub(self.since_ms)
    }

    /// The task's clock at the last step, ms.
    pub const fn now_ms(&self) -> u32 {
        self.now_ms
    }

    fn mode(&self) -> Option<Mode> {
        self.record.map(|record| record.status.mode())
    }

    /// Speed of the rotor in the last record, 2⁻³² electrical turns a step.
    pub fn speed(&self) -> i32 {
        self.record.map_or(0, |record| record.rotor.speed())
    }
}
