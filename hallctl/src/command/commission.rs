//! Commissioning: from a current limit to a drive that knows its motor.

use super::{procedures, settings};
use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::out::Out;
use crate::{say, words};
use anyhow::Context;
use clap::Args;
use hallservo::mode::Mode;
use hallservo::service::commission::{Action, Commission};
use hallservo::service::procedure;
use hallservo::service::standstill::{Electrical, Evaluation};
use hallservo::service::swings::Rough;
use hallservo::settings::{Control, Settings, TABLE, find};
use hallservo_protocol::{Answer, Ask, Procedure};
use serde_json::json;
use std::io::{IsTerminal, stdin};

#[derive(Debug, Args)]
pub(super) struct Options {
    /// Largest current that motor and bridge stand, A; the setting max_current_a where it is not given
    #[arg(long, value_name = "AMPERES")]
    max_current: Option<f32>,
    /// Pole pairs of the rotor, if they are known; otherwise `hallctl pole-pairs` counts them afterwards
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=64))]
    pole_pairs: Option<u8>,
    /// Do not ask whether the motor may turn
    #[arg(long, short)]
    yes: bool,
}

/// Bandwidths from the outer to the inner loop, and values at which the settings have room for any motor.
const LOW: [(&str, f32); 3] =
    [("position_bandwidth_hz", 0.125), ("speed_bandwidth_hz", 0.5), ("current_bandwidth_hz", 10.0)];

pub(super) fn run(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    let mut settings = read(client)?;
    if let Some(pairs) = options.pole_pairs {
        settings.pole_pairs = pairs;
    }
    let mut commission = Commission::new(settings, options.max_current).map_err(|error| words_of(&error))?;
    ask(options.yes)?;
    loop {
        write(client, commission.settings())?;
        announce(commission.action(), commission.settings(), out)?;
        match commission.action() {
            Action::Measure => {
                let found = standstill(client, commission.settings())?;
                say!(out, "At standstill:\n{}", found.to_string().trim_end())?;
                commission.measured(&found).map_err(|error| words_of(&error))?;
            }
            Action::Calibrate => {
                let speed_hz = commission.settings().calibration_hz;
                let result = procedures::calibration(client)?;
                match &result {
                    Ok(report) => say!(
                        out,
                        "Calibrated at {speed_hz} Hz: the rotor lagged {:.0}° behind the field and swung by {:.1}°.",
                        report.lag.to_degrees().abs(),
                        report.hunting_deg
                    )?,
                    Err(error) => {
                        say!(out, "No calibration at {speed_hz} Hz: {error}.")?;
                        client.order(Ask::Clear)?;
                    }
                }
                commission
                    .calibrated(result.as_ref().map_err(|error| *error))
                    .map_err(|error| step("the calibration", &error.to_string()))?;
            }
            Action::Swing => {
                let found = swings(client)?;
                commission.swung(&found).map_err(|error| words_of(&error))?;
            }
            Action::Identify => {
                let found = procedures::identification(client)?;
                commission.identified(&found).map_err(|error| words_of(&error))?;
            }
            Action::Done => break,
        }
    }
    let waits = settings::save(client)?;
    say!(out, "{}", settings::saved(waits))?;
    summary(commission.settings(), options.pole_pairs.is_some(), out)
}

/// Asks a person at a terminal, once.
fn ask(yes: bool) -> Result<()> {
    if yes || !stdin().is_terminal() {
        return Ok(());
    }
    eprint!("The motor will turn, in both directions and fast in the end. Is the shaft free, may it begin? [y/N] ");
    let mut line = String::new();
    stdin().read_line(&mut line).context("the terminal")?;
    match line.trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ => Err(Error::Refused("nothing was done".into())),
    }
}

/// What a step is about to do to the motor.
fn announce(action: Action, settings: &Settings, out: Out) -> Result<()> {
    let most_a = settings.control.map_or(f32::NAN, |control| control.max_current_a);
    match action {
        Action::Measure => say!(out, "→ R and L: each phase carries up to {most_a} A; the rotor may jump to it once."),
        Action::Calibrate => {
            let (turns, hz) = (settings.calibration_turns, settings.calibration_hz);
            say!(out, "→ The Halls: the field turns the rotor, {turns} electrical turns each way at {hz} Hz.")
        }
        Action::Swing => say!(out, "→ Flux linkage and inertia: the rotor swings to and fro, by up to {most_a} A."),
        Action::Identify => say!(out, "→ The motor: it turns to and fro, faster than before."),
        Action::Done => Ok(()),
    }
}

fn summary(settings: &Settings, told: bool, out: Out) -> Result<()> {
    let Some(Control {
        resistance_ohm,
        inductance_h,
        flux_linkage_wb,
        inertia_kgm2,
        max_current_a,
        max_speed_rad_s,
        max_acceleration_rad_s2,
        current_bandwidth_hz,
        speed_bandwidth_hz,
        ..
    }) = settings.control
    else {
        return Ok(());
    };
    say!(out, "\nThe motor, at {max_current_a} A at most:")?;
    say!(out, "  resistance   {resistance_ohm:10.4} Ω      inductance {:10.4} mH", 1e3 * inductance_h)?;
    say!(out, "  flux linkage {:10.4} mWb    inertia    {:10.4} g·cm²", 1e3 * flux_linkage_wb, 1e7 * inertia_kgm2)?;
    say!(out, "  speed up to  {max_speed_rad_s:10.0} rad/s  reached with {max_acceleration_rad_s2:.0} rad/s²")?;
    say!(out, "  current control {current_bandwidth_hz:.0} Hz, speed control {speed_bandwidth_hz:.1} Hz")?;
    if !told {
        say!(
            out,
            "pole_pairs is {}, as set: the Halls cannot tell a turn of the shaft. If it is not known, `hallctl \
             pole-pairs` counts them; then commission again.",
            settings.pole_pairs
        )?;
    }
    out.value(&json!({
        "pole_pairs": settings.pole_pairs,
        "resistance_ohm": resistance_ohm,
        "inductance_h": inductance_h,
        "flux_linkage_wb": flux_linkage_wb,
        "inertia_kgm2": inertia_kgm2,
        "max_current_a": max_current_a,
        "max_speed_rad_s": max_speed_rad_s,
        "max_acceleration_rad_s2": max_acceleration_rad_s2,
        "current_bandwidth_hz": current_bandwidth_hz,
        "speed_bandwidth_hz": speed_bandwidth_hz,
    }))
}

fn step(name: &str, why: &str) -> Error {
    Error::Failed(format!("{name}: {why}\n  The bridge is off; what was found so far is in the settings, not saved."))
}

fn words_of(error: &hallservo::settings::Error<'static>) -> Error {
    Error::Refused(words::setting_error(error))
}

const STANDSTILL: &str = "R and L at standstill";
const SWINGS: &str = "flux linkage and inertia";

fn swings(client: &mut Client) -> Result<Rough> {
    client.order(Ask::Swing)?;
    procedures::wait(client, SWINGS)?;
    client.ask(Ask::Swings, |answer| match answer {
        Answer::Swings(Procedure::Done(found)) => Ok(found),
        Answer::Swings(Procedure::Failed(error)) => Err(step(SWINGS, &words::procedure_error(&error))),
        other => unexpected(&other),
    })
}

/// Measures R and L: the drive sums up what flows, the tool chooses what is to flow and computes.
fn standstill(client: &mut Client, settings: &Settings) -> Result<Electrical> {
    let config = settings.validate().map_err(|error| words_of(&error))?;
    let mut evaluation = Evaluation::new(&config).map_err(|error| step(STANDSTILL, &words::procedure_error(&error)))?;
    let measured = measure(client, &mut evaluation);
    // Whatever has happened.
    let disarmed = client.order(Ask::Disarm);
    let found = measured.and_then(|found| disarmed.map(|()| found))?;
    found.map_err(|error| step(STANDSTILL, &words::procedure_error(&error)))
}

type Measured = std::result::Result<Electrical, procedure::Error>;

fn measure(client: &mut Client, evaluation: &mut Evaluation) -> Result<Measured> {
    let mut begins = true;
    loop {
        if let Some(result) = evaluation.result() {
            return Ok(*result);
        }
        if let Err(error) = client.order(Ask::Measure { begins, probe: evaluation.probe() }) {
            let mode = client.status()?.mode;
            return match mode {
                Mode::Faulted(fault) if !begins => Ok(Err(procedure::Error::Fault(fault))),
                _ => Err(error),
            };
        }
        begins = false;
        let window = client.ask(Ask::Window, |answer| match answer {
            Answer::Window(window) => Ok(window),
            other => unexpected(&other),
        })?;
        if let Some(window) = window {
            evaluation.window(&window);
        }
    }
}

/// The drive's settings.
fn read(client: &mut Client) -> Result<Settings> {
    let mut settings = Settings { control: Some(Control::default()), ..Settings::default() };
    let mut known = 0;
    settings::each(client, |setting| {
        if let Some(entry) = find(setting.name)
            && entry.assign(&mut settings, setting.value).is_ok()
        {
            known += 1;
        }
    })?;
    // Without current control, a drive has not all of them.
    if known < TABLE.len() {
        return Err(Error::Refused(words::procedure_error(&procedure::Error::NoControl)));
    }
    Ok(settings)
}

/// Sets what differs, by way of bandwidths that allow every motor.
fn write(client: &mut Client, wanted: &Settings) -> Result<()> {
    let present = read(client)?;
    let value = |settings: &Settings, name: &str| find(name).and_then(|entry| entry.get(settings));
    let mut changes: Vec<(&str, f32)> = TABLE
        .iter()
        .filter(|entry| !entry.fixed && entry.get(wanted) != entry.get(&present))
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
