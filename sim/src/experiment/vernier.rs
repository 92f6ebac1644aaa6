//! The two-ring encoder of Bakos, Gőzse and Soumelidis: before and after it has calibrated itself, and when it breaks.

mod build;
pub mod faults;
pub mod plots;

use super::Common;
use crate::report::print_table;
use crate::statistics::Statistics;
use anyhow::Result;
pub use build::{Build, calibrate, read};
use faults::{FAULTS, Outcome, Recorded};
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::calibrate::Report;
use hallservo::vernier::encoder::{Calibration, Encoder};
use hallservo::vernier::rings::Rings;
use plant::construction::Construction;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::Serialize;
use std::f64::consts::TAU;

/// What is built, and how it is tried.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// What every experiment has
    #[command(flatten)]
    pub common: Common,
    /// How the encoder is built
    #[command(flatten)]
    pub build: Build,
    /// Random positions to decode
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub positions: usize,
    /// Times to inject each fault
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub trials: usize,
}

/// The figures of `vernier --json`. Angles are mechanical degrees, counts those of a 12-bit head over the outer ring.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Seed of the construction, the speed and the noise.
    pub seed: u64,
    /// Positions decoded.
    pub positions: usize,
    /// Of these, decoded to the wrong pole pair.
    pub wrong_pole_pairs: usize,
    /// The same without calibration, the zeros of the rings aligned by hand.
    pub uncalibrated_wrong_pole_pairs: usize,
    /// Largest residual of all positions.
    pub worst_residual_counts: f64,
    /// What the residual must reach for a wrong pole pair.
    pub margin_counts: f64,
    /// Error without its constant part.
    pub error_deg_rms: f64,
    /// Largest error without the constant part.
    pub error_deg_max: f64,
    /// The error without calibration, where the pole pair is right.
    pub uncalibrated_error_deg_rms: f64,
    /// The largest of these.
    pub uncalibrated_error_deg_max: f64,
    /// Eccentricity up to which ideal rings need no calibration.
    pub tolerable_eccentricity_mm: f64,
    /// Why the encoder refused to calibrate, in which case it goes on uncalibrated.
    pub refusal: Option<String>,
    /// What became of the faults injected.
    pub faults: Vec<Outcome>,
}

/// `vernier`: the experiment on the command line.
///
/// # Errors
/// Files that cannot be written.
pub fn main(options: &Options) -> Result<()> {
    options.common.prepare()?;
    let summary = run(options)?;
    println!(
        "37 and 45 pole pairs, eccentric by {} mm, heads {}° apart{} (seed {}):\n",
        options.build.eccentricity,
        options.build.head_angle,
        if options.build.pairs { ", in opposite pairs" } else { "" },
        options.common.seed
    );
    print_table(&summary.table());
    if let Some(refusal) = &summary.refusal {
        println!("\nCalibration refused: {refusal}. The encoder goes on uncalibrated.");
    }
    if !summary.faults.is_empty() {
        println!("\nFaults injected into the running encoder:\n");
        print_table(&summary.fault_table());
    }
    println!();
    let report = plots::report(options, &summary)?;
    options.common.finish("vernier", &summary, &report)
}

/// Builds an encoder, calibrates it, decodes random positions, breaks it.
///
/// # Errors
/// None of the calibration: a refusal is a result.
pub fn run(options: &Options) -> Result<Summary> {
    if options.build.pairs { run_with::<2>(options) } else { run_with::<1>(options) }
}

fn run_with<const HEADS: usize>(options: &Options) -> Result<Summary> {
    let (build, seed) = (&options.build, options.common.seed);
    let rings = build.rings()?;
    let mut construction = build.construction(seed);
    let ideal = Calibration::<HEADS>::ideal(&rings);
    let before = decode(&rings, &ideal, &mut construction, options.positions, seed)?;
    let (calibration, report, refusal) = match calibrate(build, &mut construction, seed) {
        Ok((calibration, report)) => (calibration, report, None),
        Err(refusal) => (ideal, Report { margin: 1 << 15, ..Report::default() }, Some(refusal.to_string())),
    };
    let after = decode(&rings, &calibration, &mut construction, options.positions, seed)?;
    let counts = |residual: u32| f64::from(rings.residual_counts(residual as i32));
    let faults = if refusal.is_none() && options.trials > 0 {
        let recorded = Recorded::<HEADS>::new(build, seed)?;
        FAULTS.map(|fault| recorded.trials(fault, options.trials, seed)).to_vec()
    } else {
        Vec::new()
    };
    Ok(Summary {
        seed,
        positions: options.positions,
        wrong_pole_pairs: after.wrong,
        uncalibrated_wrong_pole_pairs: before.wrong,
        worst_residual_counts: counts(after.worst_residual),
        margin_counts: counts(report.margin),
        error_deg_rms: after.error.rms(),
        error_deg_max: after.error.max_abs(),
        uncalibrated_error_deg_rms: before.error.rms(),
        uncalibrated_error_deg_max: before.error.max_abs(),
        tolerable_eccentricity_mm: build.tolerable_mm()?,
        refusal,
        faults,
    })
}

struct Decoding {
    wrong: usize,
    worst_residual: u32,
    error: Statistics,
}

/// Decodes random positions, each on its own.
fn decode<const HEADS: usize>(
    rings: &Rings,
    calibration: &Calibration<HEADS>,
    construction: &mut Construction,
    positions: usize,
    seed: u64,
) -> Result<Decoding> {
    let encoder = Encoder::new(rings, calibration, MechanicalAngle::from_degrees(1.0))?;
    let mut random = Pcg32::seed_from_u64(seed);
    let mut worst_residual = 0;
    let errors: Vec<f64> = (0..positions)
        .map(|_| {
            let turns = random.random::<f64>();
            let decoded = encoder.decode(read(rings, construction, turns * TAU));
            worst_residual = worst_residual.max(decoded.residual.unsigned_abs());
            (f64::from(decoded.angle.to_bits()) / 2f64.powi(32) - turns) * 360.0
        })
        .collect();
    let constant = constant_deg(&errors);
    let without = |error: &f64| (error - constant + 180.0).rem_euclid(360.0) - 180.0;
    let right = |error: &f64| error.abs() < 180.0 / 37.0;
    let right: Vec<f64> = errors.iter().map(without).filter(right).collect();
    let mean = right.iter().sum::<f64>() / right.len() as f64;
    Ok(Decoding {
        wrong: positions - right.len(),
        worst_residual,
        error: right.iter().map(|error| error - mean).collect(),
    })
}

/// The constant that most errors have in common, to a pole pair.
fn constant_deg(errors: &[f64]) -> f64 {
    const PARTS: usize = 370;
    let part = |error: &f64| (error.rem_euclid(360.0) / 360.0 * PARTS as f64) as usize % PARTS;
    let mut counts = [0_usize; PARTS];
    errors.iter().for_each(|error| counts[part(error)] += 1);
    let most = (0..PARTS).max_by_key(|&part| counts[part]).unwrap_or(0);
    (most as f64 + 0.5) * 360.0 / PARTS as f64
}

impl Summary {
    fn table(&self) -> Vec<Vec<String>> {
        let row = |name: &str, before: String, after: String| vec![name.to_string(), before, after];
        vec![
            row("", "uncalibrated".into(), "calibrated".into()),
            row(
                "wrong pole pairs",
                format!("{} of {}", self.uncalibrated_wrong_pole_pairs, self.positions),
                format!("{} of {}", self.wrong_pole_pairs, self.positions),
            ),
            row(
                "error, RMS",
                format!("{:.4}°", self.uncalibrated_error_deg_rms),
                format!("{:.4}°", self.error_deg_rms),
            ),
            row(
                "error, largest",
                format!("{:.4}°", self.uncalibrated_error_deg_max),
                format!("{:.4}°", self.error_deg_max),
            ),
            row("largest residual, counts", String::new(), format!("{:.1}", self.worst_residual_counts)),
            row("margin, counts", "55.4".into(), format!("{:.1}", self.margin_counts)),
            row("tolerable eccentricity", format!("{:.3} mm", self.tolerable_eccentricity_mm), String::new()),
        ]
    }

    fn fault_table(&self) -> Vec<Vec<String>> {
        let head = ["fault", "trials", "reported", "wrong", "wrong unchecked", "worst good angle", "false alarms"];
        let rows = self.faults.iter().map(|outcome| {
            vec![
                outcome.fault.words().to_string(),
                outcome.trials.to_string(),
                outcome.flagged.to_string(),
                outcome.wrong.to_string(),
                outcome.unchecked_wrong.to_string(),
                format!("{:.4}°", outcome.worst_deg),
                outcome.false_alarms.to_string(),
            ]
        });
        [head.map(String::from).to_vec()].into_iter().chain(rows).collect()
    }
}
