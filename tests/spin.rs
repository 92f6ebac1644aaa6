//! The whole drive against a hundred imperfect motors: what `cargo run --release -- spin` measures on one.

use plant::{HallLayout, PlantParameters};
use rayon::prelude::*;
use sim::experiment::spin::{Summary, run};

fn summaries(seeds: std::ops::Range<u64>, plant: impl Fn(u64) -> PlantParameters + Sync) -> Vec<Summary> {
    let summary =
        |seed| run(seed, &plant(seed), |_, _| {}).unwrap_or_else(|error| panic!("seed {seed}: {error}")).summary;
    seeds.into_par_iter().map(summary).collect()
}

fn worst(summaries: &[Summary], of: impl Fn(&Summary) -> f64) -> f64 {
    summaries.iter().map(of).fold(0.0, f64::max)
}

#[test]
fn a_hundred_imperfect_motors_reach_the_bounds() {
    let motors = sim::of(8, 100);
    let summaries = summaries(1..1 + motors, PlantParameters::imperfect);
    let untracked = worst(&summaries, |s| s.angle_error_deg_rms / s.crlb_deg);
    let placed = worst(&summaries, |s| s.angle_error_deg_rms / s.crlb_placed_deg);
    let mean = worst(&summaries, |s| s.angle_bias_deg.abs());
    let bias = worst(&summaries, |s| s.angle_bias_worst_deg);
    let tracked = worst(&summaries, |s| s.tracked_error_deg_rms);
    let tracked_all = worst(&summaries, |s| s.tracked_error_all_deg_rms);
    println!(
        "worst of {motors}: untracked {untracked:.3} of the bound ({placed:.3} of the placed one), mean {mean:.3}°, bias \
         {bias:.3}°, tracked {tracked:.3}° ({tracked_all:.3}°)"
    );
    assert!(summaries.iter().all(|s| s.turns_lost == 0 && s.turns_made > 200.0));
    assert!(untracked <= 1.1 && placed <= 1.1);
    assert!(mean <= 0.1);
    assert!(tracked <= 0.2);
    // What they are compared with must be as bad as the paper's.
    assert!(summaries.iter().all(|s| (s.crlb_deg - 0.468).abs() < 1e-3));
    assert!(worst(&summaries, |s| s.raw_error_deg_rms) > 16.0);
}

#[test]
fn every_layout_of_the_sensors_is_calibrated() {
    // A third of the motors for each: the arithmetic is the same.
    let motors = sim::of(3, 33);
    for layout in [HallLayout::Deg120Reversed, HallLayout::Deg60, HallLayout::Deg60Reversed] {
        let summaries = summaries(1..1 + motors, |seed| PlantParameters::imperfect_with(seed, layout));
        let untracked = worst(&summaries, |s| s.angle_error_deg_rms / s.crlb_deg);
        let mean = worst(&summaries, |s| s.angle_bias_deg.abs());
        println!("{layout:?}: worst of {motors}: untracked {untracked:.3} of the bound, mean {mean:.3}°");
        assert!(untracked <= 1.1 && mean <= 0.1);
        assert!(summaries.iter().all(|s| s.turns_lost == 0));
    }
}
