//! `hallctl record`: a few channels at up to the control rate, about a trigger.

use crate::client::Client;
use crate::error::Result;
use crate::out::{self, Out, is_stream};
use crate::say;
use crate::scope::{self, Awaited, Recording, name};
use crate::units;
use anyhow::Context as _;
use hallservo::scope::{Channel, ROWS, Setup};
use plots::{Plot, Report, Series};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// What to record. It may be asked for while another tool controls the drive.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// Up to four of phase_a|b|c, i_d, i_q, i_d_ref, i_q_ref, v_d, v_q, duty_a|b|c, angle, speed, speed_ref, position,
    /// position_ref, bus, hall_1|2|3
    #[arg(long, short, value_delimiter = ',', value_parser = scope::channel, default_value = "i_q_ref,i_q,speed_ref,speed")]
    channels: Vec<Channel>,
    /// Every so many control periods
    #[arg(long, default_value_t = 1, value_parser = units::whole::<u16>(1..=65_535))]
    every: u16,
    /// Rows; without, as many as the drive's memory holds
    #[arg(long, value_parser = units::whole::<u16>(1..=ROWS as u64))]
    rows: Option<u16>,
    /// now, command (the next one to the drive), fault, or a channel that crosses a level: "i_q>1.5", "speed<-100rpm"
    #[arg(long, value_parser = scope::trigger, default_value = "now", allow_hyphen_values = true)]
    trigger: Awaited,
    /// Share of the rows that is before the trigger, 0 to 0.99
    #[arg(long, default_value_t = 0.25, value_parser = share)]
    before: f64,
    /// Longest wait for the trigger; without, until Ctrl-C
    #[arg(long, value_parser = super::seconds)]
    seconds: Option<f64>,
    /// Into this file, .csv, .json or .html, - for CSV on the standard output; may be given more than once
    #[arg(long, short, value_name = "FILE", value_parser = out::table)]
    pub(super) out: Vec<PathBuf>,
}

fn share(text: &str) -> std::result::Result<f64, String> {
    text.parse()
        .ok()
        .filter(|share| (0.0..=0.99).contains(share))
        .ok_or_else(|| "a share from 0 to 0.99 is wanted".into())
}

pub(super) fn record(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    let Options { channels, every, rows, trigger, before, .. } = options;
    let rows = match rows {
        Some(rows) => *rows,
        None => scope::status(client)?.capacity,
    };
    let setup = scope::setup(channels, *every, rows, *before, trigger.trigger(out.units))?;
    // Tried before the work begins.
    options.out.iter().try_for_each(|path| out::probe(path))?;
    let id = scope::begin(client, setup)?;
    let recording = scope::finish(client, id, options.seconds.unwrap_or(f64::INFINITY))?;
    if !options.out.iter().any(|path| is_stream(path)) {
        tell(&recording, &setup, client.identity().step_hz, out)?;
        out.value(&value(&recording))?;
    }
    // One that cannot be written costs none of the others.
    let saved: Vec<_> = options.out.iter().map(|path| save(path, &recording)).collect();
    saved.into_iter().collect()
}

fn tell(recording: &Recording, setup: &Setup, step_hz: f64, out: Out) -> Result<()> {
    let row_us = 1e6 * f64::from(setup.every) / step_hz;
    let before = recording.time_s.iter().filter(|time_s| **time_s < 0.0).count();
    say!(out, "{} rows, {row_us:.1} µs apart; {before} before the trigger", recording.time_s.len())?;
    let head = ["", "least", "mean", "largest", ""].map(String::from).to_vec();
    let rows = recording.channels.iter().zip(&recording.values).map(|(channel, values)| {
        let fold = |start: f64, of: fn(f64, f64) -> f64| values.iter().copied().fold(start, of);
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let numbers = [fold(f64::INFINITY, f64::min), mean, fold(f64::NEG_INFINITY, f64::max)];
        let numbers = numbers.map(|value| format!("{value:.4}"));
        [name(*channel).into()].into_iter().chain(numbers).chain([channel.unit().into()]).collect()
    });
    out.table(&std::iter::once(head).chain(rows).collect::<Vec<_>>())
}

/// By the names of the channels.
fn value(recording: &Recording) -> Value {
    let mut map = Map::from_iter([("time_s".to_owned(), json!(recording.time_s))]);
    map.extend(
        recording.channels.iter().zip(&recording.values).map(|(one, values)| (name(*one).into(), json!(values))),
    );
    Value::Object(map)
}

fn save(path: &Path, recording: &Recording) -> Result<()> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("html") => plot(path, recording),
        Some("json") => out::save(path, serde_json::to_string(&value(recording)).context("the result as JSON")? + "\n"),
        _ => table(path, recording),
    }
}

fn table(path: &Path, recording: &Recording) -> Result<()> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    let names = recording.channels.iter().map(|channel| name(*channel));
    csv.write_record(["time_s"].into_iter().chain(names)).context("the CSV file")?;
    for (row, time_s) in recording.time_s.iter().enumerate() {
        let values = recording.values.iter().map(|values| values[row].to_string());
        csv.write_record([format!("{time_s:.9}")].into_iter().chain(values)).context("the CSV file")?;
    }
    out::save(path, csv.into_inner().map_err(csv::IntoInnerError::into_error).context("the CSV file")?)
}

/// A diagram for each unit.
fn plot(path: &Path, recording: &Recording) -> Result<()> {
    let mut report = Report::new("A recording of a hallservo drive");
    report.lead("What the drive's scope has taken, in the control interrupt, about its trigger.");
    let mut units: Vec<_> = recording.channels.iter().map(|channel| channel.unit()).collect();
    units.dedup();
    for (at, unit) in units.iter().enumerate() {
        if units[..at].contains(unit) {
            continue;
        }
        let of_unit = recording.channels.iter().zip(&recording.values).filter(|(channel, _)| channel.unit() == *unit);
        let series: Vec<_> = of_unit
            .map(|(channel, values)| {
                let points = recording.time_s.iter().map(|time_s| 1e3 * time_s).zip(values.iter().copied());
                Series::new(name(*channel), points)
            })
            .collect();
        let title = series.iter().map(|series| series.name.as_str()).collect::<Vec<_>>().join(", ");
        let y = if unit.is_empty() { "share".to_owned() } else { format!("value / {unit}") };
        report.plot(&Plot::new(&title, "time / ms", &y, series).event(0.0, "trigger"), "")?;
    }
    out::save(path, report.html())
}
