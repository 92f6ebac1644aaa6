//! The cheap ones: experiments that are run again, and tables that are kept as they were printed.

use super::page::{Figure, Pages, read};
use hallservo::service::by_pole::ByPole;
use hallservo::settings::{Control, Settings};
use hallservo::turn::Live;
use hallservo::vernier::calibrate::Calibrator;
use hallservo::vernier::continuity::State;
use hallservo::vernier::eccentricity::Geometry;
use hallservo::vernier::encoder::Encoder;
use hallservo::vernier::rings::Rings;
use plant::PlantParameters;
use serde_json::Value;
use sim::experiment::{commutation, papers, servo, spin};

const NUMBERS: &str = "docs/numbers.md";
const README: &str = "README.md";

pub const CHECKS: &[fn(&Pages)] =
    &[spin, commutation, servo, two_rings, instructions, a_thousand_motors, limits, memory, rings];

fn spin(pages: &Pages) {
    let s = spin::run(1, &PlantParameters::imperfect(1), |_, _| ()).unwrap().summary;
    pages.say(NUMBERS, &format!("one sensor, arcsine, uncalibrated             {:.2}° RMS", s.raw_error_deg_rms));
    pages.say(NUMBERS, &format!("three sensors, calibrated, single samples     {:.3}° RMS", s.angle_error_deg_rms));
    pages.say(NUMBERS, &format!("(Cramér–Rao)   {:.3}° RMS", s.crlb_placed_deg));
    pages.say(NUMBERS, &format!("largest {:.2}° mean", s.angle_error_deg_max));
    pages.say(NUMBERS, &format!("° mean {:+.3}° largest", s.angle_bias_deg));
    pages.say(NUMBERS, &format!("largest mean in 10° of the turn               {:.3}°", s.angle_bias_worst_deg));
    pages.say(NUMBERS, &format!("tracked, constant speed                       {:.3}° RMS", s.tracked_error_deg_rms));
    pages.say(NUMBERS, &format!("stop and reversal        {:.3}° RMS", s.tracked_error_all_deg_rms));
    let turns = format!("electrical turns lost of {:.0}, up to {:.0} Hz ", s.turns_made, s.fastest_hz);
    pages.say(NUMBERS, &turns);
    assert_eq!(s.turns_lost, 0);
    let [single, tracked] = [s.angle_error_deg_rms, s.tracked_error_deg_rms];
    pages.say(README, &format!("| {single:.2}° RMS from one sample, {tracked:.2}° tracked |"));
    pages.say(
        README,
        &format!("| {:.3}° is the least from one sample; {:.1}° ", s.crlb_placed_deg, s.raw_error_deg_rms),
    );
}

fn commutation(pages: &Pages) {
    let s = commutation::run(1).unwrap().summary;
    let torque = [s.block_torque_ripple_pct, s.sine_torque_ripple_pct];
    let speed = [s.block_speed_ripple_pct, s.sine_speed_ripple_pct];
    pages.say(NUMBERS, &format!("(theory: 14.03 %, 0) | {:.2} % | {:.2} % |", torque[0], torque[1]));
    pages.say(NUMBERS, &format!("uncalibrated Halls | {:.2} % |", s.uncalibrated_block_torque_ripple_pct));
    pages.say(NUMBERS, &format!("dead time | {:.2} % | {:.2} % |", speed[0], speed[1]));
}

fn servo(pages: &Pages) {
    let s = servo::run(1).unwrap().summary;
    let current = format!("40 kHz | {:.0} Hz / {:.1} % |", s.current_bandwidth_hz, s.current_overshoot_pct);
    pages.say(NUMBERS, &current);
    let ripple = [s.speed_ripple_pct, s.block_speed_ripple_pct, s.block_open_speed_ripple_pct];
    pages.say(NUMBERS, &format!("anti-cogging / block | {:.2} % / {:.1} % |", ripple[0], ripple[1]));
    pages.say(NUMBERS, &format!("constant voltage | {:.2} % / {:.1} % |", ripple[0], ripple[2]));
    pages.say(NUMBERS, &format!("holding at rest | {:.3}° RMS |", s.position_noise_deg));
    pages.say(NUMBERS, &format!("over with the table | {:.1} |", s.cogging_reduction));
    pages.say(NUMBERS, &format!("field-oriented over block | {:.3} |", s.foc_copper_loss_vs_block));
    pages.say(README, &format!("| {:.2} % | {:.1} % with block commutation |", ripple[0], ripple[1]));
}

fn two_rings(pages: &Pages) {
    let claims = papers::run(1).unwrap().claims;
    let claim = claims.iter().find(|claim| claim.place == "Fig. 10").unwrap();
    let figure = |name: &str| claim.figures.iter().find(|figure| figure.name.contains(name)).unwrap().ours;
    assert_eq!(figure("pole pairs, compensated"), 0.0);
    pages.say(README, &format!("| 0 of 20 000 | {:.1} % with one head", figure("uncompensated")));
}

/// A column of a row (3: least, 4: mean, 5: largest, 7: error), as last printed on the emulated chip: in
/// `boards/mps2-an386`, `cargo run --release --bin count | grep '^|' > ../../docs/recorded/count.md`, and the same of
/// `count-encoder`.
fn count(item: &str, by: &str, column: usize) -> String {
    let counts = read("docs/recorded/count.md") + &read("docs/recorded/count-encoder.md");
    let row = counts.lines().find(|row| row.starts_with(&format!("| {item} | {by} |")));
    row.unwrap_or_else(|| panic!("no {item} by {by}")).split('|').nth(column).unwrap().trim().to_string()
}

fn instructions(pages: &Pages) {
    let ours = |item: &str| count(item, "hallservo", 5);
    let numbers = |text: &str| pages.say(NUMBERS, text);
    peers(pages);
    let least = count("Drive::step, running", "hallservo", 3);
    numbers(&format!("**{least}, with a record {}**", ours("Drive::step, running")));
    let three = |kind: &str| ["current", "speed", "position"].map(|what| ours(&format!("{kind}, {what}"))).join(" / ");
    numbers(&format!("with every check of the sensors | {} |", ours("the same, with every check")));
    numbers(&format!("a position | **{}** |", three("Drive::step, field-oriented")));
    numbers(&format!("alignment trimmed | {} |", three("field-oriented, fast")));
    numbers(&format!("rotor that is not braked | {} |", ours("field-oriented, fast, impedance")));
    numbers(&format!("a table against cogging | {} |", three("field-oriented, with a table")));
    numbers(&format!("(speed and position) | {} |", three("field-oriented, stalled")));
    let map = "field-oriented, fast, with a map and all tables, speed";
    let mean: f64 = count(map, "hallservo", 4).parse().unwrap();
    numbers(&format!("both tables against cogging (mean {mean:.0}) | {} |", ours(map)));
    let two = "field-oriented, fast, with two currents, speed";
    let mean: f64 = count(two, "hallservo", 4).parse().unwrap();
    let steps = [two, "Drive::step, field-oriented, speed"].map(|row| Figure::Is(ours(row).parse().unwrap()));
    pages.quote("docs/hardware.md", "takes up to {} instructions then, instead of {}", &steps);
    numbers(&format!("(`least_low_side_s`; mean {mean:.0}) | {} |", ours(two)));
    let most = Figure::Is(ours(map).parse().unwrap());
    pages.quote(NUMBERS, "the longest, with a map and all tables, is {} instructions with it, too", &[most]);
    numbers(&format!("at most every 8th | {} |", ours("field-oriented, with a command")));
    numbers(&format!("nothing to record | {} |", ours("scope, nothing to record")));
    let mean: f64 = count("scope, four channels", "hallservo", 4).parse().unwrap();
    numbers(&format!("a trigger (mean {mean:.0}) | {} |", ours("scope, four channels")));
    let absolute = ["current", "speed", "position"]
        .map(|what| ours(&format!("AbsoluteDrive::step, field-oriented, {what}")).parse::<u32>().unwrap());
    numbers(&format!("(`--bin count-encoder`) | **{}** |", absolute.into_iter().max().unwrap()));
    let mean: f64 = count("adaptation, one update", "hallservo", 4).parse().unwrap();
    numbers(&format!("one update (mean {mean:.0}) | {} |", ours("adaptation, one update")));
    numbers(&format!("a lost Hall at once | {} |", ours("the same, all of it at once")));
    numbers(&format!("absolute angle | {} |", ours("two rings → angle")));
    numbers(&format!("against the past | {} |", ours("the same, corrected and checked")));
    // The worst of every way of turning, not only of the plain one.
    let kinds = [
        "Drive::step, field-oriented",
        "field-oriented, fast",
        "field-oriented, stalled",
        "field-oriented, with a table",
    ];
    let springs = &kinds[1..].iter().map(|kind| ours(&format!("{kind}, impedance"))).collect::<Vec<_>>().join(" / ");
    let counts = [&kinds.map(three).join(" / "), springs].map(|counts| counts.as_str()).join(" / ");
    let most = counts.split(" / ").map(|count| count.parse::<u32>().unwrap()).max().unwrap();
    pages.say(README, &format!("| {most} at most | 4250 cycles are there at 40 kHz and 170 MHz |"));
}

/// What can be done without calibration, beside other crates.
fn peers(pages: &Pages) {
    let of = |item: &str, by: &str, column| Figure::Is(count(item, by, column).parse().unwrap());
    let with_errors = |items: [&str; 4]| {
        let rows = items.into_iter().zip(["hallservo", "idsp", "micromath", "libm"]);
        rows.flat_map(|(item, by)| [of(item, by, 5), of(item, by, 7)]).collect::<Vec<_>>()
    };
    let sines = with_errors(["sine", "sine (with cosine)", "sine", "sine"]);
    pages.quote(NUMBERS, "| sine (error) | {} ({}) | {}, with cosine ({}) | {} ({}) | {} ({}) |", &sines);
    let angles = with_errors(["three Halls → angle, rad"; 4]);
    pages.quote(NUMBERS, "| three Halls → angle | {} ({} rad) | {} ({}) | {} ({}) | {} ({}) |", &angles);
    let duties = with_errors(["angle → three duties, LSB"; 4]);
    pages.quote(NUMBERS, "(LSB of 12 bit) | {} ({}) | {} ({}) | {} ({}) | {} ({}) |", &duties);
    let all = ["hallservo", "idsp", "micromath", "libm"].map(|by| of("three Halls → turns → three duties, LSB", by, 5));
    pages.quote(NUMBERS, "three Halls → turns → three duties | {} | {} | {} | {} |", &all);
}

fn a_thousand_motors(pages: &Pages) {
    let recorded: Value = serde_json::from_str(&read("docs/recorded/adapt.json")).unwrap();
    let of = |name: &str| recorded[name].as_f64().unwrap();
    assert_eq!(recorded["motors"], 1000);
    assert!(recorded["paper_filter_convergence_turns"].is_null());
    let turns = of("convergence_electrical_turns");
    pages.say(NUMBERS, &format!("below 0.5° RMS after | {turns:.2} turns |"));
    pages.say(README, &format!("| {turns:.2} turns | the paper's filter: never |"));
    let [steady, bound, paper] = ["error_deg_rms", "posterior_bound_deg", "paper_filter_error_deg_rms"].map(of);
    pages.say(
        NUMBERS,
        &format!("(bound of any filter: {bound:.3}°) | {steady:.3}° RMS | ≤ 1.2 × the bound | {paper:.2}° |"),
    );
    let [drift, without] = ["drift_error_deg_rms", "drift_error_without_adaptation_deg_rms"].map(of);
    pages.say(NUMBERS, &format!("worst motor | {drift:.3}° RMS | ≤ 0.3° | without adaptation: {without:.2}° |"));
    assert_eq!(recorded["diverged"], 0);
    pages.say(NUMBERS, "diverged, not a number, false fault | 0 | 0 |");
    let (named, latest) = (of("losses_named"), of("loss_detection_turns"));
    pages.say(NUMBERS, &format!("found and named | {named} of 1000, after {latest:.2} turns at most |"));
    assert_eq!(recorded["coupling_shares"][1], 0.02);
    let coupled = |name: &str| recorded[name][1].as_f64().unwrap();
    let [shift, corrected] = ["coupling_error_without_deg_rms", "coupling_error_with_deg_rms"].map(coupled);
    pages.say(NUMBERS, &format!("{shift:.2}° RMS. All three"));
    pages.say("docs/building.md", &format!("the angle is wrong by {shift:.1}° electrical"));
    pages.say(NUMBERS, &format!("({shift:.1}° without, {corrected:.2}° with)"));
}

/// What the library works out of settings.
fn limits(pages: &Pages) {
    let settings = Settings { control: Some(Control::default()), ..Settings::default() };
    let gains = settings.validate().unwrap().largest_impedance().unwrap();
    let page = "docs/impedance.md";
    pages.quote(page, "times the largest kp | {} mN·m·s/rad |", &[Figure::Is(1000.0 * f64::from(gains.kd_nms_rad))]);
    pages.quote(page, "| J / 16τd² | {} N·m/rad |", &[Figure::Is(gains.kp_nm_rad.into())]);
    // kp = J / 16τd², kd = J / 2τd − τp·kp.
    let [inertia, kp, kd] =
        [settings.control.as_ref().unwrap().inertia_kgm2, gains.kp_nm_rad, gains.kd_nms_rad].map(f64::from);
    let speed_s = (inertia / (16.0 * kp)).sqrt();
    let position_s = (inertia / (2.0 * speed_s) - kd) / kp;
    pages.quote(page, "it takes τd = {} ms", &[Figure::Is(1e3 * speed_s)]);
    pages.quote(page, "it takes τp = {} ms", &[Figure::Is(1e3 * position_s)]);
    pages.quote(page, "Up to {} Hz", &[Figure::Is(1.0 / (std::f64::consts::TAU * speed_s))]);
}

/// What is kept in memory.
fn memory(pages: &Pages) {
    let kib = |bytes: usize| Figure::Is(bytes as f64 / 1024.0);
    let heads = [size_of::<Encoder<1>>(), size_of::<Encoder<2>>()].map(|encoder| kib(encoder + size_of::<State>()));
    pages.quote(NUMBERS, "take {} KiB of RAM with one head a ring and {} KiB with two", &heads);
    pages.quote(NUMBERS, "a running calibration {} KiB", &[kib(size_of::<Calibrator<2>>())]);
    pages.quote(NUMBERS, "The map takes {} KiB of RAM", &[kib(size_of::<Live>())]);
    pages.quote(NUMBERS, "It takes {} KiB of RAM and comes", &[kib(size_of::<Live>() + size_of::<ByPole>())]);
}

/// What a pair of rings bears off the axis, 2 mm a pole pair.
fn rings(pages: &Pages) {
    let rings = Rings::new(37, 45, 12).unwrap();
    let geometry = |head_angle_deg: f32| Geometry::from_pole_length(&rings, 2.0, head_angle_deg.to_radians());
    let Geometry { reference_radius, vernier_radius, .. } = geometry(0.0);
    let [apart, in_line] = [40.0, 0.0].map(|degrees| geometry(degrees).tolerable(&rings));
    let opposite = geometry(0.0).tolerable_with_pairs(&rings, 1_f32.to_radians());
    let figures = [reference_radius, vernier_radius, opposite, apart, in_line];
    pages.quote(
        "boards/nucleo-g474re-ihm08m1/README.md",
        "| 37 / 45 | {}, {} mm | {} mm | {} mm | {} mm |",
        &figures.map(|figure| Figure::Is(figure.into())),
    );
}
