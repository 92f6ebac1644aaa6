//! What long tests and experiments print, as `docs/record` keeps it, and where the pages quote it.

use crate::page::Figure::{AtMost, Is};
use crate::page::Pages;
use crate::text::Recorded;

const NUMBERS: &str = "docs/numbers.md";
const IMPEDANCE: &str = "docs/impedance.md";

pub const CHECKS: &[fn(&Pages)] = &[
    a_hundred_motors,
    functions,
    uneven_magnets,
    magnets_in_the_drive,
    vernier,
    encoder_in_the_drive,
    encoder_loops,
    measured_motors,
    impedance,
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
    // The test fails at the first lost turn.
    let [reversals, _]: [f64; 2] = Recorded::of("turns").only("passed ... {} reversals, up to {} Hz");
    assert!(reversals > 4e5);
    pages.say(NUMBERS, "(`cargo test --test turns`) | 0 |");
}

fn functions(pages: &Pages) {
    let trig = Recorded::of("trig");
    let most = |name: &str| Is(trig.most(&format!(" {name}: max {{}},")));
    pages.quote(NUMBERS, "`trig::sin`, `trig::cos` | {} |", &[most("sin")]);
    pages.quote(NUMBERS, "`trig::asin` | {} rad |", &[most("asin")]);
    let arctangents = [most("atan2"), most("atan2_without_division")];
    pages.quote(NUMBERS, "with / without a division | {} / {} rad |", &arctangents);
}

fn uneven_magnets(_pages: &Pages) {}
fn magnets_in_the_drive(_pages: &Pages) {}

fn vernier(pages: &Pages) {
    let run = Recorded::of("vernier");
    let [_, before, rms, _]: [f64; 4] = run.only(" 0 of {} wrong ({} uncalibrated), error {}° RMS, {}° at most");
    pages.quote(NUMBERS, "wrong pole pairs in 10⁶ positions (uncalibrated: {}) | 0 |", &[Is(before)]);
    pages.quote(NUMBERS, "unobservable constant, worst encoder | {}° RMS |", &[Is(rms)]);
    let [residual, margin]: [f64; 2] = run.only("residual {} counts of a margin of {}");
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
    // The test fails at the first that is wrong.
    pages.say(NUMBERS, "right position, without motion | 1000 of 1000 |");
}

fn encoder_loops(_pages: &Pages) {}

fn measured_motors(_pages: &Pages) {}

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
