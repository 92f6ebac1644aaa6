//! What the vernier must reach: `cargo run --release -- vernier --pairs` over a hundred seeds, and its faults.

use rayon::prelude::*;
use sim::experiment::Common;
use sim::experiment::vernier::faults::{FAULTS, Fault, Outcome, Recorded};
use sim::experiment::vernier::{Build, Options, Summary, run};

const ONE_HEAD: Build = Build { eccentricity: 0.02, head_angle: 40.0, pairs: false };
const PAIRS: Build = Build { eccentricity: 0.05, head_angle: 40.0, pairs: true };

fn summary(build: Build, seed: u64) -> Summary {
    let common = Common { seed, json: None, out: "report".into() };
    run(&Options { common, build, positions: 10_000, trials: 0 }).unwrap()
}

/// The short form has six encoders, not a hundred, each at ten thousand positions.
#[test]
fn a_million_positions_of_a_hundred_encoders() {
    let encoders = sim::of(6, 100);
    let summaries = (1..=encoders).into_par_iter().map(|seed| summary(PAIRS, seed)).collect::<Vec<_>>();
    let worst = |of: fn(&Summary) -> f64| summaries.iter().map(of).fold(0.0, f64::max);
    let positions: usize = summaries.iter().map(|s| s.positions).sum();
    let wrong: usize = summaries.iter().map(|s| s.wrong_pole_pairs).sum();
    let before: usize = summaries.iter().map(|s| s.uncalibrated_wrong_pole_pairs).sum();
    let (rms, max) = (worst(|s| s.error_deg_rms), worst(|s| s.error_deg_max));
    let residual = worst(|s| s.worst_residual_counts);
    let margin = summaries.iter().map(|s| s.margin_counts).fold(f64::MAX, f64::min);
    println!("{wrong} of {positions} wrong ({before} uncalibrated), error {rms:.4}° RMS, {max:.4}° at most");
    println!("residual {residual:.2} counts of a margin of {margin:.2}");
    assert!(summaries.iter().all(|s| s.refusal.is_none()));
    assert_eq!((wrong, positions), (0, 10_000 * encoders as usize));
    assert!(rms <= 0.005 / 2.0 && max <= 0.01);
    assert!(residual < 5.0 && margin > 50.0);
    // What calibration is worth.
    assert!(before > 100 * encoders as usize, "{before}");
}

/// Encoders with faults.
fn faulty() -> usize {
    sim::of(5, 10)
}

/// Trials of each fault, over all of these encoders.
fn trials<const HEADS: usize>(build: &Build, each: usize) -> [Outcome; FAULTS.len()] {
    let of_one = |seed| {
        let recorded = Recorded::<HEADS>::new(build, seed).unwrap();
        FAULTS.map(|fault| recorded.trials(fault, each, seed))
    };
    let all: Vec<_> = (1..=faulty() as u64).into_par_iter().map(of_one).collect();
    std::array::from_fn(|fault| all.iter().map(|outcomes| outcomes[fault]).reduce(Outcome::plus).unwrap())
}

fn check(outcome: &Outcome, trials: usize) {
    println!("{outcome:?}");
    assert_eq!((outcome.trials, outcome.wrong, outcome.false_alarms), (trials, 0, 0));
    // Only a stuck head over a ring that stands still stays unnoticed, and a burst that repeats what is.
    assert!(outcome.flagged * 1000 > trials * 999);
    // A weak magnet is seen before its angle is read.
    assert!(outcome.unchecked_wrong * 10 > trials * 9 || outcome.fault == Fault::HalfDemagnetised);
}

#[test]
fn no_fault_lets_a_wrong_angle_pass_with_one_head_a_ring() {
    let each = sim::of(200, 10_000);
    trials::<1>(&ONE_HEAD, each).iter().for_each(|outcome| check(outcome, faulty() * each));
}

#[test]
fn no_fault_lets_a_wrong_angle_pass_with_opposite_heads() {
    let each = sim::of(50, 1_000);
    trials::<2>(&PAIRS, each).iter().for_each(|outcome| check(outcome, faulty() * each));
}

#[test]
fn too_eccentric_for_one_head_is_refused_with_the_reason() {
    let summary = summary(Build { eccentricity: 0.05, ..ONE_HEAD }, 1);
    let refusal = summary.refusal.unwrap();
    assert!(refusal.contains("eccentric"), "{refusal}");
    assert!(summary.tolerable_eccentricity_mm < 0.05);
}
