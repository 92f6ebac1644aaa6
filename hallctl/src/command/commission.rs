//! Commissioning: from a current limit to a drive that knows its motor, step by step; a second call goes on where the
//! first was broken off.

mod journal;
mod measure;
mod words;

use super::{coil, motion, procedures, settings, tune};
use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::{self, Out};
use crate::say;
use crate::units;
use crate::words as said;
use anyhow::Context;
use clap::Args;
use hallservo::mode::Mode;
use hallservo::service::commission::{self, Action, COOLINGS, Commission, GENTLER, HOT};
use hallservo::settings::{Settings, TABLE, find};
use hallservo_protocol::Ask;
use journal::{Found, Journal, take};
use std::fs;
use std::io::{Write as _, stderr};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, Args)]
pub(super) struct Options {
    /// Largest current that motor and bridge stand, A; the setting max_current_a where it is not given
    #[arg(long, value_name = "AMPERES", value_parser = units::real)]
    max_current: Option<f32>,
    /// Pole pairs of the rotor, if they are known; otherwise `hallctl pole-pairs` counts them after step 2
    #[arg(long, value_parser = units::whole::<u8>(1..=64))]
    pole_pairs: Option<u8>,
    /// Do not ask whether the motor may turn; without, the answer is read from the standard input
    #[arg(long, short)]
    yes: bool,
    /// Where the results of the steps are kept until all is done
    #[arg(long, value_name = "FILE", default_value = "commission.toml")]
    file: PathBuf,
    /// Begin anew, whatever that file says
    #[arg(long)]
    restart: bool,
}

/// Bandwidths from the outer to the inner loop, and values at which the settings have room for any motor.
const LOW: [(&str, f32); 3] =
    [("position_bandwidth_hz", 0.125), ("speed_bandwidth_hz", 0.5), ("current_bandwidth_hz", 10.0)];
/// What is too hot is waited for so long, in the drive's time.
const COOLING_MS: u64 = commission::COOLING_MS as u64;
/// So long at most a swing is waited for, in the drive's time.
const SETTLING_MS: u64 = 10_000;
/// Longest wait for the settings to be saved, in the drive's time.
const SAVING_MS: u64 = 10_000;

pub(super) fn run(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    match steps(client, options, out) {
        Err(Error::Failed(why)) => Err(Error::Failed(why + &still_turns(client, out)?)),
        result => result,
    }
}

/// That the next attempt has to wait: with the bridge off a rotor may turn for long.
fn still_turns(client: &mut Client, out: Out) -> Result<String> {
    let status = client.status()?;
    let turns = status.mode != Mode::Running && status.speed_rad_s.abs() > motion::AT_REST_RAD_S;
    let words = || format!("\n  The motor still turns: {}; wait until it stands.", out.units.speed(status.speed_rad_s));
    Ok(turns.then(words).unwrap_or_default())
}

fn steps(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    procedures::free_shaft(client)?;
    let (mut journal, kept) = begin(client, options)?;
    let mut commission = journal.commission()?;
    Journal::probe(&options.file)?;
    words::stands(&journal, commission.action(), &kept, out)?;
    ask(options.yes, "The motor will turn, in both directions and fast in the end. Is the shaft free, may it begin?")?;
    let (mut coolings, mut gentler) = (0, 0);
    loop {
        write(client, commission.settings())?;
        words::announce(commission.action(), commission.settings(), out)?;
        let done = match commission.action() {
            Action::Done => refine(client, out).map(|()| None),
            action => find_out(client, action, &commission).map(Some),
        };
        let found = match done {
            Err(error) if coolings < COOLINGS && is_hot(client, &error)? => {
                coolings += 1;
                cool(client, out)?;
                continue;
            }
            Err(error) if gentler < GENTLER && has_swung(client, commission.action(), &error)? => {
                gentler += 1;
                commission.be_gentle().map_err(|error| words_of(&error))?;
                words::once_more(&error, commission.settings(), out)?;
                settle(client)?;
                continue;
            }
            done => done?,
        };
        let Some(found) = found else { break };
        words::tell(&found, commission.settings(), journal.told_pole_pairs, out)?;
        let taken = take(&mut commission, &found);
        match &taken {
            Ok(()) => journal.found.push(found),
            // It has failed at every speed: what comes next begins with the first again.
            Err(_) => journal.forget_calibration(),
        }
        journal.write(&options.file)?;
        taken?;
        if commission.action() == Action::Swing && !journal.told_pole_pairs {
            ask(options.yes, "Is that right? If not: `hallctl pole-pairs`, then this command again goes on.")?;
        }
    }
    say!(out, "\n6 of 6: {}.", settings::saved(!save(client)?))?;
    remove(&options.file)?;
    words::summary(&settings::read(client)?, journal.told_pole_pairs, out)
}

/// From the file, or anew; and what a person has set since the file was written.
fn begin(client: &mut Client, options: &Options) -> Result<(Journal, Vec<&'static str>)> {
    let status = client.status()?;
    match status.mode {
        Mode::Faulted(fault) if !HOT.contains(&fault) => {
            return Err(Error::Failed(format!("the drive is faulted: {fault}\n  {}.", said::what_to_do(fault))));
        }
        Mode::Faulted(_) => client.order(Ask::Clear)?,
        _ => {}
    }
    let mut present = settings::read(client)?;
    present.pole_pairs = options.pole_pairs.unwrap_or(present.pole_pairs);
    let before = if options.restart { None } else { Journal::read(&options.file)? };
    let is_ours = |journal: &Journal| {
        let other_limit = options.max_current.is_some() && options.max_current != journal.max_current_a;
        let drive = client.identity();
        journal.port == client.port() && journal.board == drive.board && journal.serial == drive.serial && !other_limit
    };
    let anew = || (Journal::new(client.port(), client.identity(), options.max_current, &present), Vec::new());
    let (mut journal, kept) = match before.filter(is_ours) {
        None => anew(),
        Some(mut journal) => match journal.take_over(&present, options.max_current.is_some())? {
            // What was found with another limit is not used, however that was told.
            kept if kept.contains(&"max_current_a") => anew(),
            kept => (journal, kept),
        },
    };
    if options.pole_pairs.is_some() || !journal.told_pole_pairs {
        journal.set_pole_pairs(present.pole_pairs);
    }
    journal.told_pole_pairs |= options.pole_pairs.is_some();
    if !status.calibrated {
        journal.forget_calibration();
    }
    Ok((journal, kept))
}

/// Asks a person, or what answers through a pipe; where nobody answers, that is a no.
fn ask(yes: bool, question: &str) -> Result<()> {
    if yes {
        return Ok(());
    }
    // A screen that is gone shows no question, and gives no answer.
    let _ = write!(stderr(), "{question} [y/N] ");
    let line = out::answer()?;
    match line.trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ if line.is_empty() => {
            Err(Error::Refused("nobody has answered, nothing more was done\n  `--yes` does not ask.".into()))
        }
        _ => Err(Error::Refused("nothing more was done".into())),
    }
}

/// One step.
fn find_out(client: &mut Client, action: Action, commission: &Commission) -> Result<Found> {
    Ok(match action {
        Action::Measure => Found::Standstill(measure::standstill(client, commission.settings())?),
        Action::Calibrate => {
            let result = procedures::calibration(client)?;
            if result.is_err() {
                client.order(Ask::Clear)?;
            }
            Found::Calibration(result)
        }
        Action::Swing => Found::Swings(measure::swings(client)?),
        Action::Identify | Action::Done => {
            procedures::identification(client)?.map_or(Found::Unidentified, Found::Motor)
        }
    })
}

/// Measures the field of the windings, and tries bandwidths of the speed control. What comes to nothing leaves what was
/// set, and what was computed, as far as it holds a position quietly.
fn refine(client: &mut Client, out: Out) -> Result<()> {
    let measured = coil::measure(client, out);
    unless_hot(client, measured, "The field of the windings is not known", out)?;
    let tuned = tune::tune(client, &tune::KEEP, out);
    // What it leaves has not held a position quietly as one of its trials, or it came to nothing.
    if unless_hot(client, tuned, "The bandwidths stay as computed", out)? != Some(true) {
        let held = tune::quieten(client, out);
        unless_hot(client, held, "Whether the motor holds a position quietly is not known", out)?;
    }
    Ok(())
}

/// Goes on without what came to nothing, unless that has to cool; none then.
fn unless_hot<T>(client: &mut Client, result: Result<T>, words: &str, out: Out) -> Result<Option<T>> {
    match result {
        Err(error @ (Error::Failed(_) | Error::Refused(_))) if !is_hot(client, &error)? => {
            say!(out, "  {words}: {error}")?;
            if matches!(client.status()?.mode, Mode::Faulted(_)) {
                client.order(Ask::Clear)?;
            }
            Ok(None)
        }
        result => result.map(Some),
    }
}

/// Whether a step came to nothing because the motor or the bridge is too hot by what has flowed: a fault, or the refusal
/// to begin.
fn is_hot(client: &mut Client, error: &Error) -> Result<bool> {
    if !matches!(error, Error::Failed(_) | Error::Refused(_)) {
        return Ok(false);
    }
    let words = error.to_string();
    let mode = client.status()?.mode;
    Ok(HOT.iter().any(|fault| mode == Mode::Faulted(*fault) || words.contains(&fault.to_string())))
}

/// Whether the measurement of the motor came to nothing because something swings with it.
fn has_swung(client: &mut Client, action: Action, error: &Error) -> Result<bool> {
    let failed = matches!(error, Error::Failed(_));
    Ok(failed && matches!(client.status()?.mode, Mode::Faulted(fault) if action.may_be_gentler(fault)))
}

/// Waits until the rotor is at rest and the bus is down, the bridge off.
fn settle(client: &mut Client) -> Result<()> {
    let most_v = client.setting(Ask::Get("over_voltage_v"), |setting| setting.value)?;
    let began = client.status()?;
    let mut look = (Instant::now(), began.uptime_ms);
    loop {
        let status = client.status()?;
        let settled = status.speed_rad_s.abs() <= motion::AT_REST_RAD_S && status.bus_v < most_v;
        if settled || status.uptime_ms >= began.uptime_ms + SETTLING_MS {
            return client.order(Ask::Clear);
        }
        client.rest(&mut look, &status)?;
    }
}

/// Waits, the bridge off.
fn cool(client: &mut Client, out: Out) -> Result<()> {
    say!(out, "  Too warm by the current that has flowed: {} s of rest, then again.", COOLING_MS / 1000)?;
    let began = client.status()?;
    let mut look = (Instant::now(), began.uptime_ms);
    loop {
        let status = client.status()?;
        if status.uptime_ms >= began.uptime_ms + COOLING_MS {
            break;
        }
        client.rest(&mut look, &status)?;
    }
    match client.status()?.mode {
        Mode::Faulted(_) => client.order(Ask::Clear),
        _ => Ok(()),
    }
}

/// Keeps the settings; true when they are in the flash.
fn save(client: &mut Client) -> Result<bool> {
    // The bridge has to be off and the rotor at rest for it.
    let began = client.status()?;
    if began.mode.drives() {
        motion::rest(client)?;
        client.order(Ask::Disarm)?;
    }
    let mut look = (Instant::now(), began.uptime_ms);
    // The status would tell of what is learnt, too, which is saved later.
    while settings::save(client)? {
        let status = client.status()?;
        if status.uptime_ms >= began.uptime_ms + SAVING_MS {
            return Ok(false);
        }
        client.rest(&mut look, &status)?;
    }
    Ok(true)
}

/// All is done.
fn remove(path: &Path) -> Result<()> {
    Ok(fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?)
}

fn step(name: &str, why: &str) -> Error {
    Error::Failed(format!("{name}: {why}\n  The bridge is off; `hallctl commission` goes on with this step."))
}

fn words_of(error: &hallservo::settings::Error<'static>) -> Error {
    Error::Refused(said::setting_error(error))
}

/// Sets what differs, by way of bandwidths that allow every motor.
fn write(client: &mut Client, wanted: &Settings) -> Result<()> {
    let present = settings::read(client)?;
    let value = |settings: &Settings, name: &str| find(name).and_then(|entry| entry.get(settings));
    let mut changes: Vec<(&str, f32)> = TABLE
        .iter()
        .filter(|entry| !entry.fixed(&present) && entry.get(wanted) != entry.get(&present))
        .filter_map(|entry| Some((entry.name, entry.get(wanted)?)))
        .collect();
    if changes.is_empty() {
        return Ok(());
    }
    for (name, low) in LOW {
        client.setting(Ask::Set { name, value: low }, |_| ())?;
        if !changes.iter().any(|(changed, _)| *changed == name) {
            changes.extend(value(wanted, name).map(|value| (name, value)));
        }
    }
    settings::set_all(client, changes)
}
