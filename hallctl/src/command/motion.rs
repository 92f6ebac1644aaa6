//! Commands that turn the motor, and hold as long as the tool lives.

use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::Out;
use crate::{say, words};
use hallservo::control::impedance::Request;
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Status};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::time::Instant;

/// For how long.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Options {
    /// End after so long, by a command of zero: no voltage, no torque, else speed zero, which stops the motor; without,
    /// hold until Ctrl-C, which brakes for a moment and disarms
    #[arg(long, value_name = "SECONDS", value_parser = super::seconds)]
    seconds: Option<f64>,
    /// Command once and leave; the drive stops by itself after command_timeout_s
    #[arg(long, conflicts_with = "seconds")]
    once: bool,
}

/// What to follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Target {
    /// Share of the largest.
    Voltage(f32),
    /// N·m
    Torque(f32),
    /// rad/s
    Speed(f32),
    /// Turns
    Position(f64),
    /// A spring and a damper.
    Impedance(Request),
}

/// How long a motor may take to stop before the bridge is switched off, in the drive's time, ms.
const BRAKING_MS: u64 = 60;
/// The same where nothing is urgent: a heavy rotor from high speed.
const LONGEST_MS: u64 = 60_000;
/// Slower than this, it is at rest, rad/s.
pub(super) const AT_REST_RAD_S: f32 = 2.0;

impl Target {
    /// As a request.
    pub(super) const fn ask(self) -> Ask<'static> {
        match self {
            Self::Voltage(share) => Ask::Voltage(share),
            Self::Torque(torque) => Ask::Torque(torque),
            Self::Speed(speed) => Ask::Speed(speed),
            Self::Position(turns) => Ask::Position(turns),
            Self::Impedance(request) => Ask::Impedance(request),
        }
    }

    /// In its unit.
    pub(super) const fn value(self) -> f64 {
        match self {
            Self::Voltage(value) | Self::Torque(value) | Self::Speed(value) => value as f64,
            Self::Position(turns) => turns,
            Self::Impedance(_) => 0.0,
        }
    }

    /// What ends it when its time is over. On the way to a position, and where a spring pulls, the motor turns: it is
    /// stopped, as the drive does it after command_timeout_s.
    const fn end(self) -> Ask<'static> {
        match self {
            Self::Voltage(_) => Ask::Voltage(0.0),
            Self::Torque(_) => Ask::Torque(0.0),
            Self::Speed(_) | Self::Position(_) | Self::Impedance(_) => Ask::Speed(0.0),
        }
    }
}

/// Repeats a command until its time is over, and ends with another.
pub(super) fn hold(client: &mut Client, options: &Options, target: Target, out: Out) -> Result<()> {
    client.order(target.ask())?;
    if options.once {
        return super::done(out, Ok(()));
    }
    let began = client.status()?;
    if began.command_timeout_s.is_infinite() {
        crate::tell!("hallctl: command_timeout_s is infinite, so the motor goes on turning if the link breaks");
    }
    let line = ProgressBar::new_spinner();
    line.set_style(ProgressStyle::with_template("{msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()));
    let (mut last, mut look) = (began, (Instant::now(), began.uptime_ms));
    let end_ms = options.seconds.map(|seconds| began.uptime_ms + (1000.0 * seconds) as u64);
    while end_ms.is_none_or(|end| last.uptime_ms < end) {
        client.repeat(target.ask()).map_err(|error| fallen(client, error))?;
        last = client.status()?;
        if let Mode::Faulted(fault) = last.mode {
            return Err(Error::Failed(words::switched_off(fault)));
        }
        line.set_message(motion(&last, out));
        client.rest(&mut look, &last)?;
    }
    line.finish_and_clear();
    say!(out, "{}", motion(&last, out))?;
    out.value(&value(&last))?;
    client.repeat(target.end()).map_err(|error| fallen(client, error))
}

/// Brings the motor to rest, whatever turns it, and waits for that a little.
pub(super) fn brake(client: &mut Client) -> Result<()> {
    match client.order(Ask::Speed(0.0)) {
        // Without current control; or it is switched off, and nothing is left to be done.
        Err(Error::Refused(_)) => match client.order(Ask::Voltage(0.0)) {
            Err(Error::Refused(_)) => return Ok(()),
            result => result?,
        },
        result => result?,
    }
    let mut began_ms = None;
    loop {
        let status = client.status()?;
        let until_ms = *began_ms.get_or_insert(status.uptime_ms) + BRAKING_MS;
        let rests = match status.mode {
            Mode::Running => status.speed_rad_s.abs() <= AT_REST_RAD_S,
            // The speed is not known.
            Mode::Aligning | Mode::Calibrating => false,
            _ => true,
        };
        if rests || status.uptime_ms >= until_ms {
            return Ok(());
        }
    }
}

/// Brings the motor to rest, however long its acceleration takes.
pub(super) fn rest(client: &mut Client) -> Result<()> {
    let began = client.status()?;
    let mut look = (Instant::now(), began.uptime_ms);
    let mut ordered = client.order(Ask::Speed(0.0));
    loop {
        match ordered {
            // It is switched off or another tool's, and nothing is left to be done.
            Err(Error::Refused(_) | Error::Failed(_)) => return Ok(()),
            result => result?,
        }
        let status = client.status()?;
        if status.speed_rad_s.abs() <= AT_REST_RAD_S || status.uptime_ms >= began.uptime_ms + LONGEST_MS {
            return Ok(());
        }
        client.rest(&mut look, &status)?;
        ordered = client.repeat(Ask::Speed(0.0));
    }
}

/// A drive that refuses what it took before has a reason.
pub(super) fn fallen(client: &mut Client, error: Error) -> Error {
    match (client.status(), error) {
        (Ok(Status { mode: Mode::Faulted(fault), .. }), _) => Error::Failed(words::switched_off(fault)),
        (Ok(Status { mode: Mode::Ready | Mode::Unarmed, .. }), Error::Refused(_) | Error::Failed(_)) => {
            Error::Failed(words::STOPPED.into())
        }
        (_, error) => error,
    }
}

fn motion(status: &Status, out: Out) -> String {
    let current = if status.current_a.is_nan() { String::new() } else { format!(", {:.3} A", status.current_a) };
    let limits = words::limits(status.limits);
    let limits = if limits.is_empty() { String::new() } else { format!("; limited by {}", limits.join(", ")) };
    let (speed, position) = (out.units.speed(status.speed_rad_s), out.units.position(status.position_turns));
    format!("{speed} at {position}{current}{limits}")
}

fn value(status: &Status) -> Value {
    json!({
        "speed_rad_s": status.speed_rad_s,
        "position_turns": status.position_turns,
        "current_a": status.current_a,
        "limits": words::limits(status.limits),
    })
}
