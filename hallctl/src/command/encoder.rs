//! `hallctl encoder`: two rings on the shaft.

use super::procedures::wait;
use super::{rate, seconds};
use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::out::{Out, create};
use crate::{say, words};
use anyhow::Context as _;
use hallservo::mode::Mode;
use hallservo::vernier::calibrate::Report;
use hallservo::vernier::eccentricity::Geometry;
use hallservo::vernier::rings::Rings;
use hallservo_protocol::{Answer, Ask, EncoderAsk, EncoderCalibration, EncoderStatus};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Bits of a head that is sampled by a board's ADC.
const BITS: u8 = 12;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Turn the shaft a few times and find out what the heads deliver
    Calibrate {
        /// Turn it by hand, steadily, about a turn in two seconds; with the bridge off
        #[arg(long)]
        by_hand: bool,
    },
    /// How it is: angle, residual against its limit, agreement with the Halls
    Status,
    /// The shaft is at zero where it is now
    Zero,
    /// The Halls take their electrical zero from the encoder, without motion: after they were moved by a little
    Align,
    /// Other rings: pole pairs of the one that gives the fine angle, and of the other
    Rings {
        /// Like 37/45
        pairs: String,
    },
    /// There are no rings any more
    Forget,
    /// Watch angle and residual
    Watch(Watch),
}

/// How to watch.
#[derive(Debug, clap::Args)]
pub(super) struct Watch {
    /// For so long; without, until interrupted
    #[arg(long, value_parser = seconds)]
    seconds: Option<f64>,
    /// Times a second
    #[arg(long, default_value_t = 10.0, value_parser = rate)]
    hz: f32,
    /// Write it into this file instead of showing it
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
}

pub(super) fn run(client: &mut Client, command: &Command, out: Out) -> Result<()> {
    // A board without an encoder does not understand what it is asked; of settings it says that it has none.
    if let Err(Error::Refused(_)) = client.setting(Ask::Get("encoder_reference_pairs"), |_| ()) {
        return Err(Error::Refused("this drive has no encoder: its board samples no heads".into()));
    }
    match command {
        Command::Calibrate { by_hand } => calibrate(client, *by_hand, out),
        Command::Status => show(client, out),
        Command::Zero => {
            client.order(Ask::Encoder(EncoderAsk::Zero))?;
            say!(out, "The position is zero here; stored.")
        }
        Command::Align => align(client, out),
        Command::Rings { pairs } => set_rings(client, pairs),
        Command::Forget => {
            client.order(Ask::Encoder(EncoderAsk::Forget))?;
            say!(out, "The encoder is not calibrated any more.")
        }
        Command::Watch(options) => watch(client, options, out),
    }
}

/// How the encoder is. A board without one does not know what it is asked.
pub(super) fn status(client: &mut Client) -> Result<EncoderStatus> {
    client.ask(Ask::Encoder(EncoderAsk::Status), |answer| match answer {
        Answer::Encoder(status) => Ok(status),
        other => unexpected(&other),
    })
}

fn align(client: &mut Client, out: Out) -> Result<()> {
    let ahead = status(client)?.halls_ahead_deg;
    client.order(Ask::Encoder(EncoderAsk::Align))?;
    say!(out, "The Halls were {ahead:+.2}° electrical ahead; their zero is now the encoder's. Stored.")
}

fn calibrate(client: &mut Client, by_hand: bool, out: Out) -> Result<()> {
    if !by_hand {
        super::procedures::free_shaft(client)?;
    }
    client.order(Ask::Encoder(EncoderAsk::Calibrate { by_hand }))?;
    if by_hand {
        say!(out, "Turn the shaft, always the same way, steadily, about a turn in two seconds, until this ends.")?;
    }
    wait(client, "calibrating the encoder")?;
    match status(client)?.calibration {
        EncoderCalibration::Done(report) => {
            out.value(&report)?;
            show_report(&status(client)?, &report, out)
        }
        EncoderCalibration::Failed(error) => Err(Error::Failed(match client.status()?.mode {
            Mode::Faulted(fault) => format!("the calibration failed: {fault}\n  {}.", words::what_to_do(fault)),
            _ => format!("the calibration failed: {error}"),
        })),
        EncoderCalibration::None | EncoderCalibration::Running(_) => {
            Err(Error::Failed("the drive was restarted while it calibrated".into()))
        }
    }
}

fn show_report(status: &EncoderStatus, report: &Report, out: Out) -> Result<()> {
    let [reference, vernier] = status.pairs;
    let [_, limit, margin] = status.residual_counts;
    let worst = margin * report.worst_residual as f32 / report.margin.max(1) as f32;
    say!(out, "Calibrated: rings of {reference} and {vernier} pole pairs, heads over each: {}.\n", status.heads)?;
    say!(
        out,
        "The largest residual is {worst:.1} counts; {limit:.1} are let pass, {margin:.1} would be a wrong pole pair."
    )?;
    say!(
        out,
        "{} % of the pole pairs are alike at least; the rings together have changed the curves by {:.2}° electrical.",
        report.similar_percent,
        f32::from(report.refinement) * 360.0 / 65_536.0
    )?;
    if status.mounted {
        say!(out, "The position counts from the encoder's zero: `hallctl encoder zero` where that is to be.")
    } else {
        say!(out, "The Halls are not calibrated, so the motor does not use it: `hallctl calibrate`, then this again.")
    }
}

fn show(client: &mut Client, out: Out) -> Result<()> {
    let status = status(client)?;
    out.value(&status)?;
    let line = |name: &str, value: &str| say!(out, "  {name:<14}{value}");
    let [reference, vernier] = status.pairs;
    say!(out, "rings of {reference} and {vernier} pole pairs, heads over each: {}", status.heads)?;
    line("calibration", calibration(&status))?;
    line("angle", &angle(&status))?;
    if let (Some(fault), None) = (status.last_fault, status.fault) {
        line("", &format!("{} samples without; the last one because {fault}", status.missed))?;
    }
    line("position", &position(&status))?;
    if status.calibrated {
        let [worst, limit, margin] = status.residual_counts;
        line("residual", &format!("{worst:.1} counts at most; limit {limit:.1}, margin {margin:.1}"))?;
    }
    if !status.halls_ahead_deg.is_nan() && !status.tolerance_deg.is_nan() {
        let (ahead, most) = (status.halls_ahead_deg, status.tolerance_deg);
        line("Halls", &format!("{ahead:+.2}° electrical ahead; up to {most:.1}° at power-up"))?;
    }
    line("fastest", &format!("{:.0} rad/s", status.fastest_rad_s))?;
    line("tolerates", &tolerated(client, &status)?)?;
    line("flash", &words::problem(status.stored))
}

const fn calibration(status: &EncoderStatus) -> &'static str {
    match (status.calibrated, status.mounted) {
        (false, _) => "none: `hallctl encoder calibrate`",
        (true, false) => "of the rings; how they sit on the rotor's shaft is not known",
        (true, true) => "complete",
    }
}

fn angle(status: &EncoderStatus) -> String {
    let proven = if status.proven { "proven by motion" } else { "not proven by motion yet" };
    match status.fault {
        Some(fault) => format!("none: {fault}"),
        None if status.angle_deg.is_nan() => "none".into(),
        None => format!("{:.4}° from the zero, {proven}", status.angle_deg),
    }
}

fn position(status: &EncoderStatus) -> String {
    match (status.absolute, status.used) {
        (true, true) => "absolute; the encoder closes the loops".into(),
        (true, false) => "absolute; the Halls close the loops".into(),
        (false, _) if !status.mounted => "not absolute: turns since power-up".into(),
        (false, _) if status.halls_ahead_deg.abs() > status.tolerance_deg => {
            "not absolute: Halls and encoder do not agree. Rings that have turned on the shaft, or a head: calibrate again".into()
        }
        (false, _) => "not absolute yet: Halls and encoder are being compared, with the bridge off".into(),
    }
}

/// The eccentricity that the construction bears, by the library's own formula.
fn tolerated(client: &mut Client, status: &EncoderStatus) -> Result<String> {
    let [reference, vernier] = status.pairs;
    let Ok(rings) = Rings::new(reference, vernier, BITS) else { return Ok("no such rings".into()) };
    let mut value = |name| client.setting(Ask::Get(name), |setting| setting.value);
    let length = value("encoder_pole_pair_mm")?;
    let head_angle = value("encoder_head_angle_deg")?;
    let geometry = Geometry::from_pole_length(&rings, length, head_angle.to_radians());
    let Geometry { reference_radius, vernier_radius, .. } = geometry;
    let (tolerable, heads) = if status.heads > 1 {
        (geometry.tolerable_with_pairs(&rings, 1.0_f32.to_radians()), "opposite heads to within 1°".to_string())
    } else {
        (geometry.tolerable(&rings), format!("heads {head_angle}° apart"))
    };
    Ok(format!(
        "{tolerable:.3} mm of eccentricity uncalibrated; radii {reference_radius:.2} and {vernier_radius:.2} mm, {heads}"
    ))
}

fn set_rings(client: &mut Client, pairs: &str) -> Result<()> {
    let parsed = pairs.split_once('/').and_then(|(one, other)| Some((one.parse().ok()?, other.parse().ok()?)));
    let Some((reference, vernier)) = parsed else {
        return Err(Error::Failed(format!("two rings are like 37/45, not {pairs:?}")));
    };
    client.order(Ask::Encoder(EncoderAsk::Rings { reference, vernier }))
}

fn watch(client: &mut Client, options: &Watch, out: Out) -> Result<()> {
    let mut file = match &options.csv {
        Some(path) => Some(csv::Writer::from_writer(create(path)?)),
        None => None,
    };
    let head = ["s", "angle_deg", "residual_counts", "limit_counts", "margin_counts", "halls_ahead_deg", "missed"];
    if let Some(file) = &mut file {
        file.write_record(head).context("the file")?;
    }
    let began_ms = client.status()?.uptime_ms;
    let mut next = Instant::now();
    loop {
        let elapsed_s = (client.status()?.uptime_ms - began_ms) as f64 / 1000.0;
        if options.seconds.is_some_and(|most| elapsed_s >= most) {
            break;
        }
        let status = status(client)?;
        let [worst, limit, margin] = status.residual_counts;
        match &mut file {
            Some(file) => {
                let row = [f64::from(status.angle_deg), f64::from(worst), f64::from(limit), f64::from(margin)];
                let row =
                    [&[elapsed_s], &row[..], &[f64::from(status.halls_ahead_deg), f64::from(status.missed)]].concat();
                file.write_record(row.iter().map(f64::to_string)).context("the file")?;
            }
            None => {
                out.value(&status)?;
                say!(
                    out,
                    "{:>10.4}°  residual {worst:5.1} of {limit:.1} counts  {}",
                    status.angle_deg,
                    angle(&status)
                )?;
            }
        }
        next += Duration::from_secs_f32(1.0 / options.hz);
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    if let Some(file) = &mut file {
        file.flush().context("the file")?;
    }
    Ok(())
}
