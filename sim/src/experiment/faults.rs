//! Every fault, injected at random times into running drives: found, told from the others, and the bridge off?

mod campaign;
mod encoder;
mod injection;
mod summary;

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
    /// Faults to inject
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..))]
    injections: u32,
}

/// `faults`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written, or a drive that refuses without a reason.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let summary = run(options.common.seed, options.injections)?;
    println!("Faults at random times (seed {}):\n", options.common.seed);
    let rows = summary.table();
    print_table(&rows);
    println!(
        "\n  {} injected, {} detected, {} missed, {} false alarms in {} quiet periods",
        summary.injected, summary.detected, summary.missed, summary.false_alarms, summary.quiet_periods
    );
    let mut report = Report::new("Faults");
    report.text(
        "Faults injected at random times into drives that follow currents, speeds and positions with all \
         three commutations.",
    );
    report.table(&rows);
    let bars = summary.kinds.iter().map(|(name, kind)| (name.to_string(), f64::from(kind.worst_detection_periods)));
    report.bars(
        &Bars { title: "Longest detection".into(), x: "control periods".into(), bars: bars.collect() },
        "A stall, a timeout and two Halls that agree for the moment take the time that is set, or that the rotor \
         needs to turn on.",
    )?;
    options.common.finish("faults", &summary, &report)
}

/// Injects so many faults.
///
/// # Errors
/// A drive that refuses without a reason.
pub fn run(seed: u64, injections: u32) -> Result<Summary> {
    const CAMPAIGNS: u64 = 8;
    let campaign = |number: u64| {
        let share = injections / CAMPAIGNS as u32 + u32::from(number < u64::from(injections) % CAMPAIGNS);
        // Three of the eighteen kinds are found with an encoder.
        let encoder = share / 6;
        let seed = seed.wrapping_mul(CAMPAIGNS) + number;
        let mut summary = Campaign::new(seed)?.run(share - encoder)?;
        summary.add(&EncoderCampaign::new(seed)?.run(encoder)?);
        anyhow::Ok(summary)
    };
    let parts = (0..CAMPAIGNS).into_par_iter().map(campaign).collect::<Result<Vec<_>>>()?;
    let mut total = Summary { seed, bridge_off_within_one_period: true, ..Summary::default() };
    for part in parts {
        total.add(&part);
    }
    Ok(total)
}
