//! What takes a while: calibration, identification, cogging.

use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::out::Out;
use crate::{say, values, words};
use hallservo::fault::Fault;
use hallservo::hall::calibrate::{self, report::Report};
use hallservo::service::{identify, procedure};
use hallservo_protocol::{Activity, Answer, Ask, Calibration, Procedure};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::time::Instant;

/// How a procedure runs.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Options {
    /// Begin it and leave: the motor turns to the end though no tool watches
    #[arg(long)]
    unattended: bool,
}

/// Begins a procedure; true if this tool is to wait for its end.
pub(super) fn begin(client: &mut Client, options: &Options, ask: Ask<'_>, out: Out) -> Result<bool> {
    free_shaft(client)?;
    client.unattended(options.unattended);
    client.order(ask)?;
    if options.unattended {
        say!(out, "begun: `hallctl status` tells how far it is, `hallctl stop` ends it")?;
        out.value(&json!({ "begun": true }))?;
    }
    Ok(!options.unattended)
}

/// What turns the motor by whole turns wants a shaft without bounds: it does not look at them.
pub(super) fn free_shaft(client: &mut Client) -> Result<()> {
    for (name, free) in [("min_position_turns", "-1e6"), ("max_position_turns", "1e6")] {
        let bound = match client.setting(Ask::Get(name), |setting| setting.value) {
            // A drive without current control follows no position.
            Err(Error::Refused(_)) => continue,
            bound => bound?,
        };
        if bound.abs() < 1e6 {
            return Err(Error::Refused(format!(
                "{name} is {bound}, and this turns the shaft by whole turns, past its bounds\n  Free the shaft, \
                 `hallctl settings set {name} {free}`, and set it again afterwards."
            )));
        }
    }
    Ok(())
}

/// Shows a bar until the drive has nothing going on any more.
pub(super) fn wait(client: &mut Client, name: &'static str) -> Result<()> {
    let bar = ProgressBar::new(1000);
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(name);
    let mut look = (Instant::now(), 0);
    loop {
        let status = client.status()?;
        if status.activity == Activity::None {
            bar.finish_and_clear();
            return Ok(());
        }
        bar.set_position((1000.0 * status.progress) as u64);
        client.rest(&mut look, &status)?;
    }
}

pub(super) fn calibrate(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    if !begin(client, options, Ask::Calibrate, out)? {
        return Ok(());
    }
    match calibrated(client)? {
        Ok(report) => show(&report, out),
        Err(error) => {
            Err(Error::Failed(format!("the calibration failed: {error}\n  {}.", words::what_to_do(Fault::Calibration))))
        }
    }
}

/// Calibrates: what it found, or why the drive refuses its sensors.
pub(super) fn calibration(client: &mut Client) -> Result<std::result::Result<Report, calibrate::Error>> {
    client.order(Ask::Calibrate)?;
    calibrated(client)
}

/// What a calibration that was begun comes to.
fn calibrated(client: &mut Client) -> Result<std::result::Result<Report, calibrate::Error>> {
    wait(client, "calibrating")?;
    let outcome = client.ask(Ask::Calibration, |answer| match answer {
        Answer::Calibration(outcome) => Ok(outcome),
        other => unexpected(&other),
    })?;
    match outcome {
        Calibration::Done(report) => Ok(Ok(report)),
        Calibration::Failed(error) => Ok(Err(error)),
        Calibration::Ended => Err(Error::Failed(
            "the calibration was ended by a command or a fault: see `hallctl faults`\n  The one before, if there was one, \
                 is in use again; or `hallctl calibrate` again."
                .into(),
        )),
        Calibration::None | Calibration::Running => {
            Err(Error::Failed("the drive was restarted while it calibrated".into()))
        }
    }
}

fn show(report: &Report, out: Out) -> Result<()> {
    say!(out, "Calibrated.\n")?;
    let head = ["", "swing", "offset", "placement", "3rd", "5th", "noise"].map(String::from).to_vec();
    let rows = report.present().iter().enumerate().map(|(k, sensor)| {
        vec![
            format!("Hall {}", k + 1),
            format!("{:.0} codes", sensor.swing),
            format!("{:.0}", sensor.offset),
            format!("{:+.1}°", sensor.placement_error.to_degrees()),
            percent(sensor.third_pct),
            percent(sensor.fifth_pct),
            format!("{:.1} %", sensor.noise_pct),
        ]
    });
    out.table(&std::iter::once(head).chain(rows).collect::<Vec<_>>())?;
    let order = if report.pattern.forward { "in the order of the phases" } else { "against the order of the phases" };
    say!(out, "\nThe Halls are {}° apart, {order}.", report.pattern.spacing)?;
    say!(out, "The angle is noisy by {:.2}° before tracking (electrical, RMS).", report.angle_noise_deg)?;
    say!(
        out,
        "The rotor lagged {:.1}° behind the field and swung by {:.1}°; {:.2} % of the signals are unexplained.",
        report.lag.to_degrees().abs(),
        report.hunting_deg,
        report.residual_pct
    )?;
    for finding in report.findings() {
        say!(out, "Worth mending: {finding}.")?;
    }
    out.value(&values::calibration(report))
}

/// To a tenth, and zero without a sign.
fn percent(value: f32) -> String {
    format!("{:.1} %", (10.0 * value).round() / 10.0 + 0.0)
}

pub(super) fn identify(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    if !begin(client, options, Ask::Identify, out)? {
        return Ok(());
    }
    let report = identified(client)?.map_err(|error| unidentified(&error))?;
    say!(out, "{report}What is not doubtful is in the settings now; `hallctl settings save` keeps it.")?;
    out.value(&report)
}

/// Measures the motor; none where the measurements do not determine it.
pub(super) fn identification(client: &mut Client) -> Result<Option<identify::Report>> {
    client.order(Ask::Identify)?;
    match identified(client)? {
        Ok(report) => Ok(Some(report)),
        Err(procedure::Error::Inconclusive) => Ok(None),
        Err(error) => Err(unidentified(&error)),
    }
}

/// What a measurement that was begun comes to.
fn identified(client: &mut Client) -> Result<std::result::Result<identify::Report, procedure::Error>> {
    wait(client, "measuring the motor")?;
    client.ask(Ask::Identification, |answer| match answer {
        Answer::Identification(Procedure::Done(report)) => Ok(Ok(report)),
        Answer::Identification(Procedure::Failed(error)) => Ok(Err(error)),
        other => unexpected(&other),
    })
}

fn unidentified(error: &procedure::Error) -> Error {
    Error::Failed(format!("the identification failed: {}", words::procedure_error(error)))
}

pub(super) fn learn_cogging(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    if !begin(client, options, Ask::LearnCogging, out)? {
        return Ok(());
    }
    wait(client, "learning the cogging")?;
    let cogging = client.ask(Ask::Cogging, |answer| match answer {
        Answer::Cogging(Procedure::Done(cogging)) => Ok(cogging),
        Answer::Cogging(Procedure::Failed(error)) => {
            Err(Error::Failed(format!("learning the cogging failed: {}", words::procedure_error(&error))))
        }
        other => unexpected(&other),
    })?;
    say!(
        out,
        "The cogging takes {:.3} A RMS, {:.3} A at most; it is compensated from now on, and stored.",
        cogging.rms_a,
        cogging.largest_a
    )?;
    if cogging.by_pole_a > 0.0 {
        say!(
            out,
            "Beside it, {:.3} A RMS differ from pole to pole. That is compensated, too. After a power-up the drive has to find\n\
             the pole again, for which the motor makes a few turns one way; `hallctl magnets show` says whether it has.",
            cogging.by_pole_a
        )?;
    }
    out.value(&cogging)
}
