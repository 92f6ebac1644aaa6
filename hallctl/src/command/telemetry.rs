//! `hallctl telemetry`.

use super::trigger::{Gate, Trigger};
use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::{self, Out, is_stream};
use crate::{say, words};
use anyhow::{Context, anyhow};
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Telemetry};
use plots::{Plot, Report, Series};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// For so long; without, until Ctrl-C, which keeps what has come
    #[arg(long, value_parser = super::seconds)]
    seconds: Option<f64>,
    /// So often a second, up to 1000; a UART of 460 800 baud carries 650
    #[arg(long, default_value_t = 100.0, value_parser = super::rate)]
    hz: f32,
    /// Wait for running, fault, or a value like speed>50, current<-2, bus>30; --seconds count from then on
    #[arg(long, value_name = "CONDITION")]
    trigger: Option<Trigger>,
    /// Seconds before the trigger that are kept
    #[arg(long, value_parser = before, default_value = "0.1", requires = "trigger")]
    before: f64,
    /// Show the codes of the Halls instead of speed and currents
    #[arg(long)]
    halls: bool,
    /// Into this file, - for the standard output
    #[arg(long, value_name = "FILE", value_parser = out::csv)]
    csv: Option<PathBuf>,
    /// As diagrams into this file, - for the standard output
    #[arg(long, value_name = "FILE.html", value_parser = out::page)]
    plot: Option<PathBuf>,
}

impl Options {
    /// Where it is to be written.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.csv.iter().chain(&self.plot)
    }
}

/// A time before the trigger, in seconds; of a recording, too, it may be none.
fn before(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=1e9).contains(&seconds) => Ok(seconds),
        _ => Err("a number of seconds from 0 on is wanted".into()),
    }
}

const COLUMNS: [&str; 19] = [
    "time_s",
    "number",
    "angle_deg",
    "position_turns",
    "speed_rad_s",
    "current_d_a",
    "current_q_a",
    "voltage_d_v",
    "voltage_q_v",
    "bus_v",
    "mode",
    "fault",
    "limits",
    "hall_1",
    "hall_2",
    "hall_3",
    "lost",
    "step",
    "speed_rpm",
];

/// A frame, with what only the host knows.
pub(super) struct Row {
    pub(super) time_s: f64,
    /// Frames missing before it.
    pub(super) lost: u32,
    pub(super) frame: Telemetry,
}

/// From frames to rows.
struct Rows {
    step_hz: f64,
    last: Option<Telemetry>,
    /// Control periods since the first.
    steps: u64,
    lost: u64,
}

impl Rows {
    fn row(&mut self, frame: Telemetry) -> Row {
        let (mut lost, mut steps) = (0, 0);
        if let Some(last) = &self.last {
            lost = frame.number.wrapping_sub(last.number).wrapping_sub(1);
            steps = frame.step.wrapping_sub(last.step);
        }
        self.steps += u64::from(steps);
        self.lost += u64::from(lost);
        self.last = Some(frame);
        Row { time_s: self.steps as f64 / self.step_hz, lost, frame }
    }
}

/// A CSV file.
type Table = csv::Writer<Box<dyn Write>>;

/// Where the rows go.
struct Sinks {
    gate: Gate,
    /// A file is begun with the first row: what is in it stays as long as nothing comes.
    path: Option<PathBuf>,
    csv: Option<Table>,
    kept: Option<Vec<Row>>,
    out: Option<Out>,
    halls: bool,
    count: u64,
}

impl Sinks {
    fn open(options: &Options, out: Out) -> Result<Self> {
        // Tried before the work begins.
        options.files().try_for_each(|path| out::probe(path))?;
        let csv = options.csv.as_ref().filter(|path| is_stream(path)).map(|path| table(path)).transpose()?;
        let quiet = options.csv.is_some() || options.plot.is_some();
        Ok(Self {
            gate: Gate::new(options.trigger, options.before, out.units),
            path: options.csv.clone(),
            csv,
            kept: options.plot.as_ref().map(|_| Vec::new()),
            out: (!quiet).then_some(out),
            halls: options.halls,
            count: 0,
        })
    }

    fn take(&mut self, row: Row) -> Result<()> {
        self.gate.pass(row).into_iter().try_for_each(|row| self.keep(row))
    }

    fn keep(&mut self, row: Row) -> Result<()> {
        self.count += 1;
        if self.csv.is_none() {
            self.csv = self.path.as_ref().map(|path| table(path)).transpose()?;
        }
        if let Some(csv) = &mut self.csv {
            csv.write_record(record(&row)).context("the CSV file")?;
        }
        if let Some(out) = self.out {
            show(&row, self.halls, out)?;
        }
        if let Some(kept) = &mut self.kept {
            kept.push(row);
        }
        Ok(())
    }

    /// Whole rows are in the file, whatever happens next.
    fn flush(&mut self) -> Result<()> {
        if let Some(csv) = &mut self.csv {
            csv.flush().context("the CSV file")?;
        }
        Ok(())
    }
}

pub(super) fn watch(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    let mut sinks = Sinks::open(options, out)?;
    let mut rows = Rows { step_hz: client.identity().step_hz, last: None, steps: 0, lost: 0 };
    let watched = follow(client, options, &mut rows, &mut sinks);
    if matches!(watched, Err(Error::Interrupted)) {
        client.carry_on();
        client.end_telemetry()?;
        drain(client, &mut rows, &mut sinks)?;
    } else {
        watched?;
    }
    let seconds = rows.steps as f64 / rows.step_hz;
    if sinks.gate.waits() {
        // Frames came, and none of them was to be kept.
        crate::tell!("the trigger did not come within {seconds:.3} s");
        return Err(Error::Interrupted);
    }
    if let (Some(path), Some(kept)) = (&options.plot, &sinks.kept) {
        plot(path, kept)?;
    }
    crate::tell!("{} frames in {seconds:.3} s, {} lost", sinks.count, rows.lost);
    Ok(())
}

/// Until the time is over.
fn follow(client: &mut Client, options: &Options, rows: &mut Rows, sinks: &mut Sinks) -> Result<()> {
    client.order(Ask::Telemetry(options.hz))?;
    let began_ms = client.status()?.uptime_ms;
    let end = |from_ms: u64| options.seconds.map(|seconds| from_ms + (1000.0 * seconds) as u64);
    let mut end_ms = end(began_ms);
    let mut look = (Instant::now(), began_ms);
    loop {
        // The status, beside being the clock, shows the drive that somebody is there.
        let status = client.status()?;
        client.rest(&mut look, &status)?;
        if sinks.gate.waits() {
            end_ms = end(status.uptime_ms);
        }
        let over = end_ms.is_some_and(|end| status.uptime_ms >= end);
        if over {
            // The frames before the answer are the last.
            client.end_telemetry()?;
        }
        drain(client, rows, sinks)?;
        if over {
            return Ok(());
        }
    }
}

fn drain(client: &mut Client, rows: &mut Rows, sinks: &mut Sinks) -> Result<()> {
    while let Some(frame) = client.telemetry() {
        sinks.take(rows.row(frame))?;
    }
    sinks.flush()
}

fn table(path: &Path) -> Result<Table> {
    let mut csv = csv::Writer::from_writer(out::create(path)?);
    csv.write_record(COLUMNS).context("the CSV file")?;
    Ok(csv)
}

fn record(row: &Row) -> Vec<String> {
    let Row { time_s, lost, frame } = row;
    // What is not measured is left empty.
    let real = |value: f32| if value.is_nan() { String::new() } else { value.to_string() };
    let fault = if let Mode::Faulted(fault) = frame.mode { fault.code() } else { 0 };
    let ([current_d, current_q], [voltage_d, voltage_q]) = (frame.current_a, frame.voltage_v);
    let [hall_1, hall_2, hall_3] = frame.codes;
    vec![
        format!("{time_s:.6}"),
        frame.number.to_string(),
        real(frame.angle_deg),
        format!("{:.6}", frame.position_turns),
        real(frame.speed_rad_s),
        real(current_d),
        real(current_q),
        real(voltage_d),
        real(voltage_q),
        real(frame.bus_v),
        words::mode_word(frame.mode).into(),
        fault.to_string(),
        frame.limits.bits().to_string(),
        hall_1.to_string(),
        hall_2.to_string(),
        hall_3.to_string(),
        lost.to_string(),
        frame.step.to_string(),
        real(frame.speed_rad_s * 60.0 / std::f32::consts::TAU),
    ]
}

fn show(row: &Row, halls: bool, out: Out) -> Result<()> {
    let Row { time_s, frame, .. } = row;
    let mode = words::mode_word(frame.mode);
    if halls {
        let [hall_1, hall_2, hall_3] = frame.codes;
        say!(out, "{time_s:>9.3} s  {mode:<11} Hall 1 {hall_1:>5}   Hall 2 {hall_2:>5}   Hall 3 {hall_3:>5}")?;
        return out.value(&value(row));
    }
    let of = |value: f32, unit: &str| if value.is_nan() { "-".into() } else { format!("{value:.3} {unit}") };
    let (position, speed) = (out.units.position(frame.position_turns), out.units.speed(frame.speed_rad_s));
    let (current, bus) = (of(frame.current_a[1], "A"), of(frame.bus_v, "V"));
    say!(out, "{time_s:>9.3} s  {mode:<11} {position:>16} {speed:>15} {current:>9} {bus:>9}")?;
    out.value(&value(row))
}

/// The columns by their names; what is not measured is null.
fn value(row: &Row) -> Value {
    let cell = |(name, text): (&str, String)| {
        let value = match text.parse::<f64>() {
            _ if text.is_empty() => Value::Null,
            Ok(number) => json!(number),
            Err(_) => json!(text),
        };
        (name.to_owned(), value)
    };
    Value::Object(COLUMNS.into_iter().zip(record(row)).map(cell).collect::<Map<_, _>>())
}

fn plot(path: &Path, rows: &[Row]) -> Result<()> {
    if rows.is_empty() {
        return Err(anyhow!("nothing came to be plotted").into());
    }
    let series = |name: &str, of: &dyn Fn(&Telemetry) -> f64| {
        let points = rows.iter().map(|row| (row.time_s, of(&row.frame)));
        Series { name: name.into(), points: points.filter(|(_, y)| y.is_finite()).collect() }
    };
    let diagrams = [
        ("Speed", "speed / rad/s", vec![series("speed", &|t| t.speed_rad_s.into())]),
        ("Position", "position / turns", vec![series("position", &|t| t.position_turns)]),
        (
            "Current",
            "current / A",
            vec![series("along q", &|t| t.current_a[1].into()), series("along d", &|t| t.current_a[0].into())],
        ),
        ("Bus voltage", "voltage / V", vec![series("bus", &|t| t.bus_v.into())]),
        (
            "Halls",
            "signal / ADC codes",
            (0..3).map(|k| series(&format!("Hall {}", k + 1), &|t| t.codes[k].into())).collect(),
        ),
    ];
    let mut report = Report::new("Telemetry of a hallservo drive");
    report.lead("What the drive said of itself while it was listened to.");
    for (title, unit, series) in diagrams {
        // What was not measured has no diagram.
        let series: Vec<_> = series.into_iter().filter(|series| !series.points.is_empty()).collect();
        if !series.is_empty() {
            report.plot(&Plot::new(title, "time / s", unit, series), "")?;
        }
    }
    out::save(path, report.html())
}
