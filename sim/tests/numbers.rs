//! The figures that README and `docs/numbers.md` quote are those that the experiments print: the cheap ones are made
//! again, those of the thousand motors come from their last run, which `docs/recorded/adapt.json` keeps:
//! `cargo run --release -- adapt --json docs/recorded/adapt.json`.

use plant::PlantParameters;
use serde_json::Value;
use sim::experiment::{commutation, papers, servo, spin};
use std::path::Path;
use std::sync::LazyLock;
use std::{env, fs};

fn read(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file);
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{file}: {error}"))
}

static NUMBERS: LazyLock<String> = LazyLock::new(|| read("docs/numbers.md"));
static README: LazyLock<String> = LazyLock::new(|| read("README.md"));

/// One space wherever there is room, for paragraphs are broken anywhere.
fn narrow(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The page says this, with these figures in it.
#[track_caller]
fn says(page: &str, text: &str) {
    let text = narrow(text);
    assert!(narrow(page).contains(&text), "the page does not say {text:?}: is a figure no longer true?");
}

#[test]
fn spin() {
    let s = spin::run(1, &PlantParameters::imperfect(1), |_, _| ()).unwrap().summary;
    says(&NUMBERS, &format!("one sensor, arcsine, uncalibrated             {:.2}° RMS", s.raw_error_deg_rms));
    says(&NUMBERS, &format!("three sensors, calibrated, single samples     {:.3}° RMS", s.angle_error_deg_rms));
    says(&NUMBERS, &format!("(Cramér–Rao)   {:.3}° RMS", s.crlb_placed_deg));
    says(&NUMBERS, &format!("largest {:.2}° mean", s.angle_error_deg_max));
    says(&NUMBERS, &format!("° mean {:+.3}° largest", s.angle_bias_deg));
    says(&NUMBERS, &format!("largest mean in 10° of the turn               {:.3}°", s.angle_bias_worst_deg));
    says(&NUMBERS, &format!("tracked, constant speed                       {:.3}° RMS", s.tracked_error_deg_rms));
    says(&NUMBERS, &format!("stop and reversal        {:.3}° RMS", s.tracked_error_all_deg_rms));
    let turns = format!("electrical turns lost of {:.0}, up to {:.0} Hz ", s.turns_made, s.fastest_hz);
    says(&NUMBERS, &turns);
    assert_eq!(s.turns_lost, 0);
    let [single, tracked] = [s.angle_error_deg_rms, s.tracked_error_deg_rms];
    says(&README, &format!("| {single:.2}° RMS from one sample, {tracked:.2}° tracked |"));
    says(&README, &format!("| {:.3}° is the least from one sample; {:.1}° ", s.crlb_placed_deg, s.raw_error_deg_rms));
}

#[test]
fn commutation() {
    let s = commutation::run(1).unwrap().summary;
    let torque = [s.block_torque_ripple_pct, s.sine_torque_ripple_pct];
    let speed = [s.block_speed_ripple_pct, s.sine_speed_ripple_pct];
    says(&NUMBERS, &format!("(theory: 14.03 %, 0) | {:.2} % | {:.2} % |", torque[0], torque[1]));
    says(&NUMBERS, &format!("uncalibrated Halls | {:.2} % |", s.uncalibrated_block_torque_ripple_pct));
    says(&NUMBERS, &format!("dead time | {:.2} % | {:.2} % |", speed[0], speed[1]));
}

#[test]
fn servo() {
    let s = servo::run(1).unwrap().summary;
    let current = format!("40 kHz | {:.0} Hz / {:.1} % |", s.current_bandwidth_hz, s.current_overshoot_pct);
    says(&NUMBERS, &current);
    let ripple = [s.speed_ripple_pct, s.block_speed_ripple_pct, s.block_open_speed_ripple_pct];
    says(&NUMBERS, &format!("anti-cogging / block | {:.2} % / {:.1} % |", ripple[0], ripple[1]));
    says(&NUMBERS, &format!("constant voltage | {:.2} % / {:.1} % |", ripple[0], ripple[2]));
    says(&NUMBERS, &format!("holding at rest | {:.3}° RMS |", s.position_noise_deg));
    says(&NUMBERS, &format!("over with the table | {:.1} |", s.cogging_reduction));
    says(&NUMBERS, &format!("field-oriented over block | {:.3} |", s.foc_copper_loss_vs_block));
    says(&README, &format!("| {:.2} % | {:.1} % with block commutation |", ripple[0], ripple[1]));
}

#[test]
fn two_rings() {
    let claims = papers::run(1).unwrap().claims;
    let claim = claims.iter().find(|claim| claim.place == "Fig. 10").unwrap();
    let figure = |name: &str| claim.figures.iter().find(|figure| figure.name.contains(name)).unwrap().ours;
    assert_eq!(figure("pole pairs, compensated"), 0.0);
    says(&README, &format!("| 0 of 20 000 | {:.1} % with one head", figure("uncompensated")));
}

/// A column of a row (3: least, 4: mean, 5: largest), as last printed on the emulated chip: in `boards/mps2-an386`,
/// `cargo run --release --bin count | grep '^|' > ../../docs/recorded/count.md`.
fn count(item: &str, by: &str, column: usize) -> String {
    let counts = read("docs/recorded/count.md");
    let row = counts.lines().find(|row| row.starts_with(&format!("| {item} | {by} |")));
    row.unwrap_or_else(|| panic!("no {item} by {by}")).split('|').nth(column).unwrap().trim().to_string()
}

#[test]
fn instructions() {
    let ours = |item: &str| count(item, "hallservo", 5);
    let peer = |item: &str, by: &str| count(item, by, 5);
    let least = count("Drive::step, running", "hallservo", 3);
    says(&NUMBERS, &format!("**{least}, with a record {}**", ours("Drive::step, running")));
    let three = |kind: &str| ["current", "speed", "position"].map(|what| ours(&format!("{kind}, {what}"))).join(" / ");
    says(&NUMBERS, &format!("a position | **{}** |", three("Drive::step, field-oriented")));
    says(&NUMBERS, &format!("alignment trimmed | {} |", three("field-oriented, fast")));
    says(&NUMBERS, &format!("a table against cogging | {} |", three("field-oriented, with a table")));
    let stalled = three("field-oriented, stalled");
    says(&NUMBERS, &format!("(speed and position) | {stalled} |"));
    says(&NUMBERS, &format!("at most every 8th | {} |", ours("field-oriented, with a command")));
    let mean: f64 = count("adaptation, one update", "hallservo", 4).parse().unwrap();
    says(&NUMBERS, &format!("one update (mean {mean:.0}) | {} |", ours("adaptation, one update")));
    says(&NUMBERS, &format!("a lost Hall at once | {} |", ours("the same, all of it at once")));
    says(&NUMBERS, &format!("absolute angle | {} |", ours("two rings → angle")));
    says(&NUMBERS, &format!("against the past | {} |", ours("the same, corrected and checked")));
    let halls = "three Halls → turns → three duties, LSB";
    let [idsp, micromath, libm] = ["idsp", "micromath", "libm"].map(|by| peer(halls, by));
    says(&NUMBERS, &format!("→ three duties | {} | {idsp} | {micromath} | {libm} |", ours(halls)));
    let most = three("Drive::step, field-oriented");
    let most = most.split(" / ").filter_map(|count| count.parse::<u32>().ok()).max().unwrap();
    says(&README, &format!("| {most} at most |"));
}

#[test]
fn a_thousand_motors() {
    let recorded: Value = serde_json::from_str(&read("docs/recorded/adapt.json")).unwrap();
    let of = |name: &str| recorded[name].as_f64().unwrap();
    assert_eq!(recorded["motors"], 1000);
    assert!(recorded["paper_filter_convergence_turns"].is_null());
    let turns = of("convergence_electrical_turns");
    says(&NUMBERS, &format!("below 0.5° RMS after | {turns:.2} turns |"));
    says(&README, &format!("| {turns:.2} turns | the paper's filter: never |"));
    let [steady, bound, paper] = ["error_deg_rms", "posterior_bound_deg", "paper_filter_error_deg_rms"].map(of);
    says(
        &NUMBERS,
        &format!("(bound of any filter: {bound:.3}°) | {steady:.3}° RMS | ≤ 1.2 × the bound | {paper:.2}° |"),
    );
    let [drift, without] = ["drift_error_deg_rms", "drift_error_without_adaptation_deg_rms"].map(of);
    says(&NUMBERS, &format!("worst motor | {drift:.3}° RMS | ≤ 0.3° | without adaptation: {without:.2}° |"));
    let (named, latest) = (of("losses_named"), of("loss_detection_turns"));
    says(&NUMBERS, &format!("found and named | {named} of 1000, after {latest:.2} turns at most |"));
    let coupled = |name: &str| recorded[name][1].as_f64().unwrap();
    let [shift, corrected] = ["coupling_error_without_deg_rms", "coupling_error_with_deg_rms"].map(coupled);
    says(&NUMBERS, &format!("{shift:.2}° RMS. All three"));
    says(&NUMBERS, &format!("({shift:.1}° without, {corrected:.2}° with)"));
}
