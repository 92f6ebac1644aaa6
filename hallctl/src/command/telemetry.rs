//! `hallctl telemetry`.

use super::writable;
use crate::client::Client;
use crate::error::Result;
use crate::words;
use anyhow::{Context, anyhow};
use hallservo::mode::Mode;
use hallservo_protocol::{Ask, Telemetry};
use sim::report::{Plot, Report, Series};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// For so long; without, until Ctrl-C
    #[arg(long, value_parser = super::seconds)]
    seconds: Option<f64>,
    /// So often a second, up to 1000; a UART of 460 800 baud carries 650
    #[arg(long, default_value_t = 100.0)]
    hz: f32,
    /// Into this file
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// As diagrams into this file
    #[arg(long, value_name = "FILE.html")]
    plot: Option<PathBuf>,
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
struct Row {
    time_s: f64,
    /// Frames missing before it.
    lost: u32,
    frame: Telemetry,
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

pub(super) fn watch(client: &mut Client, options: &Options) -> Result<()> {
    writable(options.csv.as_ref())?;
    writable(options.plot.as_ref())?;
    let mut csv = options.csv.as_ref().map(|path| table(path)).transpose()?;
    let mut rows = Rows { step_hz: client.identity().step_hz, last: None, steps: 0, lost: 0 };
    let mut kept = Vec::new();
    client.order(Ask::Telemetry(options.hz))?;
    let began_ms = client.status()?.uptime_ms;
    let end_ms = options.seconds.map(|seconds| began_ms + (1000.0 * seconds) as u64);
    let print = csv.is_none() && options.plot.is_none();
    let mut count = 0_u64;
    let mut look = (Instant::now(), began_ms);
    loop {
        // The status, beside being the clock, shows the drive that somebody is there.
        let status = client.status()?;
        let now_ms = status.uptime_ms;
        client.rest(&mut look, &status)?;
        let over = end_ms.is_some_and(|end| now_ms >= end);
        if over {
            // The frames before the answer are the last.
            client.order(Ask::Telemetry(0.0))?;
        }
        while let Some(frame) = client.telemetry() {
            let row = rows.row(frame);
            count += 1;
            if let Some(csv) = &mut csv {
                csv.write_record(record(&row)).context("the CSV file")?;
            }
            if print {
                show(&row)?;
            }
            if options.plot.is_some() {
                kept.push(row);
            }
        }
        if over {
            break;
        }
    }
    if let Some(mut csv) = csv {
        csv.flush().context("the CSV file")?;
    }
    if let Some(path) = &options.plot {
        plot(path, &kept)?;
    }
    eprintln!("{count} frames in {:.3} s, {} lost", rows.steps as f64 / rows.step_hz, rows.lost);
    Ok(())
}

fn table(path: &Path) -> anyhow::Result<csv::Writer<fs::File>> {
    let mut csv = csv::Writer::from_path(path).with_context(|| format!("cannot write {}", path.display()))?;
    csv.write_record(COLUMNS)?;
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

fn show(row: &Row) -> Result<()> {
    let Row { time_s, frame, .. } = row;
    let mut out = std::io::stdout();
    let mode = words::mode_word(frame.mode);
    writeln!(
        out,
        "{time_s:>9.3} s  {mode:<11} {:>10.4} turns {:>9.2} rad/s {:>8.3} A {:>6.2} V",
        frame.position_turns, frame.speed_rad_s, frame.current_a[1], frame.bus_v
    )
    .context("the terminal")?;
    Ok(())
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
        ("Speed", "rad/s", vec![series("speed", &|t| t.speed_rad_s.into())]),
        ("Position", "turns", vec![series("position", &|t| t.position_turns)]),
        (
            "Current",
            "A",
            vec![series("along q", &|t| t.current_a[1].into()), series("along d", &|t| t.current_a[0].into())],
        ),
        ("Bus voltage", "V", vec![series("bus", &|t| t.bus_v.into())]),
        ("Halls", "ADC codes", (0..3).map(|k| series(&format!("Hall {}", k + 1), &|t| t.codes[k].into())).collect()),
    ];
    let mut report = Report::new("Telemetry of a hallservo drive");
    for (title, unit, series) in diagrams {
        // What was not measured has no diagram.
        let series: Vec<_> = series.into_iter().filter(|series| !series.points.is_empty()).collect();
        if !series.is_empty() {
            report.plot(&Plot::new(title, "time in s", unit, series), "")?;
        }
    }
    Ok(fs::write(path, report.html()).with_context(|| format!("cannot write {}", path.display()))?)
}
