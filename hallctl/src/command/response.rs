//! `hallctl step` and `hallctl sine`: what the motor makes of a set-point.

use super::motion::{AT_REST_RAD_S, Target};
use super::session::{Session, Trace};
use crate::client::Client;
use crate::error::{Error, Result};
use crate::out::{self, Out};
use crate::response::{LOW, Point, Profile, Sine, Step, bandwidth};
use crate::say;
use crate::units::{self, Quantity};
use clap::Subcommand;
use plots::{Plot, Report, Series};
use serde_json::json;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// What follows.
#[derive(Clone, Copy, Debug, Subcommand)]
pub(super) enum Axis {
    /// The speed, by so much
    #[command(allow_negative_numbers = true)]
    Speed {
        /// Size of the step, or amplitude of the sine
        #[arg(value_parser = |text: &str| units::not_zero(units::speed(text)?))]
        size: Quantity,
        /// Speed before, or in the middle
        #[arg(long, value_parser = units::speed, default_value = "0")]
        from: Quantity,
    },
    /// The position, by so much from where it is
    #[command(allow_negative_numbers = true)]
    Position {
        /// Size of the step, or amplitude of the sine
        #[arg(value_parser = |text: &str| units::not_zero(units::position(text)?))]
        size: Quantity,
    },
}

#[derive(Clone, Debug, clap::Args)]
pub(super) struct Files {
    /// Telemetry so often a second; a UART of 460 800 baud carries 650
    #[arg(long, default_value_t = 500.0, value_parser = super::rate, global = true)]
    hz: f32,
    /// Time, set-point and measured into this file, - for the standard output
    #[arg(long, value_name = "FILE", value_parser = out::csv, global = true)]
    csv: Option<PathBuf>,
    /// A diagram into this file, - for the standard output
    #[arg(long, value_name = "FILE.html", value_parser = out::page, global = true)]
    plot: Option<PathBuf>,
}

impl Files {
    /// Where it is to be written.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.csv.iter().chain(&self.plot)
    }

    /// Tried before the work begins.
    fn probe(&self) -> Result<()> {
        self.files().try_for_each(|path| out::probe(path))
    }
}

#[derive(Clone, Debug, clap::Args)]
pub(super) struct StepOptions {
    #[command(subcommand)]
    axis: Axis,
    /// Recorded from the step on
    #[arg(long, value_parser = super::seconds, default_value = "0.5", global = true)]
    seconds: f64,
    #[command(flatten)]
    pub(super) files: Files,
}

#[derive(Clone, Debug, clap::Args)]
pub(super) struct SineOptions {
    #[command(subcommand)]
    axis: Axis,
    /// Frequencies, Hz
    #[arg(long, value_delimiter = ',', default_value = "1,2,4", value_parser = frequency, global = true)]
    frequency: Vec<f64>,
    /// Periods of each
    #[arg(long, default_value_t = 4, value_parser = crate::units::whole::<u32>(1..=1_000_000), global = true)]
    periods: u32,
    #[command(flatten)]
    pub(super) files: Files,
}

/// A frequency of a sine, Hz.
fn frequency(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(hz) if (1e-3..=1e6).contains(&hz) => Ok(hz),
        _ => Err("a frequency from 0.001 Hz on is wanted, as a number".into()),
    }
}

/// An axis in the drive's units.
#[derive(Clone, Copy)]
pub(super) struct Wanted {
    from: f64,
    size: f64,
    position: bool,
}

impl Wanted {
    fn of(axis: Axis, session: &Session<'_>, out: Out) -> Self {
        match axis {
            Axis::Speed { size, from } => {
                let usual = out.units.speed.rad_s();
                Self { from: from.value(usual), size: size.value(usual), position: false }
            }
            Axis::Position { size } => {
                let size = size.value(out.units.position.turns());
                Self { from: session.began_turns(), size, position: true }
            }
        }
    }

    /// Speeds, rad/s.
    pub(super) const fn speed(from: f64, size: f64) -> Self {
        Self { from, size, position: false }
    }

    /// Positions, turns.
    pub(super) const fn position(from: f64, size: f64) -> Self {
        Self { from, size, position: true }
    }

    /// Before and after a step.
    pub(super) fn ends(&self) -> (f64, f64) {
        (self.from, self.from + self.size)
    }

    /// Brings the motor to where it begins, which takes a heavy one longer than [`BEFORE_S`]: a motion that is not over
    /// would look like an answer.
    fn reach(&self, session: &mut Session<'_>, out: Out) -> Result<()> {
        if self.position || self.from == 0.0 {
            return Ok(());
        }
        let near = (SETTLED * self.size.abs()).max(AT_REST_RAD_S.into());
        for _ in 0..LONGEST {
            let from_s = session.now_s();
            session.follow(BEFORE_S / 2.0, |_| self.target(self.from), |moment| moment.position(self.position))?;
            let late = session.since(from_s);
            let mean = late.iter().map(|row| row.measured).sum::<f64>() / late.len() as f64;
            if (mean - self.from).abs() <= near {
                return Ok(());
            }
        }
        let from = out.units.speed_to(self.from, 1);
        Err(Error::Failed(format!("the motor does not come to {from}, from where it is to go on")))
    }

    /// Makes the step.
    pub(super) fn step(&self, session: &mut Session<'_>, seconds: f64) -> Result<()> {
        let (from, to) = self.ends();
        let set = |session: &mut Session<'_>, value: f64, seconds| {
            session.follow(seconds, |_| self.target(value), |moment| moment.position(self.position))
        };
        set(session, from, BEFORE_S)?;
        set(session, to, seconds)
    }

    /// When the step was made: with the last frame before its answer.
    pub(super) fn began_s(&self, trace: &[Trace]) -> f64 {
        let to = self.target(self.ends().1).value();
        trace.iter().take_while(|row| row.set != to).last().map_or(0.0, |row| row.time_s)
    }

    fn target(&self, value: f64) -> Target {
        if self.position { Target::Position(value) } else { Target::Speed(value as f32) }
    }

    fn unit(&self) -> (&'static str, &'static str) {
        if self.position { ("Position", "turns") } else { ("Speed", "rad/s") }
    }
}

/// Before the step, s.
const BEFORE_S: f64 = 0.3;
/// A step has settled within so much of it.
const SETTLED: f64 = 0.05;
/// As many halves of [`BEFORE_S`] may it take to come to where it begins: half a minute.
const LONGEST: u32 = 200;

pub(super) fn step(client: &mut Client, options: &StepOptions, out: Out) -> Result<()> {
    options.files.probe()?;
    let limits = Limits::of(client)?;
    let (wanted, trace) = Session::run(client, options.files.hz, |session| {
        let wanted = Wanted::of(options.axis, session, out);
        wanted.reach(session, out)?;
        wanted.step(session, options.seconds).map(|()| wanted)
    })?;
    let began_s = wanted.began_s(&trace);
    let (_, to) = wanted.ends();
    let model = limits.profile(&wanted);
    let since: Vec<Point> =
        trace.iter().filter(|row| row.time_s >= began_s).map(|row| (row.time_s - began_s, row.measured)).collect();
    let before: Vec<Point> = trace
        .iter()
        .filter(|row| (began_s - BEFORE_S..began_s).contains(&row.time_s))
        .map(|row| (row.time_s - began_s, row.measured))
        .collect();
    let found = Step::of(&since, wanted.from, to).beyond_noise(wanted.size, &before).unless_lost(wanted.size);
    let ideal: Vec<Point> = since.iter().map(|&(time_s, _)| (time_s, model.at(time_s))).collect();
    let asked = Step::of(&ideal, wanted.from, to);
    tell(&found, &asked, &wanted, out)?;
    out.value(&json!({
        "axis": wanted.unit().0.to_lowercase(),
        "unit": wanted.unit().1,
        "from": wanted.from,
        "to": to,
        "measured": found,
        "trajectory": asked,
        "frames": since.len(),
    }))?;
    let shift = |row: &Trace| (row.time_s - began_s, row.set, row.measured);
    save(&options.files, &wanted, &trace.iter().map(shift).collect::<Vec<_>>(), Some((&model, began_s)))
}

fn tell(found: &Step, asked: &Step, wanted: &Wanted, out: Out) -> Result<()> {
    let time = |time: Option<f64>| time.map_or_else(|| "not reached".into(), |time| format!("{:.1} ms", 1e3 * time));
    let of_axis = |value: f64| {
        let (one, unit) = match wanted.position {
            true => (out.units.position.turns(), out.units.position.name()),
            false => (out.units.speed.rad_s(), out.units.speed.name()),
        };
        format!("{:.4} {unit}", value / one)
    };
    let row = |name: &str, measured: String, asked: String| vec![name.into(), measured, asked];
    out.table(&[
        row("", "measured".into(), "as asked".into()),
        row("rise, 10 to 90 %", time(found.rise_s), time(asked.rise_s)),
        row("overshoot beyond noise", format!("{:.1} %", found.overshoot_pct), format!("{:.1} %", asked.overshoot_pct)),
        row("settled within 5 %", time(found.settling_s), time(asked.settling_s)),
        row("error in the end", of_axis(found.error), String::new()),
        row("noise, RMS", of_axis(found.noise), String::new()),
    ])?;
    if found.is_lost(wanted.size) {
        say!(out, "The step is no larger than the noise, which hides when it rose and settled: a larger one tells.")?;
    }
    say!(out, "Asked is the trajectory, within max_acceleration_rad_s2 and max_speed_rad_s.")
}

/// What the trajectory keeps to, in rad/s² and rad/s.
struct Limits {
    acceleration: f64,
    speed: f64,
}

impl Limits {
    fn of(client: &mut Client) -> Result<Self> {
        use hallservo_protocol::Ask;
        let mut get = |name| client.setting(Ask::Get(name), |setting| f64::from(setting.value));
        Ok(Self { acceleration: get("max_acceleration_rad_s2")?, speed: get("max_speed_rad_s")? })
    }

    fn profile(&self, wanted: &Wanted) -> Profile {
        let to = wanted.from + wanted.size;
        match wanted.position {
            true => Profile::position(wanted.from, to, self.acceleration / TAU, self.speed / TAU),
            false => Profile::speed(wanted.from, to, self.acceleration),
        }
    }
}

/// Before a sine, periods: what it begins with has died away.
const SETTLE: f64 = 1.0;

pub(super) fn sine(client: &mut Client, options: &SineOptions, out: Out) -> Result<()> {
    options.files.probe()?;
    let (mut sines, mut missed) = (Vec::new(), Vec::new());
    let mut all = Vec::new();
    let mut shown = None;
    for &hz in &options.frequency {
        let (wanted, trace) = Session::run(client, options.files.hz, |session| {
            let wanted = Wanted::of(options.axis, session, out);
            wanted.reach(session, out)?;
            let began_s = session.now_s();
            let seconds = (f64::from(options.periods) + SETTLE) / hz;
            let value = |now_s: f64| wanted.from + wanted.size * (TAU * hz * (now_s - began_s)).sin();
            session.follow(seconds, |now_s| wanted.target(value(now_s)), |moment| moment.position(wanted.position))?;
            Ok(wanted)
        })?;
        let (Some(first), Some(last)) = (trace.first(), trace.last()) else {
            missed.push(hz);
            continue;
        };
        let from_s = last.time_s - f64::from(options.periods) / hz;
        let late: Vec<_> = trace.iter().filter(|row| row.time_s >= from_s).collect();
        let of = |value: fn(&Trace) -> f64| late.iter().map(|row| (row.time_s, value(row))).collect::<Vec<Point>>();
        match Sine::of(&of(|row| row.set), &of(|row| row.measured), hz, wanted.size) {
            Some(sine) => sines.push(sine),
            None => missed.push(hz),
        }
        let end_s = all.last().map_or(0.0, |row: &(f64, f64, f64)| row.0);
        all.extend(trace.iter().map(|row| (end_s + row.time_s - first.time_s, row.set, row.measured)));
        shown = Some(wanted);
    }
    let head = ["", "gain", "phase"].map(String::from).to_vec();
    let rows = sines
        .iter()
        .map(|sine| vec![format!("{} Hz", sine.hz), format!("{:.3}", sine.gain), format!("{:.1}°", sine.phase_deg)]);
    if !sines.is_empty() {
        out.table(&std::iter::once(head).chain(rows).collect::<Vec<_>>())?;
    }
    let (bandwidth_hz, margin_deg) = bandwidth(&sines);
    match bandwidth_hz {
        Some(hz) => say!(out, "bandwidth, −3 dB: {hz:.2} Hz")?,
        None if sines.is_empty() => {}
        None if sines.iter().all(|sine| sine.gain < LOW) => say!(out, "bandwidth: below these frequencies")?,
        None => say!(out, "no bandwidth: the gain does not fall through −3 dB at these frequencies")?,
    }
    if let Some(margin_deg) = margin_deg {
        say!(out, "phase margin: {margin_deg:.0}°")?;
    }
    out.value(&json!({ "sines": sines, "bandwidth_hz": bandwidth_hz, "phase_margin_deg": margin_deg }))?;
    if let Some(wanted) = shown {
        save(&options.files, &wanted, &all, None)?;
    }
    not_missed(&missed)
}

/// Frequencies that were not measured are none without a gain.
fn not_missed(hz: &[f64]) -> Result<()> {
    if hz.is_empty() {
        return Ok(());
    }
    let named: Vec<_> = hz.iter().map(|hz| format!("{hz} Hz")).collect();
    Err(Error::Failed(format!(
        "not measured: {}: set-points or frames come too seldom for it\n  A lower frequency, or a larger --hz; `hallctl \
         chirp` measures up to the rate of the control.",
        named.join(", ")
    )))
}

/// Time, set-point and measured.
type Row = (f64, f64, f64);

fn save(files: &Files, wanted: &Wanted, rows: &[Row], model: Option<(&Profile, f64)>) -> Result<()> {
    if let Some(path) = &files.csv {
        let lines = rows.iter().map(|(time_s, set, measured)| format!("{time_s:.6},{set:.6},{measured:.6}\n"));
        out::save(path, String::from("time_s,set_point,measured\n") + &lines.collect::<String>())?;
    }
    if let Some(path) = &files.plot {
        plot(path, wanted, rows, model)?;
    }
    Ok(())
}

fn plot(path: &Path, wanted: &Wanted, rows: &[Row], model: Option<(&Profile, f64)>) -> Result<()> {
    let (name, unit) = wanted.unit();
    let mut series = vec![
        Series::new("set-point", rows.iter().map(|row| (row.0, row.1))),
        Series::new("measured", rows.iter().map(|row| (row.0, row.2))),
    ];
    if let Some((model, _)) = model {
        series.push(Series::new("trajectory asked for", rows.iter().map(|row| (row.0, model.at(row.0)))));
    }
    let mut report = Report::new("Response of a hallservo drive");
    report.lead(
        "What the drive was told and what it did: how fast it follows, how far it overshoots, when it has settled.",
    );
    report.plot(&Plot::new(name, "time / s", &format!("{} / {unit}", name.to_lowercase()), series), "")?;
    out::save(path, report.html())
}
