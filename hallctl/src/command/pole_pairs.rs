//! Pole pairs: the drive counts electrical turns, a person turns the shaft.

use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::Out;
use crate::say;
use hallservo::angle::Position;
use hallservo::mode::Mode;
use hallservo::service::pole_pairs::{self, ByHand};
use hallservo_protocol::{Ask, Status};
use indicatif::ProgressBar;
use serde_json::json;
use std::io::{BufRead, stdin};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Instant;

const NAME: &str = "pole_pairs";

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Options {
    /// Turns of the shaft: one tells up to 14 pole pairs, five tell all. Without, you say how many you made
    #[arg(long, value_parser = crate::units::whole::<u8>(1..=255))]
    turns: Option<u8>,
    /// Take the number even if it is a multiple of the one set, or a part of it
    #[arg(long)]
    sure: bool,
}

pub(super) fn count(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    let set = client.setting(Ask::Get(NAME), |setting| setting.value)?;
    let assumed = f64::from(set);
    let mut count = ByHand::new(options.turns.unwrap_or(1));
    observe(client, &mut count, assumed)?;
    say!(out, "{}", request(options.turns))?;
    let lines = lines();
    let typed = follow(client, &mut count, assumed, &lines)?;
    let turns = match options.turns {
        Some(turns) => turns,
        None => made(client, &mut count, assumed, &lines, typed)?,
    };
    let count = count.finish_after(turns).map_err(failed)?;
    let found = f32::from(count.pole_pairs.get());
    say!(out, "{count}")?;
    if let Some(factor) = factor(found, set).filter(|_| !options.sure) {
        let less = if found > set { "more" } else { "fewer" };
        return Err(Error::Refused(format!(
            "{found} is {factor} times {less} than the {set} that are set: was the shaft turned by as much {less}?\n  \
             Count once more, or `hallctl pole-pairs --sure` if {found} is right."
        )));
    }
    client.setting(Ask::Set { name: NAME, value: found }, |_| ())?;
    say!(out, "{NAME} is {found} now; `hallctl settings save` keeps it.")?;
    out.value(&json!({ NAME: found, "off_deg": count.off_deg, "next_off_deg": count.next_off_deg }))
}

fn request(turns: Option<u8>) -> String {
    match turns {
        None => "Turn the shaft by hand, by whole turns in one direction: one, or five if it may have more than 14 \
                 pole pairs.\nThen type how many turns you made, and press Enter."
            .into(),
        Some(1) => "Turn the shaft by hand, by one whole turn in one direction, and press Enter.".into(),
        Some(turns) => format!("Turn the shaft by hand, by {turns} whole turns in one direction, and press Enter."),
    }
}

/// How many times as large the one is as the other, where it is a whole number: turns that were miscounted look so.
fn factor(a: f32, b: f32) -> Option<f32> {
    let ratio = a.max(b) / a.min(b);
    (ratio > 1.5 && ratio.fract() == 0.0).then_some(ratio)
}

/// The number of turns that a person says; whatever else is typed is asked for again.
fn made(
    client: &mut Client,
    count: &mut ByHand,
    assumed: f64,
    lines: &Receiver<String>,
    mut typed: String,
) -> Result<u8> {
    loop {
        match typed.trim().parse() {
            Ok(turns @ 1..) => return Ok(turns),
            _ => crate::tell!("How many whole turns was that? A number, and Enter."),
        }
        typed = follow(client, count, assumed, lines)?;
    }
}

/// Watches the rotor until a line is typed.
fn follow(client: &mut Client, count: &mut ByHand, assumed: f64, lines: &Receiver<String>) -> Result<String> {
    let line = ProgressBar::new_spinner();
    let mut last = (Instant::now(), client.status()?.uptime_ms);
    loop {
        let typed = match lines.try_recv() {
            Err(TryRecvError::Disconnected) => return Err(Error::Failed("nobody pressed Enter".into())),
            typed => typed.ok(),
        };
        let status = observe(client, count, assumed)?;
        if let Some(typed) = typed {
            line.finish_and_clear();
            return Ok(typed);
        }
        line.set_message(format!("{:.2} electrical turns", count.electrical_turns().map_err(failed)?));
        client.rest(&mut last, &status)?;
    }
}

/// Shows the counter where the rotor is, by the drive's status.
fn observe(client: &mut Client, count: &mut ByHand, assumed: f64) -> Result<Status> {
    let status = client.status()?;
    let electrical_turns = status.position_turns * assumed;
    count.observe((status.mode == Mode::Ready).then(|| Position::from_turns(electrical_turns)));
    count.electrical_turns().map_err(failed)?;
    Ok(status)
}

fn failed(error: pole_pairs::Error) -> Error {
    let next = match error {
        pole_pairs::Error::NotReady => "\n  `hallctl calibrate` first; where the bridge is on, `hallctl stop`.",
        _ => "",
    };
    Error::Failed(format!("{error}{next}"))
}

/// Lines on the standard input; disconnected where that ends.
fn lines() -> Receiver<String> {
    let (typed, lines) = channel();
    thread::spawn(move || {
        for line in stdin().lock().lines().map_while(std::result::Result::ok) {
            if typed.send(line).is_err() {
                return;
            }
        }
    });
    lines
}

#[cfg(test)]
mod tests {
    use super::factor;

    #[test]
    fn miscounted_turns_are_a_whole_factor() {
        assert_eq!(factor(8.0, 4.0), Some(2.0));
        assert_eq!(factor(4.0, 12.0), Some(3.0));
        assert_eq!(factor(4.0, 4.0), None);
        assert_eq!(factor(7.0, 4.0), None);
    }
}
