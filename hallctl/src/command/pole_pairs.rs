//! Pole pairs: the drive counts electrical turns, a person turns the shaft.

use crate::client::Client;
use crate::error::{Error, Result};
use anyhow::Context;
use hallservo::service::pole_pairs::{self, Count};
use hallservo_protocol::{Ask, Mode, Status};
use indicatif::ProgressBar;
use std::io::{BufRead, Write, stdin, stdout};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Instant;

const NAME: &str = "pole_pairs";

pub(super) fn count(client: &mut Client, turns: u8) -> Result<()> {
    let assumed = client.setting(Ask::Get(NAME), |setting| f64::from(setting.value))?;
    let first = ready(client)?;
    let way = if turns == 1 { "one whole turn".into() } else { format!("{turns} whole turns") };
    println!("Turn the shaft by hand, by {way} in one direction, and press Enter.");
    stdout().flush().context("the terminal")?;
    let last = follow(client, &first, assumed)?;
    let electrical = electrical_turns(&first, &last, assumed);
    let count = Count::of(electrical, turns).map_err(|error| Error::Failed(error.to_string()))?;
    println!("{count}");
    let value = f32::from(count.pole_pairs.get());
    client.setting(Ask::Set { name: NAME, value }, |_| ())?;
    println!("{NAME} is {value} now; `hallctl settings save` keeps it.");
    Ok(())
}

/// Watches the rotor until Enter.
fn follow(client: &mut Client, first: &Status, assumed: f64) -> Result<Status> {
    let (line, enter) = (ProgressBar::new_spinner(), enter());
    let mut look = (Instant::now(), first.uptime_ms);
    loop {
        let pressed = match enter.try_recv() {
            Err(TryRecvError::Disconnected) => return Err(Error::Failed("nobody pressed Enter".into())),
            pressed => pressed.is_ok(),
        };
        let status = ready(client)?;
        if pressed {
            line.finish_and_clear();
            return Ok(status);
        }
        line.set_message(format!("{:.2} electrical turns", electrical_turns(first, &status, assumed)));
        client.rest(&mut look, status.uptime_ms)?;
    }
}

/// A line on the standard input; disconnected where that ends without one.
fn enter() -> Receiver<()> {
    let (pressed, enter) = channel();
    thread::spawn(move || {
        if stdin().lock().read_line(&mut String::new()).is_ok_and(|length| length > 0) {
            // Nobody may listen any more.
            let _ = pressed.send(());
        }
    });
    enter
}

/// A drive that knows its angle with the bridge off.
fn ready(client: &mut Client) -> Result<Status> {
    match client.status()? {
        status @ Status { mode: Mode::Ready, .. } => Ok(status),
        _ => Err(Error::Failed(pole_pairs::Error::NotReady.to_string())),
    }
}

fn electrical_turns(first: &Status, last: &Status, assumed: f64) -> f64 {
    (last.position_turns - first.position_turns) * assumed
}
