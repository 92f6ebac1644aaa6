//! The firmwares as they would be flashed, on their boards: boot, calibrate, spin, and what happens when something breaks.

use bus::{Disturbance, ResetCause, System};
use chip::Board;
use plant::PlantParameters;
use std::sync::OnceLock;
use virtual_board::{firmware, outcome::Outcome, script, session::Session};

const NUCLEO: &str = "nucleo-g474re-ihm08m1";
const ESC: &str = "b-g431b-esc1";

fn elf(board: &str) -> Vec<u8> {
    static BUILT: [OnceLock<Vec<u8>>; 2] = [const { OnceLock::new() }; 2];
    let build = || std::fs::read(firmware::build(board).expect("the firmware builds")).expect("it is there");
    BUILT[usize::from(board == ESC)].get_or_init(build).clone()
}

fn session(board: &str, script: &str) -> Session {
    let known = Board::named(board).expect("a board");
    let mut session = Session::new(known, elf(board), &PlantParameters::unkind(1), 1).expect("a session");
    session.follow(script::parse(script).expect("a script"));
    session
}

fn says(session: &Session, text: &str) -> bool {
    session.lines.iter().any(|line| line.message.contains(text))
}

fn until(session: &mut Session, text: &str, at_most_s: f64) {
    while !says(session, text) {
        assert!(session.seconds() < at_most_s, "no {text:?} until {at_most_s} s: {:#?}", session.lines);
        session.slice(at_most_s).expect("a run");
    }
}

/// A board that has calibrated, with its bridge off.
fn calibrated(board: &str) -> Session {
    let mut session = session(board, "at 30ms send calibrate");
    until(&mut session, "calibrated", 8.0);
    until(&mut session, "Ready after", 8.2);
    session.run_until(session.seconds() + 0.05).expect("a run");
    session
}

fn ask(session: &mut Session, what: &str) {
    let at_us = (session.seconds() * 1e6).ceil();
    session.follow(script::parse(&format!("at {at_us}us send {what}")).expect("a request"));
    // The longest reply takes 5.5 ms at the line's rate.
    session.run_until(session.seconds() + 8e-3).expect("a run");
}

/// Last value of a column of the motor's trace.
fn motor(session: &Session, name: &str) -> f64 {
    let column = session.trace.names.iter().position(|known| known == name).expect("a column");
    session.trace.rows.last().expect("a row")[column]
}

fn boots(board: &str) {
    let mut session = session(board, "at 50ms send hello");
    session.run_until(0.25).expect("a run");
    let outcome = Outcome::of(&session);
    assert_eq!(outcome.verdict(), Vec::<String>::new());
    assert!(says(&session, "Hello(Hello"), "{:#?}", session.lines);
    let control = outcome.control.expect("a control interrupt");
    let pwm = outcome.facts.pwm.expect("a PWM");
    assert!((control.rate_hz / pwm.hz - 1.0).abs() < 1e-3, "{} and {}", control.rate_hz, pwm.hz);
    assert!(control.latency_ns.max < 500.0, "{:?}", control.latency_ns);
    assert!(outcome.facts.moe.is_empty(), "{:?}", outcome.facts.moe);
    let stack = outcome.stack.expect("a stack");
    assert!(stack.used < stack.size, "{stack:?}");
    let clock = |name: &str| outcome.facts.clocks.iter().find(|clock| clock.name == name).expect("a clock").hz;
    assert_eq!(clock("HCLK"), 170e6);
}

#[test]
fn the_nucleo_boots() {
    boots(NUCLEO);
}

#[test]
fn the_esc_boots() {
    boots(ESC);
}

/// Calibrates, then turns both ways in all three commutations.
fn spins(board: &str) {
    let mut session = calibrated(board);
    for commutation in ["field-oriented", "sinusoidal", "block"] {
        ask(&mut session, &format!("commutate {commutation}"));
        ask(&mut session, "arm");
        for speed in [40.0, -40.0] {
            ask(&mut session, &format!("speed {speed}"));
            session.run_until(session.seconds() + 0.5).expect("a run");
            let found = motor(&session, "speed / rad/s");
            assert!((found - speed).abs() < 4.0, "{commutation}: {found} instead of {speed}: {:#?}", session.lines);
        }
        ask(&mut session, "disarm");
        session.run_until(session.seconds() + 1.0).expect("a run");
    }
    let outcome = Outcome::of(&session);
    assert_eq!(outcome.verdict(), Vec::<String>::new());
    assert_eq!(outcome.resets, []);
    for leg in &outcome.facts.legs {
        assert!(leg.dead_time_rising_ns.min > 400.0 && leg.dead_time_falling_ns.min > 400.0, "{leg:?}");
    }
}

#[test]
fn the_nucleo_calibrates_and_spins() {
    spins(NUCLEO);
}

#[test]
fn the_esc_calibrates_and_spins() {
    spins(ESC);
}

/// A control interrupt that hangs: the watchdog resets the chip, the bridge is off, and the drive comes back.
fn hangs(board: &str) {
    let mut session = session(board, "at 30ms send calibrate\nat 200ms hang");
    session.run_until(0.2).expect("a run");
    let timeout_s = session.machine.system.facts().watchdog.expect("a watchdog").timeout_s;
    while session.resets.is_empty() && session.seconds() < 3.0 {
        session.slice(3.0).expect("a run");
    }
    let [(at_s, ResetCause::Watchdog)] = session.resets[..] else { panic!("{:?}", session.resets) };
    let outcome = Outcome::of(&session);
    assert!(at_s > 0.2 && at_s < 0.2 + timeout_s, "{board}: {at_s} s");
    assert!(!outcome.facts.moe.last().expect("an edge").on);
    session.machine.hang(None);
    session.run_until(at_s + 0.1).expect("a run");
    assert!(says(&session, "the watchdog has reset the chip"), "{:#?}", session.lines);
}

#[test]
fn a_hang_of_the_nucleo_ends_in_a_watchdog_reset() {
    hangs(NUCLEO);
}

#[test]
fn a_hang_of_the_esc_ends_in_a_watchdog_reset() {
    hangs(ESC);
}

/// A turning board to which something is done: after how many microseconds its bridge is off, and by what.
fn trips(board: &str, what: &str) -> (f64, String) {
    let mut session = calibrated(board);
    ask(&mut session, "arm");
    ask(&mut session, "speed 20");
    session.run_until(session.seconds() + 0.1).expect("a run");
    let at_us = (session.seconds() * 1e6).ceil();
    session.follow(script::parse(&format!("at {at_us}us {what}")).expect("a script"));
    session.run_until(session.seconds() + 0.05).expect("a run");
    let edge = session.machine.system.facts().moe.last().cloned().expect("an edge");
    assert!(!edge.on, "{board}, {what}: {:#?}", session.lines);
    println!("{board}, {what}: off after {:.1} us by {}", edge.at_s * 1e6 - at_us, edge.by);
    (edge.at_s * 1e6 - at_us, edge.by)
}

/// Current down through a shunt is what the comparators see, at any instant in which the low side conducts: half a period at most,
/// and their filter. Current up is seen by the next sample, and acted on by the interrupt after it.
fn over_currents(board: &str, amperes: f64, comparators: &str) {
    let (after_us, by) = trips(board, &format!("current V -{amperes}A"));
    assert!(by.starts_with(comparators) && (0.0..16.0).contains(&after_us), "{board}: {after_us} us, {by}");
    let (after_us, by) = trips(board, &format!("current V {amperes}A"));
    assert!(by == "software" && (0.0..33.0).contains(&after_us), "{board}: {after_us} us, {by}");
}

#[test]
fn break_pin_and_over_current_switch_the_nucleo_off() {
    let (after_us, by) = trips(NUCLEO, "break low");
    assert!(by == "break TIM1_BKIN" && (0.0..1.0).contains(&after_us), "{after_us} us, {by}");
    over_currents(NUCLEO, 40.0, "break TIM1_BKIN");
}

#[test]
fn over_current_switches_the_esc_off() {
    over_currents(ESC, 70.0, "break COMP");
}

/// Power goes at every flash operation of a save: after it, the setting is the old or the new one, and the calibration is
/// still there.
fn survives_power_cuts(board: &str) {
    let mut prepared = calibrated(board);
    ask(&mut prepared, "set max_speed_rad_s 111");
    ask(&mut prepared, "save");
    until(&mut prepared, "record 2 saved", 10.0);
    ask(&mut prepared, "set max_speed_rad_s 123");
    let mut whole = prepared.fork().expect("a fork");
    ask(&mut whole, "save");
    let at_most_s = whole.seconds() + 0.5;
    until(&mut whole, "record 2 saved", at_most_s);
    let operations = whole.machine.system.facts().flash_operations - prepared.machine.system.facts().flash_operations;
    assert!(operations > 2, "{operations}");
    let mut values = Vec::new();
    for cut in 0..operations {
        let mut session = prepared.fork().expect("a fork");
        let now = session.machine.now();
        session.machine.system.disturb(&Disturbance::PowerCut(cut), now).expect("a power cut");
        ask(&mut session, "save");
        session.run_until(session.seconds() + 0.15).expect("a run");
        assert!(matches!(session.resets[..], [(_, ResetCause::PowerOn)]), "{board}, {cut}: {:?}", session.resets);
        session.lines.clear();
        ask(&mut session, "status");
        ask(&mut session, "get max_speed_rad_s");
        assert!(says(&session, "calibrated: true"), "{board}, {cut}: {:#?}", session.lines);
        let value = [111.0, 123.0].into_iter().find(|value| says(&session, &format!(" value: {value:.1},")));
        values.push(value.unwrap_or_else(|| panic!("{board}, {cut}: {:#?}", session.lines)));
    }
    // The old one until the record is complete.
    assert!(values.is_sorted(), "{values:?}");
    assert_eq!(values[0], 111.0);
}

#[test]
fn power_cuts_leave_the_settings_of_the_nucleo_intact() {
    survives_power_cuts(NUCLEO);
}

#[test]
fn power_cuts_leave_the_settings_of_the_esc_intact() {
    survives_power_cuts(ESC);
}
