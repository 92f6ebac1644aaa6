//! A recording while the motor follows a set-point that changes: armed before, if need be, and disarmed after.

use super::motion::{self, Target};
use crate::client::{Client, SHORT};
use crate::error::{Error, Result};
use crate::words;
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Status, Telemetry};
use std::time::Instant;

/// A moment of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trace {
    /// Of the drive, s.
    pub time_s: f64,
    /// What it was told.
    pub set: f64,
    /// What it did.
    pub measured: f64,
    /// Whatever is measured.
    pub speed_rad_s: f64,
    /// Along q; not a number where it is not measured.
    pub current_a: f64,
}

/// What of a moment is looked at.
pub(super) struct Moment<'a>(&'a Telemetry);

impl Moment<'_> {
    /// The position in turns, or the speed in rad/s.
    pub(super) fn position(&self, position: bool) -> f64 {
        if position { self.0.position_turns } else { self.0.speed_rad_s.into() }
    }
}

/// A recording.
pub(super) struct Session<'a> {
    client: &'a mut Client,
    began: Status,
    last: Option<Telemetry>,
    /// Control periods since the first frame.
    steps: u64,
    trace: Vec<Trace>,
    set: f64,
    target: Target,
    /// Whether it has commanded the drive.
    commands: bool,
}

impl<'a> Session<'a> {
    /// Arms, records what `work` does, and leaves the drive as it was found: disarmed if it was, otherwise at rest.
    pub(super) fn run<R>(
        client: &'a mut Client,
        hz: f32,
        work: impl FnOnce(&mut Session<'_>) -> Result<R>,
    ) -> Result<(R, Vec<Trace>)> {
        let found = client.status()?;
        if found.mode != Mode::Running {
            client.arm()?;
        }
        // What still turns by a command before would look like an answer to this one.
        let began = if found.speed_rad_s.abs() > motion::AT_REST_RAD_S {
            motion::rest(client)?;
            client.status()?
        } else {
            found
        };
        let target = Target::Speed(0.0);
        let result = Self::record(client, began, hz, target, work);
        let interrupted = matches!(result, Err(Error::Interrupted));
        if interrupted {
            client.carry_on();
        }
        client.end_telemetry()?;
        if interrupted {
            motion::brake(client)?;
        } else {
            motion::rest(client)?;
        }
        if interrupted || found.mode != Mode::Running {
            client.order(Ask::Disarm)?;
        }
        result
    }

    fn record<R>(
        client: &mut Client,
        began: Status,
        hz: f32,
        target: Target,
        work: impl FnOnce(&mut Session<'_>) -> Result<R>,
    ) -> Result<(R, Vec<Trace>)> {
        while client.telemetry().is_some() {}
        client.order(Ask::Telemetry(hz))?;
        let (trace, set) = (Vec::new(), 0.0);
        let mut session = Session { client, began, last: None, steps: 0, trace, set, target, commands: false };
        let result = work(&mut session)?;
        Ok((result, session.trace))
    }

    /// Position at the start, turns.
    pub(super) const fn began_turns(&self) -> f64 {
        self.began.position_turns
    }

    /// What was recorded after a time, s.
    pub(super) fn since(&self, time_s: f64) -> &[Trace] {
        &self.trace[self.trace.partition_point(|row| row.time_s <= time_s)..]
    }

    /// Time of the latest frame, s.
    pub(super) fn now_s(&self) -> f64 {
        self.steps as f64 / self.client.identity().step_hz
    }

    /// Tells the drive what `target` says of the time, for so many seconds of the drive's time.
    pub(super) fn follow(
        &mut self,
        seconds: f64,
        target: impl Fn(f64) -> Target,
        measured: impl Fn(&Moment<'_>) -> f64,
    ) -> Result<()> {
        let began = self.client.status()?;
        let end_ms = began.uptime_ms + (1000.0 * seconds) as u64;
        let (from_s, mut now_ms) = (self.now_s(), began.uptime_ms);
        let mut look = (Instant::now(), began.uptime_ms);
        while now_ms < end_ms {
            self.target = target(from_s + (now_ms - began.uptime_ms) as f64 / 1000.0);
            self.order().map_err(|error| motion::fallen(self.client, error))?;
            // What came before the answer followed the set-point before.
            self.take(&measured);
            self.set = self.target.value();
            let status = self.client.status()?;
            if let Mode::Faulted(fault) = status.mode {
                return Err(Error::Failed(words::switched_off(fault)));
            }
            now_ms = status.uptime_ms;
            self.client.pause(&mut look, &status, SHORT)?;
        }
        self.take(&measured);
        Ok(())
    }

    /// The first command takes the control, the next ones keep it.
    fn order(&mut self) -> Result<()> {
        match std::mem::replace(&mut self.commands, true) {
            false => self.client.order(self.target.ask()),
            true => self.client.repeat(self.target.ask()),
        }
    }

    fn take(&mut self, measured: &impl Fn(&Moment<'_>) -> f64) {
        while let Some(frame) = self.client.telemetry() {
            let steps = self.last.map_or(0, |last| frame.step.wrapping_sub(last.step));
            self.steps += u64::from(steps);
            self.last = Some(frame);
            let (time_s, measured) = (self.now_s(), measured(&Moment(&frame)));
            let (speed_rad_s, current_a) = (frame.speed_rad_s.into(), frame.current_a[1].into());
            self.trace.push(Trace { time_s, set: self.set, measured, speed_rad_s, current_a });
        }
    }
}
