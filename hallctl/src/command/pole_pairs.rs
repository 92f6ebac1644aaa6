//! Pole pairs: the drive counts electrical turns, a person turns the shaft.

use crate::client::Client;
use crate::error::{Error, Result};
use anyhow::Context;
use hallservo::angle::Position;
use hallservo::mode::Mode;
use hallservo::service::pole_pairs::{self, ByHand};
use hallservo_protocol::{Ask, Status};
use indicatif::ProgressBar;
use std::io::{BufRead, Write, stdin, stdout};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Instant;

const NAME: &str = "pole_pairs";

pub(super) fn count(client: &mut Client, turns: u8) -> Result<()> {
    let assumed = client.setting(Ask::Get(NAME), |setting| f64::from(setting.value))?;
    let mut count = ByHand::new(turns);
    observe(client, &mut count, assumed)?;
    let way = if turns == 1 { "one whole turn".into() } else { format!("{turns} whole turns") };
    println!("Turn the shaft by hand, by {way} in one direction, and press Enter.");
    stdout().flush().context("the terminal")?;
    follow(client, &mut count, assumed)?;
    let count = count.finish().map_err(failed)?;
    println!("{count}");
    let value = f32::from(count.pole_pairs.get());
    client.setting(Ask::Set { name: NAME, value }, |_| ())?;
    println!("{NAME} is {value} now; `hallctl settings save` keeps it.");
    Ok(())
}

/// Watches the rotor until Enter.
fn follow(client: &mut Client, count: &mut ByHand, assumed: f64) -> Result<()> {
    let (line, enter) = (ProgressBar::new_spinner(), enter());
    let mut last = (Instant::now(), client.status()?.uptime_ms);
    loop {
        let pressed = match enter.try_recv() {
            Err(TryRecvError::Disconnected) => return Err(Error::Failed("nobody pressed Enter".into())),
            pressed => pressed.is_ok(),
        };
        let status = observe(client, count, assumed)?;
        if pressed {
            line.finish_and_clear();
            return Ok(());
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
    Error::Failed(error.to_string())
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
