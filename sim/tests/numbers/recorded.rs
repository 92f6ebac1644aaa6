//! What long tests and experiments print, as `docs/record` keeps it, and where the pages quote it.

use super::page::Figure::{AtMost, Is};
use super::page::{Pages, read};
use super::text::Recorded;
use serde_json::Value;

const NUMBERS: &str = "docs/numbers.md";
const IMPEDANCE: &str = "docs/impedance.md";

pub const CHECKS: &[fn(&Pages)] = &[
    a_hundred_motors,
    functions,
    uneven_magnets,
    endurance,
    cogging,
    field_of_the_windings,
    late_halls,
    late_halls_and_uneven_magnets,
    damaged_lines,
    magnets_in_the_drive,
    slow_and_uneven,
    vernier,
    encoder_in_the_drive,
    aligned,
    encoder_loops,
    measured_motors,
    other_frequencies,
    impedance,
    field_weakening,
    long_vectors,
    campaign,
    campaign_of_two,
];

fn a_hundred_motors(pages: &Pages) {
    let run = Recorded::of("spin");
    let [untracked, _, mean, bias, tracked, _] = run
        .only("worst of 100: untracked {} of the bound ({} of the placed one), mean {}°, bias {}°, tracked {}° ({}°)");
    pages.quote(NUMBERS, "Cramér–Rao bound of 0.468° | {} |", &[Is(untracked)]);
    let layouts = run.most(": worst of 33: untracked {} of the bound");
    pages.quote(NUMBERS, "in reverse order | {} |", &[Is(layouts)]);
    pages.quote(NUMBERS, "mean error (alignment included) | {}° |", &[Is(mean)]);
    pages.quote(NUMBERS, "in any 10° of the turn | {}° |", &[Is(bias)]);
    pages.quote(NUMBERS, "tracked error at constant speed | {}° RMS |", &[Is(tracked)]);
    // The test fails at the first that is lost.
    pages.say(NUMBERS, "(`cargo test --test all turns::`) | 0 | 0 |");
}

fn functions(pages: &Pages) {
    let trig = Recorded::of("trig");
    let most = |name: &str| AtMost(trig.most(&format!("{name}: max {{}},")));
    pages.quote(NUMBERS, "`trig::sin`, `trig::cos` | {} |", &[most("... sin")]);
    pages.quote(NUMBERS, "`trig::asin` | {} rad |", &[most("asin")]);
    let arctangents = [most("atan2"), most("atan2_without_division")];
    pages.quote(NUMBERS, "with / without a division | {} / {} rad |", &arctangents);
    let estimate = Recorded::of("estimate").most("twelve_full_scale_bits_are_good_to_their_quantisation ... {} rad");
    pages.quote(NUMBERS, "a perfect 12-bit full-scale signal | {} rad, of which 3.1e-4", &[AtMost(estimate)]);
}

fn uneven_magnets(pages: &Pages) {
    let rows: Vec<Value> = serde_json::from_str(&read("docs/recorded/magnets.json")).unwrap();
    let rms = |name: &str, of: &str, error: &str| {
        let row = rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no {name}"));
        let rotors = row[of].as_array().unwrap();
        assert_eq!(rotors.len(), 4);
        let square: f64 = rotors.iter().map(|rotor| rotor[error].as_f64().unwrap().powi(2)).sum();
        Is((square / 4.0).sqrt())
    };
    let run = Recorded::of("rotors");
    let [.., steady, worst, changing, changing_worst, noise, noise_worst, mean, mean_worst]: [f64; 12] =
        run.only("all of a cheap rotor {} {} {} {} {} {} {} {} {} {} {} {}");
    let figures = [steady, changing, worst, changing_worst].map(Is);
    pages.quote(NUMBERS, "while the speed changes | {}° / {}° RMS | {}° / {}° RMS |", &figures);
    pages.quote(NUMBERS, "at the same angle, the noise | {} | {} |", &[noise, noise_worst].map(Is));
    pages.quote(NUMBERS, "which is the alignment's | {} | {} |", &[mean, mean_worst].map(Is));
    for (name, said) in [
        ("even poles", "| even |"),
        ("once-per-turn gain up to 20 %", "| gain once a turn up to 20 % |"),
        ("gain from pole to pole ±10 %", "| gain from pole to pole ±10 % |"),
        ("pole pitch ±5°", "| pole pitch ±5° |"),
        ("second harmonic up to 5 %", "| second harmonic up to 5 % |"),
        ("all of a cheap rotor", "2 % coil field, and more, at once |"),
        ("Halls of 2 kHz bandwidth", "a delay, which the map cannot see |"),
    ] {
        let figures = [
            rms(name, "rotors", "steady_deg_rms"),
            rms(name, "mapped", "steady_deg_rms"),
            rms(name, "mapped", "reversing_deg_rms"),
        ];
        pages.quote(NUMBERS, &format!("{said} {{}} | {{}} | {{}} |"), &figures);
    }
}

fn endurance(pages: &Pages) {
    let [hours, blamed, _, lost_s, _, named, broken, soon, last] =
        Recorded::of("endurance").only("all {} {} {}° {} s {} % {} of {} {} {}");
    pages.quote(NUMBERS, "In {} hours of that, {} of the rotors", &[hours, blamed].map(Is));
    pages.quote(NUMBERS, "Of {} Halls that were broken at last, {} were named", &[broken, named].map(Is));
    pages.quote(NUMBERS, "99 of 100 of these within {} turns, the last after {}.", &[soon, last].map(Is));
    pages.quote(NUMBERS, "more than 45° wrong for {} s of it", &[Is(lost_s)]);
}

fn cogging(pages: &Pages) {
    let rows: Vec<Value> = serde_json::from_str(&read("docs/recorded/cogging.json")).unwrap();
    let of = |row: &Value, what: &str| row[what].as_f64().unwrap();
    let is_rough = |row: &&Value| of(row, "without_pct") > 2.0 && row["motor"] != "paper";
    let rough: Vec<_> = rows.iter().filter(is_rough).collect();
    assert_eq!((rows.len(), rough.len()), (17, 12));
    let times = |row: &Value| of(row, "without_pct") / of(row, "learnt_pct");
    assert_eq!(rough.iter().filter(|row| times(row) < 5.0).count(), 2);
    for row in rough {
        let [motor, slots] = ["motor", "slots"].map(|what| &row[what]);
        let motor = motor.as_str().unwrap();
        let said = format!("| {motor} | {} / {slots} | {{}} % | {{}} % | {{}} % | {{}} | {{}} |", row["pole_pairs"]);
        let figures = ["without_pct", "alike_pct", "learnt_pct"].map(|what| Is(of(row, what)));
        let [times, turns] = [Is(times(row)), Is(of(row, "found_turns"))];
        pages.quote(NUMBERS, &said, &[figures[0], figures[1], figures[2], times, turns]);
        assert!(row["found_right"] == true, "{motor}");
    }
    // What differs from pole to pole makes none of the others rougher.
    for row in rows.iter().filter(|row| !is_rough(row) && row["differs"] == true) {
        assert!(of(row, "learnt_pct") < 1.02 * of(row, "alike_pct"), "{row}");
    }
}

fn field_of_the_windings(pages: &Pages) {
    let rows: Vec<Value> = serde_json::from_str(&read("docs/recorded/coil.json")).unwrap();
    let of = |row: &Value, what: &str| row.pointer(what).and_then(Value::as_f64).unwrap_or_else(|| panic!("{what}"));
    assert_eq!(rows.len(), 80);
    let mut quoted = 0;
    for row in &rows {
        let off = (of(row, "/found_deg") - of(row, "/true_deg")).abs();
        assert!(off <= of(row, "/error_deg"), "{row}");
        let motor = row["motor"].as_str().unwrap();
        let said = format!("| {motor} | {{}} | {{}} ± {{}} | {{}} | {{}} | {{}} | {{}} |");
        if of(row, "/share") != 0.05 || !QUOTED.contains(&motor) {
            continue;
        }
        let figures = [
            "/true_deg",
            "/found_deg",
            "/error_deg",
            "/before/loaded_deg",
            "/after/loaded_deg",
            "/before/torque_deg",
            "/after/torque_deg",
        ];
        pages.quote(NUMBERS, &said, &figures.map(|what| Is(of(row, what))));
        quoted += 1;
    }
    assert_eq!(quoted, QUOTED.len());
    let without = rows.iter().filter(|row| of(row, "/share") == 0.0);
    let worst = without.max_by(|a, b| of(a, "/before/loaded_deg").total_cmp(&of(b, "/before/loaded_deg"))).unwrap();
    assert_eq!(worst["motor"], "22-pairs");
    pages.quote(NUMBERS, "{}° at the motor of 22 pole pairs, the worst", &[Is(of(worst, "/before/loaded_deg"))]);
}

/// Motors whose field of the windings the page shows.
const QUOTED: [&str; 8] =
    ["paper", "drone-20uh", "drone-heavy", "gimbal-7", "20ohm", "hub", "direct-drive", "hoverboard"];

fn late_halls(pages: &Pages) {
    let rows: Vec<Value> = serde_json::from_str(&read("docs/recorded/delay.json")).unwrap();
    for row in rows {
        let motors = row["trials"].as_array().unwrap();
        assert_eq!(motors.len(), 20);
        let rms = |what: &str, speed: usize| {
            let square = |motor: &Value| motor[what][speed]["rms_deg"].as_f64().unwrap().powi(2);
            (motors.iter().map(square).sum::<f64>() / motors.len() as f64).sqrt()
        };
        let off_us = |motor: &Value| (motor["found_us"].as_f64().unwrap() - motor["true_us"].as_f64().unwrap()).abs();
        // 25 rad/s is not quoted.
        let mut figures: Vec<_> =
            (1..4).flat_map(|speed| ["before", "after"].map(|what| Is(rms(what, speed)))).collect();
        figures.push(Is(motors.iter().map(off_us).fold(0.0, f64::max)));
        let name = row["name"].as_str().unwrap();
        pages.quote(NUMBERS, &format!("| {name} | {{}} | {{}} | {{}} | {{}} | {{}} | {{}} | {{}} µs |"), &figures);
    }
}

fn late_halls_and_uneven_magnets(pages: &Pages) {
    let worst_us = |name: &str| {
        let rows: Vec<Value> = serde_json::from_str(&read(&format!("docs/recorded/{name}.json"))).unwrap();
        assert_eq!(rows[0]["name"], "not late");
        let motors = rows[0]["trials"].as_array().unwrap();
        assert_eq!(motors.len(), 3);
        let off = |motor: &Value| (motor["found_us"].as_f64().unwrap() - motor["true_us"].as_f64().unwrap()).abs();
        Is(motors.iter().map(off).fold(0.0, f64::max))
    };
    let figures = ["delay_uneven", "delay_mapped"].map(worst_us);
    pages.quote(NUMBERS, "it was off by up to {} µs without a map of the magnets, and by {} µs with", &figures);
}

fn damaged_lines(pages: &Pages) {
    let counts: [f64; 4] = Recorded::of("lines").only("[{}, {}] of [{}, {}]");
    let passed = Is(1e5 * (counts[0] + counts[1]) / (counts[2] + counts[3]));
    pages.quote("SAFETY.md", "then {} of 100 000 damaged lines still pass", &[passed]);
}

fn magnets_in_the_drive(pages: &Pages) {
    let run = Recorded::of("drive_magnets");
    // The third rotor is a quarter as uneven.
    let rotors = run.all("{}° becomes {}°, said to be");
    let found: Vec<f64> = run.all("found again after {} turns: {}°").iter().map(|figures| figures[1]).collect();
    let worst = |values: &[f64]| Is(values.iter().copied().fold(0.0, f64::max));
    let even = [worst(&[rotors[0][0], rotors[1][0]]), worst(&[rotors[0][1], rotors[1][1]]), worst(&found[..8])];
    pages.quote(NUMBERS, "found again after power-up | {}° / {}° / {}° RMS |", &even);
    let quarter = [Is(rotors[2][0]), Is(rotors[2][1]), worst(&found[8..])];
    pages.quote(NUMBERS, "a rotor a quarter as uneven | {}° / {}° / {}° RMS |", &quarter);
    let again = "found again after {} turns";
    let turns = [run.least(again), run.most(again)].map(Is);
    pages.quote(NUMBERS, "found again at 100 rad/s after | {} to {} turns |", &turns);
    for (motor, words) in [
        ("21 pole pairs, 1", "a direct drive's map leaves {}° of {}° ({}° are said)"),
        ("44 pole pairs, 1", "of 44 pole pairs, {}° are left of {}° ({}° are said)"),
    ] {
        let [before, _, after, said]: [f64; 4] =
            run.only(&format!("{motor}: {{}}°; Some({{}}) turns, {{}}° where {{}}° are said"));
        pages.quote(NUMBERS, words, &[after, before, said].map(Is));
    }
    // The test fails at the first.
    pages.say(NUMBERS, "six other rotors over the same Halls, even magnets | 0 |");
    let ended = run.only::<1>("ended after {} tenths of a second")[0] / 10.0;
    pages.quote(NUMBERS, "the map is ended after | {} s, and found again |", &[Is(ended)]);
    let [_, told, found] =
        Recorded::of("many_rotors").only(" 40 rotors: {} maps kept, {} whose pole can be told, {} found,");
    assert!(found <= told);
    pages.quote(NUMBERS, "found / at a wrong pole | {} / 0 |", &[Is(found)]);
}

fn slow_and_uneven(pages: &Pages) {
    let [slowest, slow, usual] =
        Recorded::of("slow_learning").only("worst at 0.8, 1.5 and 3 rad/s: [{}, {}, {}] times the error without");
    let figures = [Is(f64::max(slow, usual)), Is(slowest)];
    pages.quote(NUMBERS, "at 1.5 and 3 rad/s with at most {} times the error, at 0.8 rad/s with {} times", &figures);
}

fn vernier(pages: &Pages) {
    let run = Recorded::of("vernier");
    let [_, before, rms, _]: [f64; 4] = run.only(" 0 of {} wrong ({} uncalibrated), error {}° RMS, {}° at most");
    pages.quote(NUMBERS, "wrong pole pairs in 10⁶ positions (uncalibrated: {}) | 0 |", &[Is(before)]);
    pages.quote(NUMBERS, "unobservable constant, worst encoder | {}° RMS |", &[Is(rms)]);
    let [residual, margin]: [f64; 2] = run.only("residual {} counts of a margin of {}");
    let trials = run.all(", wrong: {}, unchecked_wrong:");
    assert!(trials.len() == 8 && trials.concat().iter().all(|wrong| *wrong == 0.0));
    pages.say(NUMBERS, "noise burst, magnet at half strength | 0 | 0 |");
    pages.quote(NUMBERS, "largest residual, of a margin of {} counts | {} counts |", &[Is(margin), Is(residual)]);
}

fn encoder_in_the_drive(pages: &Pages) {
    let run = Recorded::of("drive_encoder");
    let [_, rms, largest]: [f64; 3] = run.only("1000 power-ups: constant {}°, {}° RMS, {}° at most beyond that");
    pages.quote(
        NUMBERS,
        "… its error beyond the unobservable constant | {}° RMS, {}° at most |",
        &[Is(rms), Is(largest)],
    );
    // The tests fail at the first that is wrong.
    pages.say(NUMBERS, "right position, without motion | 1000 of 1000 | 1000 |");
    pages.say(NUMBERS, "slipped, a magnet chipped) | 0 | 0 |");
    pages.say(NUMBERS, "neither the old nor the new one | 0 of 70 | 0 |");
}

/// The electrical zero from the encoder, mechanical places of the shaft.
fn aligned(pages: &Pages) {
    let off = Recorded::of("drive_encoder").all("{}° before, {}° after");
    let worst = AtMost(off.iter().map(|figures| figures[1].abs()).fold(0.0, f64::max));
    pages.quote("boards/nucleo-g474re-ihm08m1/README.md", "zero from the encoder, to {}° electrical", &[worst]);
}

fn encoder_loops(pages: &Pages) {
    let run = Recorded::of("encoder_loops");
    let seen = "noise_deg: {}, noise_rad_s: {}, error_deg: {}, largest_deg: {}, delay_us: {},";
    let [halls, encoder] = ["Halls", "encoder"].map(|by| run.only::<5>(&format!("by the {by} Seen {{ {seen}")));
    pages.quote(
        NUMBERS,
        "at rest, RMS | {}°, {} rad/s | {}°, {} rad/s |",
        &[halls[0], halls[1], encoder[0], encoder[1]].map(Is),
    );
    pages.quote(
        NUMBERS,
        "RMS / largest | {}° / {}° | {}° / {}° |",
        &[halls[2], halls[3], encoder[2], encoder[3]].map(Is),
    );
    pages.quote(NUMBERS, "at constant speed | {} µs | {} µs |", &[halls[4], encoder[4]].map(Is));
    let held = "motion_deg: {}, off_deg: {}, gives_deg: {}, stays_deg: {}, torque_nm: {}";
    let [halls, encoder] = ["Halls", "encoder"].map(|by| {
        let found = run.all(&format!("by the {by} {{}} mN·m/° Held {{ {held}"));
        found[0].clone()
    });
    let of = |held: &[f64]| [held[1], 1000.0 * held[5]];
    let [[halls_deg, halls_mnm], [encoder_deg, encoder_mnm]] = [of(&halls), of(&encoder)];
    pages.quote(
        NUMBERS,
        "noise of the torque | {}° / {} mN·m | {}° / {} mN·m |",
        &[halls_deg, halls_mnm, encoder_deg, encoder_mnm].map(Is),
    );
    let stiffness = [halls[0], encoder[0]].map(Is);
    pages.quote(NUMBERS, "that comes at once | {} mN·m/° | {} mN·m/° |", &stiffness);
    // The last three are the shipped bandwidths, and both with higher ones.
    let [halls, encoder] = ["Halls", "encoder"].map(|by| {
        let found = run.only::<6>(&format!("{{}} mN·m/° by the {by}: Held {{ {held}"));
        [found[0], 1000.0 * found[5]].map(Is)
    });
    pages.quote(
        NUMBERS,
        "speed, position) | {} mN·m/° at {} mN·m of noise | {} mN·m/° at {} mN·m |",
        &[halls, encoder].concat(),
    );
}

fn measured_motors(pages: &Pages) {
    let [r, l, flux, j, kt]: [f64; 5] =
        Recorded::of("identify").only("L, flux, J, Kt (shares), Coulomb, viscous, load: {}, {}, {}, {}, {},");
    let within = [r.max(l), flux.max(kt), j].map(|share| AtMost(100.0 * share));
    pages.quote(NUMBERS, "--test all identify:: -- --nocapture`) | within {} % / {} % / {} % |", &within);
    let run = Recorded::of("commission");
    let motors = run.all(" s; R {} L {} λ {} J {} Lq/Ld {} % (rough");
    // Of twenty, one has a run more, and another two with a smaller current.
    assert_eq!(motors.len(), 43);
    let worst = |of: &[usize]| AtMost(motors.iter().flat_map(|m| of.iter().map(|k| m[*k].abs())).fold(0.0, f64::max));
    let within = [worst(&[0, 1]), worst(&[2]), worst(&[3])];
    pages.quote(NUMBERS, "--test all commission:: -- --nocapture`) | within {} % / {} % / {} % |", &within);
    let share = run.most("{} % of the limit, ") / 100.0;
    pages.quote(NUMBERS, "as a share of the limit | {} | ≤ 1.2 |", &[Is(share)]);
}

/// At 20 and at 80 kHz, and what 80 kHz are for.
fn other_frequencies(pages: &Pages) {
    let run = Recorded::of("switching");
    let motors = run.all(" s; R {} L {} λ {} J {} Lq/Ld {} % (rough");
    pages.quote(NUMBERS, "dead times of 0.5 and 0.8 µs, {} of 40 that end", &[Is(motors.len() as f64)]);
    let worst = |of: &[usize]| AtMost(motors.iter().flat_map(|m| of.iter().map(|k| m[*k].abs())).fold(0.0, f64::max));
    let within = [worst(&[0, 1]), worst(&[2]), worst(&[3])];
    pages.quote(NUMBERS, "--test all at_twenty -- --nocapture`) | within {} % / {} % / {} % |", &within);
    pages.quote(NUMBERS, "as a share of the limit | {} | |", &[Is(run.most("{} % of the limit, ") / 100.0)]);
    let [_, crossover, margin] = run.only("at 80 kHz: {} Hz to -3 dB, gain of one at {} Hz, {}° of margin");
    pages.quote(NUMBERS, "where_the_bridge -- --nocapture`) | {} Hz / {}° | 2500 Hz |", &[Is(crossover), Is(margin)]);
    pages.quote("docs/hardware.md", "has {}° of phase margin", &[Is(margin)]);
}

fn impedance(pages: &Pages) {
    let run = Recorded::of("impedance");
    let stiffness = |magnets: &str| run.most(&format!(", {magnets}: worst error of the stiffness {{}} %"));
    let damping = |magnets: &str| run.most(&format!(", {magnets}: worst error of the damping {{}} %"));
    let found = ["Even", "Eccentric"].map(|magnets| Is(stiffness(magnets)));
    pages.quote(NUMBERS, "of the largest / off the axis | within {} % / {} % | 3 % |", &found);
    let found = ["Even", "Eccentric"].map(|magnets| Is(damping(magnets)));
    pages.quote(NUMBERS, "5 to 15 Hz / off the axis | within {} % / {} % | 5 % |", &found);
    let hum = run.most("with friction at a wall of 200 N·m/rad: {} % of the energy left");
    let walls = run.all("load {}, kp {}, kd {}: {} % of the energy left");
    let left = walls.iter().map(|figures| figures[3]).fold(0.0, f64::max);
    pages.quote(NUMBERS, "that the settings do not know | {} % |", &[Is(left)]);
    pages.quote(NUMBERS, "five times that frequency | {} % |", &[Is(hum)]);
    pages.quote(IMPEDANCE, "with {} % of the energy of the impact", &[AtMost(hum)]);
}

fn field_weakening(pages: &Pages) {
    let run = Recorded::of("weakening");
    for (name, motor) in [("paper", "3.5 of 5 A |"), ("drone", "20 of 25 A |"), ("hub", "18 of 25 A |")] {
        let figures: [f64; 5] =
            run.only(&format!("{name}: {{}} rad/s without, {{}} rad/s of {{}} with, swings by {{}} %, current {{}}"));
        let said = format!("{motor} {{}} rad/s | {{}} rad/s | {{}} rad/s | {{}} % | {{}} |");
        pages.quote(NUMBERS, &said, &figures.map(Is));
    }
    let late = ["paper", "drone", "hub"]
        .map(|name| run.only::<2>(&format!("{name}: late and uneven, current {{}}, swings by {{}} %")));
    let most = |figure: usize| late.iter().map(|of| of[figure]).fold(0.0, f64::max);
    pages.quote(NUMBERS, "it swings by {} %, with {} of", &[Is(most(1)), Is(most(0))]);
    let board = Recorded::of("virtual_weakening");
    let turned = board.all("{} rad/s without, {} of {} rad/s with field weakening");
    let mut without: Vec<f64> = turned.iter().map(|figures| figures[0]).collect();
    without.sort_by(f64::total_cmp);
    assert!(turned.iter().all(|figures| (figures[1] - figures[2]).abs() < 1.0));
    let figures = [turned[0][2], without[0], without[without.len() - 1]].map(Is);
    pages.quote(NUMBERS, "turns with {} rad/s both ways, where it reaches {} to {} rad/s", &figures);
    let most = run.all("hub transistor dead: Faulted(OverVoltage), Stretch { current_a: {}, bus_v: {}")[0][1];
    pages.quote("SAFETY.md", "does_no_harm`: {} V where", &[Is(most)]);
}

fn long_vectors(pages: &Pages) {
    let run = Recorded::of("long_vectors");
    for (name, motor) in
        [("paper", "| 1 Ω, 0.6 mH, 4 pole pairs, 24 V |"), ("drone", "14.8 V |"), ("hub", "15 pole pairs, 24 V |")]
    {
        let reached: [f64; 2] = run.only(&format!("{name}: {{}} rad/s with three currents, {{}} with two"));
        pages.quote(NUMBERS, &format!("{motor} {{}} | {{}} |"), &reached.map(Is));
    }
    let board = Recorded::of("virtual_weakening");
    let reached: [f64; 2] = board.only("nucleo-g474re-ihm08m1: {} rad/s with three currents, {} rad/s with two");
    pages.quote(NUMBERS, "virtual Nucleo-G474RE {} rad/s become {}, both ways", &reached.map(Is));
    pages.quote("docs/hardware.md", "rises from {} to {} rad/s", &reached.map(Is));
}

/// Of the drives with two Halls: what may befall those, and what else was missed.
fn campaign_of_two(pages: &Pages) {
    let run: Value = serde_json::from_str(&read("docs/recorded/faults_two.json")).unwrap();
    let of = |value: &Value, name: &str| value[name].as_f64().unwrap_or_else(|| panic!("no {name}"));
    let page = "SAFETY.md";
    assert_eq!(of(&run, "halls"), 2.0);
    pages.quote(
        page,
        "With two Halls {} of {} were missed, and {} false in {} s of running.",
        &[of(&run, "missed"), of(&run, "injected"), of(&run, "false_alarms"), of(&run, "quiet_periods") / 40e3].map(Is),
    );
    let missed = |kind: &Value| of(kind, "injected") - of(kind, "detected");
    let kinds = run["kinds"].as_object().unwrap();
    let two = read("sim/src/experiment/faults/two_halls.rs");
    let rows: Vec<_> =
        kinds.iter().filter(|(name, kind)| two.contains(&format!("\"{name}\"")) || missed(kind) > 0.0).collect();
    assert!(rows.len() > 10);
    for (name, kind) in rows {
        let figures = ["harmful_unnamed", "harmless_unnamed", "median_ms", "late_ms", "worst_wrong_deg"];
        let [harmful, harmless, median, late, wrong] = figures.map(|figure| Is(of(kind, figure)));
        let row = format!("| {name} | {{}} | {{}} | {{}} | {{}} | {{}} ms | {{}} ms | {{}}° |");
        let count = [of(kind, "injected"), missed(kind)].map(Is);
        pages.quote(page, &row, &[count[0], count[1], harmful, harmless, median, late, wrong]);
    }
}

fn campaign(pages: &Pages) {
    let run: Value = serde_json::from_str(&read("docs/recorded/faults.json")).unwrap();
    let of = |value: &Value, name: &str| value[name].as_f64().unwrap_or_else(|| panic!("no {name}"));
    let page = "SAFETY.md";
    let seconds = of(&run, "quiet_periods") / 40e3;
    assert_eq!(run["false_alarms"], 0);
    pages.quote(
        page,
        "{} of {} were missed, and no fault was invented in {} s of running.",
        &[of(&run, "missed"), of(&run, "injected"), seconds].map(Is),
    );
    let kinds = run["kinds"].as_object().unwrap();
    let missed = |kind: &Value| of(kind, "injected") - of(kind, "detected");
    let (never, some): (Vec<_>, Vec<_>) = kinds.iter().partition(|(_, kind)| missed(kind) == 0.0);
    if some.is_empty() {
        pages.quote(page, "None of the {} kinds was missed", &[Is(never.len() as f64)]);
    } else {
        pages.quote(page, "{} kinds were never missed; the others:", &[Is(never.len() as f64)]);
    }
    for (name, kind) in some {
        let [injected, wrong, ms, current] =
            ["injected", "worst_wrong_deg", "worst_wrong_ms", "worst_current"].map(|figure| Is(of(kind, figure)));
        let row = format!("| {name} | {{}} | {{}} | {{}}° | {{}} ms | {{}} |");
        pages.quote(page, &row, &[injected, Is(missed(kind)), wrong, ms, current]);
    }
    let unnamed = ["open phase at speed", "dead transistor at speed", "amplifier of a wrong gain"].map(|name| {
        let kind = &kinds[name];
        [of(&kind["reported"], "nothing"), of(kind, "injected")].map(Is)
    });
    pages.quote(
        page,
        "not named: {} of {} open phases at speed, {} of {} dead transistors, {} of {} amplifiers",
        unnamed.as_flattened(),
    );
    let current = of(&kinds["all amplifiers dead at speed"], "worst_current");
    pages.quote(page, "until then up to {} times `over_current_a` was seen to flow", &[Is(current)]);
}
