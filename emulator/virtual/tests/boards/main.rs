//! The firmwares as they would be flashed, on their boards: boot, calibrate, spin, and what happens when something
//! breaks.

mod brake;
mod disarm;
mod enable;
mod faults;
mod line;
mod power;
#[path = "../common/mod.rs"]
mod support;
mod watchdog;
mod weakening;

use support::{arm, ask, board, calibrated, motor, perform, run, says, session};
use virtual_board::outcome::Outcome;

fn boots(board: &str) {
    let mut session = session(board, "at 50ms send hello");
    run(&mut session, 0.25);
    let outcome = Outcome::of(&session);
    assert_eq!(outcome.verdict(), Vec::<String>::new());
    assert!(says(&session, "Hello(Hello"), "{:#?}", session.lines);
    // That of the virtual chip number 1.
    let serial = [0x4a55_0001, 0x4e59_4c57, 0x525d_505b_u32];
    assert!(says(&session, &format!("serial: {serial:?}")), "{:#?}", session.lines);
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

/// Calibrates, then turns both ways in all three commutations.
fn spins(board: &str) {
    let mut session = calibrated(board);
    for commutation in ["field-oriented", "sinusoidal", "block"] {
        ask(&mut session, &format!("commutate {commutation}"));
        arm(&mut session);
        for speed in [40.0, -40.0] {
            ask(&mut session, &format!("speed {speed}"));
            run(&mut session, 0.8);
            let found = motor(&session, "speed / rad/s");
            assert!((found - speed).abs() < 4.0, "{commutation}: {found} instead of {speed}: {:#?}", session.lines);
        }
        ask(&mut session, "disarm");
        run(&mut session, 1.0);
    }
    let outcome = Outcome::of(&session);
    assert_eq!(outcome.verdict(), Vec::<String>::new());
    assert_eq!(outcome.resets, []);
    for leg in &outcome.facts.legs {
        assert!(leg.dead_time_rising_ns.min > 400.0 && leg.dead_time_falling_ns.min > 400.0, "{leg:?}");
    }
}

/// At a bus voltage with which it just runs.
fn turns_at_the_lowest_voltage(name: &str) {
    let mut session = calibrated(name);
    let volts = board(name).promises.bus_v[0] + 0.5;
    perform(&mut session, &format!("bus {volts}V"));
    run(&mut session, 0.05);
    arm(&mut session);
    for speed in [100.0, -100.0] {
        ask(&mut session, &format!("speed {speed}"));
        run(&mut session, 0.8);
        let found = motor(&session, "speed / rad/s");
        assert!((found - speed).abs() < 4.0, "{found} instead of {speed}: {:#?}", session.lines);
    }
    assert_eq!(Outcome::of(&session).verdict(), Vec::<String>::new());
}

fn main() {
    support::on_every_board(&[
        ("boots", boots),
        ("calibrates_and_spins", spins),
        ("turns_at_the_lowest_voltage", turns_at_the_lowest_voltage),
        ("turns_beyond_its_supply", weakening::turns_beyond_its_supply),
        ("turns_beyond_what_three_currents_allow", weakening::turns_beyond_what_three_currents_allow),
        ("every_fault_switches_it_off", faults::switch_off),
        ("garbage_does_not_disturb_it", line::hears_through_garbage),
        ("disarm_acts_whatever_the_tasks_do", disarm::acts_whatever_the_tasks_do),
        ("disarm_breaks_a_calibration_off", disarm::breaks_a_calibration_off),
        ("disarm_is_the_last_word", disarm::nothing_from_before_it_arms),
        ("disarm_is_a_whole_frame", disarm::garbage_does_not_disarm),
        ("it_is_off_by_wire", enable::off_by_wire),
        ("without_enable_it_refuses", enable::refuses_without),
        ("its_brake_resistor_is_on_while_the_bus_is_too_high", brake::is_on_while_the_bus_is_too_high),
        ("its_brake_resistor_is_on_no_longer_than_it_stands", brake::is_on_for_no_longer_than_it_stands),
        ("its_brake_resistor_is_off_where_the_control_stops", brake::is_off_where_the_control_stops),
        ("power_cuts_leave_its_calibration_intact", power::calibration_survives),
        ("power_cuts_leave_its_settings_intact", power::settings_survive),
        ("its_watchdog_bites_where_something_hangs", watchdog::bites_where_something_hangs),
        ("it_is_off_within_a_millisecond_when_the_control_stops", watchdog::switches_off_where_the_control_stops),
        ("its_watchdogs_are_fed_in_time", watchdog::is_fed_in_time),
    ]);
}
