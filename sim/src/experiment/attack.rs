//! Random settings, commands and worlds at motors of every kind, judged by physics alone: what does a drive do that it must
//! not?

mod bout;
mod dice;
mod disturbance;
mod judge;
mod machine;
mod scenario;
mod setup;
mod tool;
mod trace;
mod wish;
mod world;

use super::Common;
use crate::report::{Report, print_table};
use anyhow::{Context, Result};
pub use bout::Sabotage;
use bout::{Bout, Outcome};
use indicatif::{ProgressBar, ProgressStyle};
pub use judge::{Breach, Verdict};
use rayon::prelude::*;
use scenario::Scenario;
pub use scenario::{Only, Temper};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
pub use trace::Trace;

/// Options of `attack`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    common: Common,
    /// Scenarios, of the seeds from `--seed` on
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u64).range(1..))]
    scenarios: u64,
    #[command(flatten)]
    only: Only,
    /// Print every scenario, and what the drive told of it
    #[arg(long)]
    each: bool,
    /// Write what led to the last breach to this file, a line a control period
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
}

/// A scenario that was attacked, and what came of it.
#[derive(Clone, Debug, Serialize)]
pub struct Attacked {
    /// Everything random.
    pub seed: u64,
    /// How much was done to it.
    pub temper: Option<Temper>,
    /// What it must not have done.
    pub verdicts: Vec<Verdict>,
    /// Faults that it told.
    pub told: Vec<String>,
    /// Why it was not attacked.
    pub idle: Option<String>,
    /// In words.
    #[serde(skip)]
    pub words: String,
    /// What led to the first breach.
    #[serde(skip)]
    pub trace: Trace,
}

/// The scenario of a seed, at a drive that is whole or not.
pub fn attack(seed: u64, only: &Only, sabotage: Sabotage) -> Attacked {
    let mut attacked = Attacked {
        seed,
        temper: None,
        verdicts: Vec::new(),
        told: Vec::new(),
        idle: None,
        words: String::new(),
        trace: Trace::default(),
    };
    let scenario = match Scenario::new(seed, only) {
        Ok(scenario) => scenario,
        Err(error) => return Attacked { idle: Some(format!("{error:#}")), ..attacked },
    };
    attacked.temper = Some(scenario.temper);
    attacked.words = scenario.to_string();
    match catch_unwind(AssertUnwindSafe(|| Bout::new(&scenario, sabotage)?.tracing().run())) {
        Ok(Ok(Outcome { verdicts, faults, idle, trace })) => {
            attacked.trace = trace;
            attacked.verdicts = verdicts;
            attacked.told = faults.iter().map(|fault| format!("{fault:?}")).collect();
            attacked.idle = idle;
        }
        Ok(Err(error)) => attacked.idle = Some(format!("{error:#}")),
        Err(panic) => {
            let said = panic.downcast_ref::<String>().cloned();
            let said = said.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_string()));
            let said = said.unwrap_or_default();
            attacked.verdicts.push(Verdict { breach: Breach::Panic, at_s: 0.0, said });
        }
    }
    attacked
}

impl Attacked {
    /// What is printed of a breach: what, in which scenario, and how to see it again.
    fn print(&self, only: &Only) {
        for Verdict { breach, at_s, said } in &self.verdicts {
            println!("{breach:?} in scenario {} at {at_s:.3} s: {said}", self.seed);
        }
        println!("{}", self.words);
        if !self.told.is_empty() {
            println!("  told: {}", self.told.join(", "));
        }
        if let Some(why) = &self.idle {
            println!("  not attacked: {why}");
        }
        println!("  again: cargo run --release -- attack --scenarios 1 --each --seed {}{only}\n", self.seed);
    }
}

/// Scenarios and breaches of each kind.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// All.
    pub scenarios: usize,
    /// Those that were not attacked, and why.
    pub idle: BTreeMap<String, usize>,
    /// Of each temper.
    pub tempers: BTreeMap<String, usize>,
    /// Of each kind.
    pub breaches: BTreeMap<Breach, usize>,
    /// Scenarios with a breach.
    pub breached: Vec<Attacked>,
}

impl Summary {
    fn add(&mut self, attacked: Attacked) {
        self.scenarios += 1;
        if let Some(why) = &attacked.idle {
            *self.idle.entry(why.clone()).or_default() += 1;
        } else if let Some(temper) = attacked.temper {
            *self.tempers.entry(format!("{temper:?}")).or_default() += 1;
        }
        for verdict in &attacked.verdicts {
            *self.breaches.entry(verdict.breach).or_default() += 1;
        }
        if !attacked.verdicts.is_empty() {
            self.breached.push(attacked);
        }
    }

    fn table(&self) -> Vec<Vec<String>> {
        let head = vec![vec!["breach".into(), "scenarios".into()]];
        let rows = self.breaches.iter().map(|(breach, count)| vec![format!("{breach:?}"), count.to_string()]);
        head.into_iter().chain(rows).collect()
    }

    fn words(&self) -> String {
        let tempers: Vec<_> = self.tempers.iter().map(|(temper, count)| format!("{count} {temper}")).collect();
        let idle: usize = self.idle.values().sum();
        let breached = self.breached.len();
        format!("{} scenarios ({}), {idle} not attacked, {breached} with a breach.", self.scenarios, tempers.join(", "))
    }
}

/// `attack`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let style = ProgressStyle::with_template("{wide_bar} {pos} of {len}")?;
    let bar = ProgressBar::new(options.scenarios).with_style(style);
    let seeds = options.common.seed..options.common.seed + options.scenarios;
    let mut attacked: Vec<_> = seeds
        .into_par_iter()
        .map(|seed| {
            let attacked = attack(seed, &options.only, Sabotage::None);
            bar.inc(1);
            attacked
        })
        .collect();
    bar.finish_and_clear();
    let mut summary = Summary::default();
    for one in attacked.drain(..) {
        if options.each || !one.verdicts.is_empty() {
            one.print(&options.only);
        }
        if let Some(file) = options.trace.as_ref().filter(|_| !one.verdicts.is_empty()) {
            fs::write(file, one.trace.csv()).with_context(|| format!("cannot write {}", file.display()))?;
        }
        summary.add(one);
    }
    print_table(&summary.table());
    println!("\n{}", summary.words());
    for (why, count) in &summary.idle {
        println!("  {count} not attacked: {why}");
    }
    let mut report = Report::new("Attack");
    report.lead(
        "Random settings, commands and worlds at motors of every kind: what the drive must not do, judged by physics.",
    );
    report.text(&summary.words());
    report.table(&summary.table());
    for one in &summary.breached {
        report.heading(&format!("Scenario {}", one.seed));
        let said = one
            .verdicts
            .iter()
            .map(|verdict| format!("{:?} at {:.3} s: {}", verdict.breach, verdict.at_s, verdict.said));
        report.text(&said.collect::<Vec<_>>().join("; "));
        report.preformatted(&one.words);
    }
    options.common.finish("attack", &summary, &report)
}
