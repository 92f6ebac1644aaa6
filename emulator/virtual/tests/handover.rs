//! The B-G431B-ESC1 is set up with one of its firmwares, then flashed with the other, and back: what is stored is taken
//! over, and nothing moves by itself.

mod common;

use bus::Bus as _;
use common::{ESC, ESC_ON_BUS, ask, calibrated, motor, run, session, until};
use virtual_board::session::Session;

/// Where the records begin, from the begin of the flash: what is flashed ends before it.
const RECORDS: usize = 124 << 10;

/// Another firmware onto the same flash, and on.
fn flashed(before: &Session, firmware: &str) -> Session {
    let mut after = session(firmware, "");
    after.machine.system.load(RECORDS, &before.machine.system.code()[RECORDS..]);
    run(&mut after, 0.2);
    after
}

/// Sets two settings, one of them of the bus, and saves.
fn save(session: &mut Session, speed: u32, id: u32) {
    for request in [format!("set max_speed_rad_s {speed}"), format!("set bus_id {id}")] {
        assert!(ask(session, &request).contains("Setting("), "{request}");
    }
    ask(session, "save");
    until(session, "unsaved: false", session.seconds() + 1.0);
}

/// Everything is known, the bridge was never on; then it turns when it is told to.
fn takes_over(session: &mut Session, speed: u32, id: u32) {
    let status = ask(session, "status");
    assert!(status.contains("calibrated: true") && status.contains("mode: Ready"), "{status}");
    assert!(status.contains("stored: [None, ") && status.contains("unsaved: false"), "{status}");
    for (name, value) in [("max_speed_rad_s", speed), ("bus_id", id)] {
        let answer = ask(session, &format!("get {name}"));
        assert!(answer.contains(&format!(" value: {value}.0,")), "{answer}");
    }
    run(session, 1.0);
    assert_eq!(session.machine.system.facts().moe, [], "nobody has asked for anything");
    assert!(motor(session, "speed / rad/s").abs() < 1.0);
    assert!(ask(session, "arm").contains("Done"));
    ask(session, "speed 40");
    run(session, 1.5);
    let found = motor(session, "speed / rad/s");
    assert!((found - 40.0).abs() < 4.0, "{found}");
    ask(session, "disarm");
    run(session, 2.0);
}

#[test]
fn each_firmware_takes_over_what_the_other_has_stored() {
    let mut set_up = calibrated(ESC);
    save(&mut set_up, 123, 7);
    let mut on_bus = flashed(&set_up, ESC_ON_BUS);
    takes_over(&mut on_bus, 123, 7);
    save(&mut on_bus, 124, 9);
    let mut back = flashed(&on_bus, ESC);
    takes_over(&mut back, 124, 9);
}

/// The last page is half written, the one before erased: words, and no motion.
#[test]
fn what_is_damaged_is_told_and_moves_nothing() {
    let mut set_up = calibrated(ESC);
    save(&mut set_up, 123, 7);
    let mut damaged = session(ESC_ON_BUS, "");
    let mut records = set_up.machine.system.code()[RECORDS..].to_vec();
    for byte in records.iter_mut().filter(|byte| **byte != 0xff).skip(40).step_by(97) {
        *byte ^= 0x10;
    }
    damaged.machine.system.load(RECORDS, &records);
    run(&mut damaged, 0.2);
    let status = ask(&mut damaged, "status");
    assert!(status.contains("calibrated: false") && !status.contains("stored: [None, "), "{status}");
    assert!(ask(&mut damaged, "arm").contains("Refused"), "{status}");
    run(&mut damaged, 0.5);
    assert_eq!(damaged.machine.system.facts().moe, []);
}
