//! How often the control interrupt comes, and how long it takes.

use super::{ask, perform, run};
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

/// The clock of the PWM timer.
const TIMER_HZ: f64 = 170e6;
/// From the trigger of the ADCs to the valley, which takes the compare values up, ns: the shortest of all boards.
const LEAD_NS: f64 = 600.0;

/// PWM period as the timer counts it, ns.
fn period_ns(pwm_hz: f64) -> f64 {
    1e9 * 2.0 * (TIMER_HZ / (2.0 * pwm_hz)).round() / TIMER_HZ
}

/// The control interrupt is over so long after the trigger, and takes no longer than the board promises, with the flash at
/// the slower of its bounds.
fn within(outcome: &Outcome, period_ns: f64, over_ns: f64, at_most: u64) {
    let control = outcome.control.as_ref().expect("a control interrupt");
    let (begins, lasts) = (control.after_trigger_ns.min, control.duration_ns.max);
    let [mean, waited] = control.mean_cycles;
    println!(
        "{}: {:.0} Hz; a period's work begins {begins:.0} ns after the trigger and takes {:.0} to {:.0} cycles, {mean:.0} in \
         the mean, of which it waits {waited:.0} for the flash; {:.1} % of the period at most",
        outcome.board,
        control.rate_hz,
        control.cycles.min,
        control.cycles.max,
        100.0 * lasts / period_ns
    );
    assert!(begins + lasts < over_ns, "{begins} ns and {lasts} ns, of {over_ns} ns");
    assert!(control.cycles.max <= at_most as f64, "{} cycles, of {at_most}", control.cycles.max);
}

/// Turns a calibrated board field-oriented both ways, with telemetry, and holds the control interrupt to its rate and to
/// the cycles that are promised: in the mean, at most while it turns, at most whatever it does.
pub fn turns_at(session: &mut Session, pwm_hz: f64, [mean, turning, longest]: [u64; 3]) {
    let period_ns = period_ns(pwm_hz);
    // Whatever a step of start and calibration does. The one that begins a calibration is the longest, and a valley later
    // no harm: the bridge is off.
    let before = Outcome::of(session);
    within(&before, period_ns, 1.5 * period_ns, longest);
    // When the valley comes that takes up what was computed.
    let within = |outcome: &Outcome, at_most: u64| within(outcome, period_ns, period_ns + LEAD_NS, at_most);

    session.machine.forget_profile();
    ask(session, "arm");
    ask(session, "telemetry 500");
    // The check at arming.
    run(session, 1.2);
    within(&Outcome::of(session), longest);
    session.machine.forget_profile();
    let (from_s, triggers) = (session.seconds(), session.machine.system.facts().triggers);
    for speed in [100.0, -100.0, 40.0, -40.0] {
        ask(session, &format!("speed {speed}"));
        run(session, 0.5);
        let found = session.machine.system.facts().motor["speed_rad_s"];
        assert!((found - speed).abs() < 4.0, "{found} instead of {speed}: {:#?}", session.lines);
    }
    let elapsed_s = session.seconds() - from_s;
    assert!(elapsed_s > 2.0);

    let outcome = Outcome::of(session);
    assert_eq!(outcome.verdict(), Vec::<String>::new());
    assert_eq!(outcome.resets, before.resets);
    assert_eq!(outcome.facts.moe.last().map(|edge| edge.on), Some(true), "{:#?}", session.lines);
    // Every trigger has led to one interrupt, and each came when it should.
    let triggers = (outcome.facts.triggers - triggers) as f64;
    let control = outcome.control.as_ref().expect("a control interrupt");
    assert!((triggers - elapsed_s * 1e9 / period_ns).abs() <= 2.0, "{triggers} in {elapsed_s} s");
    assert!((triggers - control.duration_ns.count as f64).abs() <= 2.0, "{control:?}");
    let in_time = |found: f64| (found - period_ns).abs() < 500.0;
    assert!(in_time(control.period_ns.min) && in_time(control.period_ns.max), "{control:?}");
    assert!(control.latency_ns.max < 500.0, "{control:?}");
    within(&outcome, turning);
    assert!(control.mean_cycles[0] <= mean as f64, "{} cycles in the mean, of {mean}", control.mean_cycles[0]);
}

/// What a calibrated board that is at rest is asked for, or what happens to it, and how long that is watched, s.
const STAGES: &[(&[&str], f64)] = &[
    (&["set speed_kp 0.011", "set max_current_a 1.4"], 0.02),
    (&["telemetry 500", "arm"], 1.0),
    (&["torque 0.001", "torque -0.001"], 0.1),
    (&["speed 40"], 0.4),
    (&["position 1"], 0.3),
    (&["speed 20"], 0.2),
    (&["voltage 0.1"], 0.1),
    (&["speed 20"], 0.2),
    (&["disarm"], 0.3),
    (&["arm", "disarm", "arm", "speed 10"], 0.8),
    (&["hall 1 open"], 0.1),
    (&["hall 1 good"], 0.5),
    (&["clear", "commutate sinusoidal", "arm"], 0.9),
    (&["speed 40"], 0.3),
    (&["voltage 0.1"], 0.1),
    (&["disarm"], 0.5),
    (&["commutate block", "arm"], 0.5),
    (&["speed 40"], 0.3),
    (&["disarm"], 0.5),
    (&["commutate field-oriented", "identify"], 1.0),
    (&["release"], 0.3),
    (&["disarm", "clear"], 0.3),
    (&["arm", "bus 50V"], 0.2),
    (&["bus 24V", "calibrate"], 0.3),
];

/// The longest periods of all that a board does, and what they consist of.
pub fn longest_steps(session: &mut Session, at_most: u64) {
    session.watch_control();
    for (asked, watched_s) in STAGES {
        session.machine.forget_profile();
        for what in *asked {
            if ["hall", "bus", "current"].iter().any(|word| what.starts_with(word)) {
                perform(session, what);
            } else {
                ask(session, what);
            }
        }
        run(session, *watched_s);
        let outcome = Outcome::of(session);
        let longest = outcome.longest.as_ref().expect("it is watched");
        println!("{}: {asked:?}: {} cycles, of which {} waited", outcome.board, longest.cycles, longest.waited);
        for part in longest.parts.iter().filter(|part| part.cycles >= 0.04 * longest.cycles as f64) {
            println!("    {:5.0} {:5.0} {:5.0} {}", part.instructions, part.cycles, part.waited, part.function);
        }
        assert!(longest.cycles <= at_most, "{asked:?}: {} cycles, of {at_most}", longest.cycles);
    }
}
