//! The enable input, on the boards that have one: without it nothing is switched on, and what is on goes off at once.
//! That it is a fault then, and latched, is among `faults`.

use crate::support::{CHECKED_S, ask, board, calibrated, motor, perform, run, turning};

/// A control period, and from its trigger to the bridge off.
const OFF_S: f64 = 25e-6 + 15e-6;

pub fn off_by_wire(name: &str) {
    if board(name).enable.is_none() {
        return;
    }
    let mut longest_s = 0.0_f64;
    let turning = turning(name);
    for instant in 0..8 {
        let mut session = turning.fork();
        run(&mut session, f64::from(instant) * 28.1e-6);
        let at_s = session.seconds();
        perform(&mut session, "enable open");
        run(&mut session, 1e-3);
        let off = session.machine.system.facts().moe.last().cloned().expect("an edge");
        assert!(!off.on && off.at_s - at_s < OFF_S, "{name}: {off:?} after {at_s}");
        longest_s = longest_s.max(off.at_s - at_s);
    }
    println!("{name}, enable input open: off after {:.1} µs at most", longest_s * 1e6);
}

pub fn refuses_without(name: &str) {
    if board(name).enable.is_none() {
        return;
    }
    let mut session = calibrated(name);
    let before = session.machine.system.facts().moe.len();
    perform(&mut session, "enable open");
    run(&mut session, 0.01);
    for request in ["arm", "calibrate"] {
        let reply = ask(&mut session, request);
        assert!(reply.contains("Refused(Drive(Fault(Disabled)))"), "{name}, {request}: {reply}");
    }
    assert!(ask(&mut session, "status").contains("mode: Ready"), "{name}: off, and no fault");
    assert_eq!(session.machine.system.facts().moe.len(), before, "{name}");
    perform(&mut session, "enable closed");
    for request in ["arm", "speed 40"] {
        let reply = ask(&mut session, request);
        assert!(reply.contains("Done"), "{name}, {request}: {reply}");
    }
    run(&mut session, CHECKED_S + 0.5);
    let speed = motor(&session, "speed / rad/s");
    assert!((speed - 40.0).abs() < 4.0, "{name}: {speed}");
}
