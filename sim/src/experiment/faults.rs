//! Every fault, injected at random times into drives with the settings that the boards are shipped with: found, named,
//! and the shaft not moved the wrong way?

mod bench;
mod board;
mod campaign;
mod defect;
mod encoder;
mod kind;
mod machine;
mod motion;
mod summary;
mod two_halls;
mod words;

use super::Common;
use crate::report::{Bars, Report, print_table};
use anyhow::Result;
use campaign::Campaign;
use encoder::EncoderCampaign;
use rayon::prelude::*;
pub use summary::{Kind, Summary};

/// Options of `faults`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Faults to inject; 100000 for the long form
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..))]
    injections: u32,
    /// Sensors of the drives: three, or two that are 90°, 120° or 60° apart
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    halls: u8,
    /// Only the kinds whose name contains this
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Show where faults were missed or invented
    #[arg(long)]
    examples: bool,
}

/// Injections into one drive at one motor.
const EACH: u32 = 50;
/// One of so many injections is made into a drive with an encoder.
const ENCODERS: u32 = 16;
/// Drives with an encoder.
const ENCODER_CAMPAIGNS: u32 = 4;

/// `faults`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses without a reason.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let summary = run(options.common.seed, options.injections, options.halls, &options.only)?;
    println!("Faults at random times, {} Halls (seed {}):\n", summary.halls, summary.seed);
    let rows = summary.table();
    // What was said is in words: it has room on the page.
    print_table(&rows.iter().map(|row| row[..row.len() - 1].to_vec()).collect::<Vec<_>>());
    let alarms = summary.alarm_table();
    if alarms.len() > 1 {
        println!();
        print_table(&alarms);
    }
    println!(
        "\n  {} injected, {} detected, {} missed, {} false alarms in {} quiet periods; \
         {} motors that the calibration refused were replaced",
        summary.injected,
        summary.detected,
        summary.missed,
        summary.false_alarms,
        summary.quiet_periods,
        summary.refused_motors
    );
    if options.examples {
        print_examples(&summary);
    }
    let mut report = Report::new("Faults");
    report.lead(
        "What breaks in a running drive is to be found and named before it does harm, and nothing is to be reported that is \
         not broken.",
    );
    report.text(
        "Faults injected at random times into the drives of three boards, with the settings they are shipped with, at \
         motors that are not quite those of the settings. Missed are those that were not noticed in time, taken for \
         another, or that moved the shaft by more than 30° or for more than 50 ms the wrong way. Time from the \
         injection, or from switching on, to the fault; true current in A and in parts of over_current_a.",
    );
    let bars = summary.kinds.iter().map(|(name, kind)| (name.to_string(), kind.worst_wrong_deg.min(90.0)));
    if summary.kinds.values().any(|kind| kind.worst_wrong_deg > 0.0) {
        report.bars(
            &Bars {
                title: "Largest motion the wrong way".into(),
                x: "mechanical degrees".into(),
                bars: bars.collect(),
            },
            "Against the command, beyond what a load alone would have done; cut at 90°. Allowed are 30°.",
        )?;
    }
    // What was reported is long, and has a table of its own.
    let columns = |kept: fn(usize, usize) -> bool| -> Vec<Vec<String>> {
        let row = |row: &Vec<String>| {
            let cells = row.iter().enumerate().filter(|(column, _)| kept(*column, row.len() - 1));
            cells.map(|(_, cell)| cell.clone()).collect()
        };
        rows.iter().map(row).collect()
    };
    report.heading("Kinds of faults").table(&columns(|column, last| column < last));
    report.heading("What was reported").table(&columns(|column, last| column == 0 || column == last));
    if alarms.len() > 1 {
        report.text("Faults that were reported though nothing was wrong, and drives that were given up:");
        report.table(&alarms);
    }
    options.common.finish("faults", &summary, &report)
}

fn print_examples(summary: &Summary) {
    for (name, kind) in &summary.kinds {
        for (place, count) in &kind.missed_in {
            println!("  {name}: {count} missed, {place}");
        }
        for at in &kind.missed_at {
            println!("  {name}: {at}");
        }
    }
    for at in &summary.alarmed_at {
        println!("  false alarm: {at}");
    }
}

/// Injects so many faults into drives with three Halls or two, of the kinds whose name contains `only`.
///
/// # Errors
/// A drive that refuses without a reason.
pub fn run(seed: u64, injections: u32, halls: u8, only: &str) -> Result<Summary> {
    let with_encoder = if only.is_empty() && halls == 3 { injections / ENCODERS } else { 0 };
    let machines = (injections - with_encoder).div_ceil(EACH);
    let share = |whole: u32, parts: u32, number: u32| whole / parts + u32::from(number < whole % parts);
    let boards = (0..machines).into_par_iter().map(|number| {
        let seed = seed.wrapping_mul(1_000_003) + u64::from(number);
        match Campaign::new(seed, halls) {
            Ok(campaign) => Ok(campaign.run(share(injections - with_encoder, machines, number), only)),
            Err(error) => {
                let mut summary = Summary::new(seed, halls);
                summary.abandoned.insert(format!("{error:#}"), 1);
                Ok(summary)
            }
        }
    });
    let encoders = (0..ENCODER_CAMPAIGNS).into_par_iter().map(|number| {
        let seed = seed.wrapping_mul(ENCODER_CAMPAIGNS.into()) + u64::from(number);
        match share(with_encoder, ENCODER_CAMPAIGNS, number) {
            0 => Ok(Summary::new(seed, halls)),
            injections => EncoderCampaign::new(seed)?.run(injections),
        }
    });
    let parts = boards.chain(encoders).collect::<Result<Vec<_>>>()?;
    let mut total = Summary::new(seed, halls);
    for part in parts {
        total.add(&part);
    }
    total.finish();
    Ok(total)
}
