//! Commands that turn the motor, and hold as long as the tool lives.

use crate::client::Client;
use crate::error::{Error, Result};
use crate::words;
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Status};
use indicatif::{ProgressBar, ProgressStyle};
use std::time::Instant;

/// What to command, and for how long.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Options<T: Clone + Send + Sync + std::str::FromStr + 'static>
where
    T::Err: std::error::Error + Send + Sync + 'static,
{
    /// What to follow
    pub value: T,
    /// End after so long, by a command of zero; without, hold until Ctrl-C
    #[arg(long, value_name = "SECONDS", value_parser = super::seconds)]
    seconds: Option<f64>,
    /// Command once and leave; the drive stops by itself after command_timeout_s
    #[arg(long, conflicts_with = "seconds")]
    once: bool,
}

/// Repeats a command until its time is over, and ends with another.
pub(super) fn hold<T>(client: &mut Client, options: &Options<T>, ask: Ask<'_>, end: Option<Ask<'_>>) -> Result<()>
where
    T: Clone + Send + Sync + std::str::FromStr + 'static,
    T::Err: std::error::Error + Send + Sync + 'static,
{
    client.order(ask)?;
    if options.once {
        return Ok(());
    }
    let began = client.status()?;
    if began.command_timeout_s.is_infinite() {
        eprintln!("hallctl: command_timeout_s is infinite, so the motor goes on turning if this tool dies");
    }
    let line = ProgressBar::new_spinner();
    line.set_style(ProgressStyle::with_template("{msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()));
    let (mut last, mut look) = (began, (Instant::now(), began.uptime_ms));
    let end_ms = options.seconds.map(|seconds| began.uptime_ms + (1000.0 * seconds) as u64);
    while end_ms.is_none_or(|end| last.uptime_ms < end) {
        client.order(ask).map_err(|error| fallen(client, error))?;
        last = client.status()?;
        if let Mode::Faulted(fault) = last.mode {
            return Err(Error::Failed(switched_off(fault)));
        }
        line.set_message(motion(&last));
        client.rest(&mut look, &last)?;
    }
    line.finish_and_clear();
    println!("{}", motion(&last));
    end.map_or(Ok(()), |end| client.order(end))
}

/// A drive that refuses what it took before has a reason.
fn fallen(client: &mut Client, error: Error) -> Error {
    match client.status() {
        Ok(Status { mode: Mode::Faulted(fault), .. }) => Error::Failed(switched_off(fault)),
        _ => error,
    }
}

fn switched_off(fault: Fault) -> String {
    format!("the drive switched off: {fault}\n  {}; then `hallctl clear`.", fault.advice())
}

fn motion(status: &Status) -> String {
    let current = if status.current_a.is_nan() { String::new() } else { format!(", {:.3} A", status.current_a) };
    let limits = words::limits(status.limits);
    let limits = if limits.is_empty() { String::new() } else { format!("; limited by {}", limits.join(", ")) };
    format!("{:.2} rad/s at {:.4} turns{current}{limits}", status.speed_rad_s, status.position_turns)
}
