//! Every fault, injected at random times into running drives: found, told from the others, and the bridge off?

mod campaign;
mod encoder;
mod injection;

use super::Common;
use crate::report::{Bars, Report, print_table};
use anyhow::Result;
use campaign::Campaign;
use encoder::EncoderCampaign;
use hallservo::control::settings::{GuardSettings, OnTimeout, Settings as Control};
use hallservo::fault::Fault;
use hallservo::settings::Settings;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// Options of `faults`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Faults to inject
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..))]
    injections: u32,
}

/// One kind of fault.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Kind {
    /// How often it was injected.
    pub injected: u32,
    /// Found, and told from the others.
    pub detected: u32,
    /// Most control periods from the first sample that shows it to the latched fault.
    pub worst_detection_periods: u32,
    /// Of the faults that only a turning rotor shows: most electrical turns until then.
    pub worst_detection_turns: f64,
}

/// What came of an injection.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    fault: Option<Fault>,
    /// Control periods and electrical turns of the rotor until then.
    periods: u32,
    turns: f64,
}

/// The figures of `faults --json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// Faults injected.
    pub injected: u32,
    /// Faults found.
    pub detected: u32,
    /// Faults not found, or taken for another.
    pub missed: u32,
    /// Faults reported where none was.
    pub false_alarms: u32,
    /// Running periods without a fault, in all.
    pub quiet_periods: u64,
    /// Of the faults that one sample of a voltage, a current or the clock shows: most periods to the latched fault.
    pub worst_detection_periods: u32,
    /// Whether the step that latched a fault always switched the bridge off.
    pub bridge_off_within_one_period: bool,
    /// Each kind.
    pub kinds: BTreeMap<&'static str, Kind>,
}

const TIMEOUT_PERIODS: u32 = 1200;
/// Successive samples without an angle that are bridged, as on the boards: a spark, but not a broken wire.
const TOLERATED: u8 = 1;

fn settings() -> Settings {
    let guard = GuardSettings {
        stall_s: 0.02,
        command_timeout_s: TIMEOUT_PERIODS as f32 / 40e3,
        on_timeout: OnTimeout::Fault,
        ..GuardSettings::default()
    };
    let control = Control { max_speed_rad_s: 150.0, guard, ..Control::default() };
    Settings { control: Some(control), max_electrical_hz: 150.0, tolerated_samples: TOLERATED, ..Settings::default() }
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
    report.text("Faults injected at random times into drives that follow currents, speeds and positions with all three commutations.");
    report.table(&rows);
    let bars = summary.kinds.iter().map(|(name, kind)| (name.to_string(), f64::from(kind.worst_detection_periods)));
    report.bars(
        &Bars { title: "Longest detection".into(), x: "control periods".into(), bars: bars.collect() },
        "A stall, a timeout and two Halls that agree for the moment take the time that is set, or that the rotor needs to turn on.",
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

impl Summary {
    fn add(&mut self, part: &Self) {
        self.injected += part.injected;
        self.detected += part.detected;
        self.missed += part.missed;
        self.false_alarms += part.false_alarms;
        self.quiet_periods += part.quiet_periods;
        self.worst_detection_periods = self.worst_detection_periods.max(part.worst_detection_periods);
        self.bridge_off_within_one_period &= part.bridge_off_within_one_period;
        for (name, kind) in &part.kinds {
            let sum = self.kinds.entry(name).or_default();
            sum.injected += kind.injected;
            sum.detected += kind.detected;
            sum.worst_detection_periods = sum.worst_detection_periods.max(kind.worst_detection_periods);
            sum.worst_detection_turns = sum.worst_detection_turns.max(kind.worst_detection_turns);
        }
    }

    /// Counts an injection that was found, or not, and whether one sample shows its kind.
    fn count(&mut self, name: &'static str, right: bool, found: &Found, at_once: bool) {
        self.injected += 1;
        self.detected += u32::from(right);
        self.missed += u32::from(!right);
        let kind = self.kinds.entry(name).or_default();
        kind.injected += 1;
        kind.detected += u32::from(right);
        if right {
            kind.worst_detection_periods = kind.worst_detection_periods.max(found.periods);
            kind.worst_detection_turns = kind.worst_detection_turns.max(found.turns);
        }
        if right && at_once {
            self.worst_detection_periods = self.worst_detection_periods.max(found.periods);
        }
    }

    fn table(&self) -> Vec<Vec<String>> {
        let head = ["fault", "injected", "detected", "longest detection, periods", "electrical turns"]
            .map(String::from)
            .to_vec();
        let rows = self.kinds.iter().map(|(name, kind)| {
            vec![
                (*name).to_string(),
                kind.injected.to_string(),
                kind.detected.to_string(),
                kind.worst_detection_periods.to_string(),
                format!("{:.2}", kind.worst_detection_turns),
            ]
        });
        std::iter::once(head).chain(rows).collect()
    }
}
