//! `hallctl magnets`: what the rotor's magnets do to the angle.

use super::procedures::{self, begin, wait};
use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::out::{self, Out};
use crate::{say, words};
use anyhow::Context as _;
use hallservo::angle::PolePairs;
use hallservo::hall::map::{FIT, Map};
use hallservo::service::magnets::Use;
use hallservo::service::procedure;
use hallservo_protocol::{
    Answer, Ask, CoggingByPole, MagnetsAsk, MagnetsReport, MagnetsStatus, POINTS_AT_ONCE, Problem, Procedure,
};
use serde_json::json;
use std::path::{Path, PathBuf};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Turn the rotor both ways, freely, and learn a map of its mechanical turn, in some 35 seconds at four pole
    /// pairs and under two minutes at fifteen; after `calibrate`
    Learn(procedures::Options),
    /// What each magnet does, what accuracy that allows, and whether the map is in use
    Show(Show),
    /// The map is given up
    Forget,
}

/// How to show it.
#[derive(Debug, clap::Args)]
pub(super) struct Show {
    /// Write the map into this file: mechanical degrees, electrical degrees that the Halls are ahead
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
}

pub(super) fn run(client: &mut Client, command: &Command, out: Out) -> Result<()> {
    // A drive that knows of no map says so to this.
    status(client)?;
    match command {
        Command::Learn(options) => learn(client, options, out),
        Command::Show(options) => show(client, options, out),
        Command::Forget => {
            client.order(Ask::Magnets(MagnetsAsk::Forget))?;
            say!(out, "There is no map any more.")?;
            out.value(&json!({ "done": true }))
        }
    }
}

fn status(client: &mut Client) -> Result<MagnetsStatus> {
    client.ask(Ask::Magnets(MagnetsAsk::Status), |answer| match answer {
        Answer::Magnets(status) => Ok(status),
        other => unexpected(&other),
    })
}

/// Whether a map is in use; a firmware that knows none uses none.
pub(super) fn are_mapped(client: &mut Client) -> Result<bool> {
    match status(client) {
        Ok(status) => Ok(status.state == Use::Used),
        Err(Error::Refused(_)) => Ok(false),
        Err(error) => Err(error),
    }
}

fn learn(client: &mut Client, options: &procedures::Options, out: Out) -> Result<()> {
    if !begin(client, options, Ask::Magnets(MagnetsAsk::Learn), out)? {
        return Ok(());
    }
    wait(client, "learning the magnets")?;
    let report = match status(client)?.learning {
        Procedure::Done(report) => report,
        Procedure::Failed(error) => {
            // What else ends it has nothing to do with the shaft.
            let is_held = matches!(error, procedure::Error::NotReached | procedure::Error::Inconclusive);
            let hint = if is_held { "\n  The shaft has to turn freely, with little on it." } else { "" };
            let why = words::procedure_error(&error);
            return Err(Error::Failed(format!("learning the magnets failed: {why}{hint}")));
        }
        Procedure::None | Procedure::Running => {
            return Err(Error::Failed("the drive was restarted while it learnt the magnets".into()));
        }
    };
    if !report.kept {
        say!(
            out,
            "The magnets are alike: they turn the angle by {:.2}° RMS, less than its noise of {:.2}°. No map is kept.",
            report.without_deg,
            report.with_deg
        )?;
        return out.value(&json!({ "report": report }));
    }
    tell(client, out, None)
}

fn show(client: &mut Client, options: &Show, out: Out) -> Result<()> {
    tell(client, out, options.csv.as_deref())
}

/// The map, piece by piece.
fn map(client: &mut Client, pole_pairs: u8) -> Result<Option<Map>> {
    let Some(pairs) = PolePairs::new(pole_pairs) else { return Ok(None) };
    let count = Map::points_for(pairs);
    let mut points = Vec::new();
    while points.len() < count {
        let piece = client.ask(Ask::Magnets(MagnetsAsk::Points(points.len() as u16)), |answer| match answer {
            Answer::MagnetPoints(piece) => Ok(piece),
            other => unexpected(&other),
        })?;
        points.extend(piece.iter().take(POINTS_AT_ONCE.min(count - points.len())));
    }
    Ok(Map::of_points(pairs, points.into_iter()))
}

fn tell(client: &mut Client, out: Out, csv: Option<&Path>) -> Result<()> {
    let status = status(client)?;
    let Some(map) = map(client, status.pole_pairs)? else {
        if let Some(path) = csv {
            let why = why_none(&status);
            return Err(Error::Refused(format!("there is no map for {}{why}", path.display())));
        }
        say!(out, "There is no map{}", why_none(&status))?;
        let cogging = tell_cogging(client, &status.cogging, out)?;
        return out.value(&json!({ "state": word(status.state), "report": null, "cogging": cogging }));
    };
    let pairs = of_pairs(&map);
    let head = ["pole pair", "mean", "at most"].map(String::from).to_vec();
    let rows = pairs.iter().enumerate();
    let rows = rows.map(|(k, [mean, most])| vec![format!("{}", k + 1), format!("{mean:+.2}°"), format!("{most:.2}°")]);
    say!(out, "How far the Halls' angle is ahead of the rotor, in electrical degrees:\n")?;
    out.table(&std::iter::once(head).chain(rows).collect::<Vec<_>>())?;
    let worst = (0..pairs.len()).max_by(|&a, &b| pairs[a][1].total_cmp(&pairs[b][1])).unwrap_or(0);
    say!(out, "\nPole pair {} is the worst.", worst + 1)?;
    let MagnetsReport { without_deg, with_deg, found_again, .. } = status.report;
    say!(
        out,
        "This rotor allows {:.2}° RMS without the map, and {with_deg:.2}° with it.",
        without_deg.hypot(with_deg)
    )?;
    if !found_again {
        say!(out, "Its poles are too much alike to be told after power-up: `hallctl magnets learn` again then.")?;
    }
    say!(out, "The map is {}; in the flash: {}.", state(&status), words::problem(status.stored))?;
    let cogging = tell_cogging(client, &status.cogging, out)?;
    if let Some(path) = csv {
        write(&map, path)?;
    }
    out.value(&json!({
        "state": word(status.state),
        "report": status.report,
        "turns": status.turns,
        "fit": status.fit,
        "left_deg": status.left_deg,
        "worst_pole_pair": worst + 1,
        "cogging": cogging,
        "pole_pairs": pairs.iter().map(|[mean, most]| json!({ "mean_deg": mean, "most_deg": most })).collect::<Vec<_>>(),
    }))
}

/// Tells of the cogging that differs from pole to pole, and has it as a value. Its table keeps its pole while none of
/// the cogging is compensated.
fn tell_cogging(client: &mut Client, cogging: &CoggingByPole, out: Out) -> Result<serde_json::Value> {
    let on = client.status()?.anti_cogging;
    let state = match cogging.state {
        _ if !on => "not compensated, nor is the rest: `hallctl cogging on`",
        Use::None => "not compensated",
        Use::Searching => "not compensated yet: its pole is looked for while the motor turns",
        Use::Used => "compensated",
        Use::Foreign => "not compensated: it did not fit, again and again. Another rotor? `hallctl cogging learn`",
    };
    if cogging.rms_a > 0.0 {
        say!(out, "Of the cogging, {:.3} A RMS differ from pole to pole: {state}.", cogging.rms_a)?;
    }
    Ok(json!({ "state": if on { word(cogging.state) } else { "off" }, "rms_a": cogging.rms_a }))
}

fn why_none(status: &MagnetsStatus) -> &'static str {
    match status.stored {
        Problem::Foreign => {
            ": the one in the flash is of another calibration or rotor\n  `hallctl magnets learn` learns it anew."
        }
        Problem::None | Problem::Blank => ": `hallctl magnets learn` learns one.",
        _ => ": the flash holds none that is whole\n  `hallctl magnets learn` learns it anew.",
    }
}

/// Mean of each pole pair, and the largest in it.
fn of_pairs(map: &Map) -> Vec<[f32; 2]> {
    let degrees = |point: &i16| f32::from(*point) * (360.0 / 262_144.0);
    let points = map.points();
    points
        .chunks(points.len() / usize::from(map.pole_pairs()))
        .zip(map.pitch_deg())
        .map(|(pair, mean)| [mean, pair.iter().map(|point| degrees(point).abs()).fold(0.0, f32::max)])
        .collect()
}

const fn word(state: Use) -> &'static str {
    match state {
        Use::None => "none",
        Use::Searching => "searching",
        Use::Used => "used",
        Use::Foreign => "foreign",
    }
}

fn state(status: &MagnetsStatus) -> String {
    match status.state {
        Use::None => "not used".into(),
        Use::Used if status.fit.is_nan() => "in use, as learnt".into(),
        Use::Used => {
            format!("in use: its pole fits by {:.1} against the next, where 1 is right and −1 wrong", status.fit)
        }
        Use::Searching if status.turns == 0 => "not used yet: its pole is looked for while the rotor turns".into(),
        Use::Searching => format!(
            "not used yet: looked for {} times, the best pole fits by {:.1} against the next, {FIT} is wanted",
            status.turns, status.fit
        ),
        Use::Foreign => {
            "not used: it did not fit, again and again. Another rotor, Halls that were moved? `hallctl calibrate`"
                .into()
        }
    }
}

fn write(map: &Map, path: &Path) -> Result<()> {
    let mut file = csv::Writer::from_writer(Vec::new());
    file.write_record(["mechanical_deg", "ahead_deg"]).context("the file")?;
    let count = map.points().len();
    for (k, point) in map.points().iter().enumerate() {
        let row = [360.0 * k as f64 / count as f64, f64::from(*point) * 360.0 / 262_144.0];
        file.write_record(row.map(|value| format!("{value:.4}"))).context("the file")?;
    }
    out::save(path, file.into_inner().map_err(csv::IntoInnerError::into_error).context("the file")?)
}
