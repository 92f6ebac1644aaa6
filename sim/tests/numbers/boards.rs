//! What the virtual boards and the emulated chip printed, as `docs/record` keeps it, and where the pages quote it.

use super::page::Figure::{AtMost, Is};
use super::page::{Pages, read};
use super::text::Recorded;

const HARDWARE: &str = "docs/hardware.md";
const EMULATOR: &str = "emulator/README.md";
const NUMBERS: &str = "docs/numbers.md";
const NUCLEO: &str = "nucleo-g474re-ihm08m1";
const SMALL_NUCLEO: &str = "nucleo-g431rb-ihm16m1";
const ESC1: &str = "b-g431b-esc1";
const BOARDS: [&str; 3] = [NUCLEO, SMALL_NUCLEO, ESC1];
/// Cycles in a microsecond.
const MHZ: f64 = 170.0;

pub const CHECKS: &[fn(&Pages)] = &[
    control_periods,
    other_frequencies,
    long_runs,
    angles,
    tools,
    switching_off,
    brake_resistor,
    stopping,
    feeding,
    step_alone,
    encoder,
];

/// Cycles of a control period's work on a board: in the mean and at most while it turns, and at most whatever it does.
fn cycles(recorded: &str, board: &str) -> [f64; 3] {
    let run = Recorded::of(recorded);
    let work = "a period's work begins {} ns after the trigger and takes {} to {} cycles, {} in the mean,";
    let spans = run.all(&format!("{board}: {{}} Hz; {work}"));
    let turning = spans.last().unwrap();
    [turning[4], turning[3], spans.iter().map(|span| span[3]).fold(0.0, f64::max)]
}

fn control_periods(pages: &Pages) {
    let [nucleo, esc1] = [NUCLEO, ESC1].map(|board| cycles("virtual_rate", board));
    let turning = |[mean, most, _]: [f64; 3]| [mean, most, mean / MHZ, most / MHZ].map(Is);
    pages.quote(
        HARDWARE,
        "the slower of its bounds) | {} / {} cycles, {} / {} µs | {} / {} cycles, {} / {} µs |",
        &[turning(nucleo), turning(esc1)].concat(),
    );
    pages.quote(
        HARDWARE,
        "… at most, whatever it does, of 25 µs | {} µs | {} µs |",
        &[nucleo[2] / MHZ, esc1[2] / MHZ].map(Is),
    );
}

/// At the lowest and the highest frequency that a board may be set to; at 40 kHz of the runs at that alone.
fn other_frequencies(pages: &Pages) {
    let share = |recorded: &str, board: &str, khz: f64| {
        let run = Recorded::of(recorded);
        let spans = run.all(&format!(
            "{board}: {{}} Hz; a period's work begins {{}} ns after the trigger and takes {{}} to {{}} \
             cycles, {{}} in the mean, of which it waits {{}} for the flash; {{}} % of the period"
        ));
        let turning = spans.iter().rfind(|span| (span[0] / khz / 1e3 - 1.0).abs() < 0.01);
        Is(turning.unwrap_or_else(|| panic!("{board} at {khz} kHz"))[6])
    };
    let of = |board: &str, khz: f64| share("virtual_switching", board, khz);
    pages.quote(
        HARDWARE,
        "in `emulator/`) | {} % / {} % / {} % | {} % / {} % / – on the ESC1 |",
        &[of(NUCLEO, 20.0), share("virtual_rate", NUCLEO, 40.0), of(NUCLEO, 80.0), of(ESC1, 20.0), of(ESC1, 40.0)],
    );
    let run = Recorded::of("virtual_long");
    let triggers = run.all(&format!("board {NUCLEO} triggers of the ADC {{}} missed triggers 0")).pop().unwrap()[0];
    pages.quote(HARDWARE, "triggers of the ADCs / missed | {} / 0 |", &[Is(triggers)]);
}

/// Ten seconds of turning; the command fails where a trigger is missed or anything else is wrong.
fn long_runs(pages: &Pages) {
    let run = Recorded::of("virtual_long");
    let of = |board: &str, told: &str| run.all(&format!("board {board} {told}"))[0].clone();
    let triggers = [NUCLEO, ESC1].map(|board| Is(of(board, "triggers of the ADC {} missed triggers 0")[0]));
    pages.quote(HARDWARE, "unclocked or unknown | {} / 0 / 0 / 0 | {} / 0 / 0 / 0 |", &triggers);
    let latency = |board: &str| {
        let words = "triggers of the ADC {} missed triggers 0 ADC1_2 (control) {} Hz {} to {} ns";
        of(board, words)[3]
    };
    pages.quote(
        HARDWARE,
        "while a page of the flash is erased, with the bridge off | {} ns; none | {} ms |",
        &[latency(NUCLEO), latency(ESC1) / 1e6].map(Is),
    );
}

fn angles(pages: &Pages) {
    let run = Recorded::of("virtual_angle");
    let of = |board: &str, what: &str| {
        run.all(&format!("{board}, {what}: {{}}° RMS, host {{}}° ({{}}, {{}}, {{}}, {{}}): {{}} of it"))[0].clone()
    };
    let pairs = [NUCLEO, ESC1].map(|board| [of(board, "constant speed"), of(board, "start, reversal, stop")]);
    let column = |column: usize| pairs.iter().flatten().map(|figures| Is(figures[column])).collect::<Vec<_>>();
    pages.quote(
        HARDWARE,
        "--test angle -- --nocapture`, in `emulator/`) | {}° / {}° RMS | {}° / {}° RMS |",
        &column(0),
    );
    pages.quote(HARDWARE, "over that of the host's simulation | {} / {} | {} / {} |", &column(6));
}

/// What `hallctl` told a virtual board, and what its motor did.
fn tools(pages: &Pages) {
    let run = Recorded::of("virtual_hallctl");
    // The test's command, and by how much the motor was off it.
    let worst = |template: &str, wanted: f64| {
        let found = ["block", "sinusoidal", "field-oriented"].map(|by| run.all(&format!("{by}: {template}")));
        found.concat().iter().map(|figures| (figures[0].abs() - wanted).abs()).fold(0.0, f64::max)
    };
    let [torque, speed] = [worst("{} N m", 0.004) / 0.004, worst("{} rad/s for", 40.0) / 40.0];
    pages.quote(HARDWARE, "torque within {} %, speed within {} %", &[torque, speed].map(|share| AtMost(100.0 * share)));
    pages.quote(HARDWARE, "position within {} turns", &[AtMost(worst("{} turns", 1.5))]);
}

/// Longest microseconds from the injection and from the first sample that shows it, of a board's faults whose names
/// are so.
fn longest(board: &str, named: impl Fn(&str) -> bool) -> [f64; 2] {
    let text = read("docs/recorded/virtual_boards.txt");
    let (_, rows) = text.split_once(&format!("{board}, a period of")).unwrap();
    let rows = rows.lines().skip(1).take_while(|row| row.starts_with('|'));
    let of: Vec<Vec<&str>> = rows.map(|row| row.split('|').map(str::trim).collect()).collect();
    let of: Vec<_> = of.iter().filter(|row| named(row[1])).collect();
    assert!(!of.is_empty(), "{board}");
    [3, 4].map(|column| of.iter().map(|row| row[column].parse().unwrap()).fold(0.0, f64::max))
}

fn switching_off(pages: &Pages) {
    let hall = |name: &str| name.starts_with("hall") && !name.ends_with("stuck");
    let down = |name: &str| name.starts_with("current") && name.contains(" -");
    let up = |name: &str| name.starts_with("current") && !name.contains(" -");
    let bus = |name: &str| name.starts_with("bus");
    let both = |named: fn(&str) -> bool| [longest(NUCLEO, named), longest(ESC1, named)];
    let quote = |row: &str, [nucleo, esc1]: [[f64; 2]; 2]| {
        pages.quote(
            EMULATOR,
            &format!("{row} | {{}} ({{}}) | {{}} ({{}}) |"),
            &[nucleo[0], esc1[0], nucleo[1], esc1[1]].map(Is),
        );
    };
    quote("| Hall open, at ground, at the supply | each sample | 1", both(hall));
    quote("and current up through a shunt | each sample | 0", both(up));
    let [nucleo, esc1] = both(bus).map(|bus| bus[1]);
    pages.quote(EMULATOR, "the capacitor's time | {} ({}) |", &[nucleo, esc1].map(Is));
    // The comparators see the larger current.
    let shunt = [longest(NUCLEO, |name| name.contains(" -36")), longest(ESC1, |name| name.contains(" -72"))];
    pages.quote(EMULATOR, "while the low side conducts | | {} ({}) | |", &shunt.map(|found| Is(found[0])));
    let swapped = BOARDS.map(|board| longest(board, |name| name.starts_with("swap"))[0] / 1e6);
    pages.quote(EMULATOR, "comes to rest and is stalled | | {} s | |", &[Is(swapped.into_iter().fold(0.0, f64::max))]);
    for (board, words) in [
        (ESC1, "any from 6 A on: off within {} µs"),
        (NUCLEO, "any from 6 A on: off within {} µs"),
        (SMALL_NUCLEO, "by the next sample, within {} µs"),
    ] {
        let page = format!("boards/{board}/README.md");
        pages.quote(&page, words, &[AtMost(longest(board, |name| up(name) || down(name))[0])]);
    }
    let page = format!("boards/{SMALL_NUCLEO}/README.md");
    pages.quote(&page, "an open Hall within {} µs", &[AtMost(longest(SMALL_NUCLEO, hall)[0])]);
    let enable: [f64; 1] = Recorded::of("virtual_boards").only("enable input open: off after {} µs at most");
    pages.quote(EMULATOR, "| each period | | {} | | enable input |", &enable.map(Is));
    pages.quote("boards/nucleo-g474re-ihm08m1/README.md", "in the next period ({} µs", &[AtMost(enable[0])]);
}

fn brake_resistor(pages: &Pages) {
    let run = Recorded::of("virtual_boards");
    let seen = run.all("brake resistor on after {} µs, off after {} µs");
    let [on, off] = [0, 1].map(|column| Is(seen.iter().map(|us| us[column]).fold(0.0, f64::max) / 1e3));
    pages.quote(EMULATOR, "is on {} ms at most after the supply was turned up beyond `chopper_v`", &[on]);
    pages.quote(EMULATOR, "and off {} ms after it was turned down", &[off]);
    let stopped = run.most("brake resistor off after {} µs at most") / 1e3;
    pages.quote(EMULATOR, "and {} ms at most after the control has stopped", &[Is(stopped)]);
}

/// The worst of all boards.
fn stopping(pages: &Pages) {
    let run = Recorded::of("virtual_boards");
    let most = |what: &str| BOARDS.map(|board| run.most(&format!("{board}, {what}: off after {{}} µs")));
    let idle = ["the tasks are idle", "the tasks hang", "calibrating for 0.7 s"].map(most).concat();
    let idle = idle.into_iter().fold(0.0, f64::max);
    let busy = run.most("waits for its answer: off after {} µs").max(run.most("fills the line: off after {} µs"));
    let garbage = run.most("amid garbage, the tasks hang: off after {} µs");
    pages.quote(EMULATOR, "has the bridge off within {} µs of its first bit", &[AtMost(idle)]);
    pages.quote(
        EMULATOR,
        "{} ms at most where other requests or telemetry are on the line before it, {} ms amid garbage",
        &[busy, garbage].map(|us| Is(us / 1e3)),
    );
}

fn feeding(pages: &Pages) {
    let run = Recorded::of("virtual_boards");
    pages.quote(EMULATOR, "fit and its save: {} ms at most", &[Is(run.most("fed after {} ms"))]);
    pages.quote(EMULATOR, "An erase takes {} % of the time", &[Is(run.most("is refreshed after {} % of its time"))]);
}

/// `Drive::step` linked alone, and the flood of critical sections.
fn step_alone(pages: &Pages) {
    let [flash, _]: [f64; 2] = Recorded::of("fast_path").only("{} bytes of flash, {} bytes of RAM");
    pages.quote(NUMBERS, "an image of it alone, {} kB of flash", &[Is(flash / 1e3)]);
    let [late]: [f64; 1] = Recorded::of("flood").only("none later than {} instructions");
    pages.quote(NUMBERS, "delays no period by more than {} instructions", &[Is(late)]);
}

/// The firmware with two rings on the virtual Nucleo.
fn encoder(pages: &Pages) {
    let run = Recorded::of("virtual_encoder");
    let powered: [f64; 4] = run.only("{} power-ups: constant {}°, {}° RMS, {}° at most");
    pages.quote(
        NUMBERS,
        "{} of {} power-ups right, {}° RMS and {}° at most beyond the constant",
        &[powered[0], powered[0], powered[2], powered[3]].map(Is),
    );
    // Of each of four kinds. The tests fail at the first that makes a wrong pole pair.
    let [still, turning] = ["of {} each told at power-up", "of {} each a fault in motion"].map(|of| 4.0 * run.most(of));
    pages.quote(NUMBERS, "any of {} defects at power-up and {} in motion", &[still, turning].map(Is));
    let [mean, _, longest] = cycles("virtual_encoder", NUCLEO);
    pages.quote(
        NUMBERS,
        "A control period's work is {} cycles in the mean with everything on, and {} cycles at most",
        &[mean, longest].map(Is),
    );
}
