//! The brake resistor, on the boards that have a pin for it: on and off in time, whether the bridge is on or not, no
//! longer than it stands, and off where nothing decides any more.

use crate::support::{arm, ask, board, calibrated, motor, perform, run};
use crate::watchdog::{OFF_S, STOPS};
use virtual_board::session::Session;

const CHOPPER_V: f64 = 30.0;
/// How long it may be on in one go, s.
const ON_S: f64 = 0.05;
/// It is decided in every eighth period, by its sample; conversion and interrupt come to it, and the capacitor, which the
/// supply charges.
const REACTION_S: f64 = 9.0 * 25e-6 + 20e-6 + 30e-6;

/// A board that knows of its resistor.
fn told(name: &str) -> Session {
    let mut session = calibrated(name);
    for set in [format!("chopper_v {CHOPPER_V}"), format!("chopper_on_s {ON_S}"), "chopper_share 0.1".into()] {
        let reply = ask(&mut session, &format!("set {set}"));
        assert!(reply.contains("Setting(Setting"), "{set}: {reply}");
    }
    session
}

/// … and turns.
fn turning(name: &str) -> Session {
    let mut session = told(name);
    arm(&mut session);
    ask(&mut session, "speed 40");
    run(&mut session, 0.7);
    session
}

/// Changes the supply's voltage; when the resistor was switched since, s, and which way.
fn switched(session: &mut Session, supply: &str, seconds: f64) -> Vec<(f64, bool)> {
    let (before, at_s) = (session.machine.system.facts().brake.len(), session.seconds());
    perform(session, supply);
    run(session, seconds);
    session.machine.system.facts().brake[before..].iter().map(|(edge_s, on)| (edge_s - at_s, *on)).collect()
}

/// At instants all over the eight periods.
fn follows_the_bus(name: &str, what: &str, session: &Session) {
    let (mut on, mut off) = (0.0_f64, 0.0_f64);
    for instant in 0..12 {
        let mut session = session.fork();
        run(&mut session, f64::from(instant) * 18.7e-6);
        let edges = switched(&mut session, "bus 40V", 0.01);
        let [(on_s, true)] = edges[..] else { panic!("{name}, {what}: {edges:?}") };
        // It draws on the supply.
        let edges = switched(&mut session, "bus 28V", 0.01);
        let [(off_s, false)] = edges[..] else { panic!("{name}, {what}: {edges:?}") };
        (on, off) = (on.max(on_s), off.max(off_s));
        assert!(on < REACTION_S && off < REACTION_S, "{name}, {what}: on after {on} s, off after {off} s");
        assert_eq!(switched(&mut session, "bus 29.5V", 0.01), [], "{name}, {what}");
    }
    println!("{name}, {what}: brake resistor on after {:.0} µs, off after {:.0} µs", on * 1e6, off * 1e6);
}

pub fn is_on_while_the_bus_is_too_high(name: &str) {
    if board(name).brake.is_none() {
        return;
    }
    assert_eq!(switched(&mut calibrated(name), "bus 40V", 0.01), [], "{name}: without the setting");
    follows_the_bus(name, "bridge off", &told(name));
    let on = turning(name);
    follows_the_bus(name, "turning", &on);
    let speed = motor(&on, "speed / rad/s");
    assert!((speed - 40.0).abs() < 4.0, "{name}: {speed}");
}

pub fn is_on_for_no_longer_than_it_stands(name: &str) {
    if board(name).brake.is_none() {
        return;
    }
    let mut session = turning(name);
    let edges = switched(&mut session, "bus 40V", 0.2);
    let [(on_s, true), (off_s, false)] = edges[..] else { panic!("{name}: {edges:?}") };
    assert!(((off_s - on_s) / ON_S - 1.0).abs() < 0.05, "{name}: {edges:?}");
    assert!(ask(&mut session, "status").contains("mode: Faulted(BrakeResistor)"), "{name}");
    assert!(!session.machine.system.bridge_is_on(), "{name}");
    ask(&mut session, "clear");
    let refused = ask(&mut session, "arm");
    assert!(refused.contains("BrakeResistor"), "{name}: {refused}");
    // Cold again after nine times as long.
    perform(&mut session, "bus 24V");
    run(&mut session, 9.0 * ON_S);
    let reply = ask(&mut session, "arm");
    assert!(reply.contains("Done"), "{name}: {reply}");
}

pub fn is_off_where_the_control_stops(name: &str) {
    if board(name).brake.is_none() {
        return;
    }
    let turning = turning(name);
    for (what, stop) in STOPS {
        let mut longest_s = 0.0_f64;
        for instant in 0..6 {
            let mut session = turning.fork();
            let edges = switched(&mut session, "bus 40V", 1e-3 + f64::from(instant) * 43.1e-6);
            let [(_, true)] = edges[..] else { panic!("{name}, {what}: {edges:?}") };
            let (at_s, before) = (session.seconds(), session.machine.system.facts().brake.len());
            stop(&mut session);
            run(&mut session, 2.0 * OFF_S);
            let facts = session.machine.system.facts();
            let [(off_s, false)] = facts.brake[before..] else { panic!("{name}, {what}: {:?}", facts.brake) };
            longest_s = longest_s.max(off_s - at_s);
            assert!(longest_s < OFF_S, "{name}, {what}: {longest_s}");
        }
        println!("{name}, {what}: brake resistor off after {:.0} µs at most", longest_s * 1e6);
    }
}
