//! Power that goes at every flash operation of a save.

use crate::support::{ask, calibrated, calibrating, perform, run, until};
use bus::ResetCause;
use chip::Disturbance;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

/// Exception that a read of a half-written double word raises.
const NMI: u16 = 2;

/// What is asked of a board that saves then, and what its status says when it has.
#[derive(Clone, Copy)]
struct Save<'a> {
    prepared: &'a Session,
    request: Option<&'static str>,
    saved: &'static str,
}

impl Save<'_> {
    fn begun(&self, cut_after: Option<u64>) -> Session {
        let mut session = self.prepared.fork();
        let now = session.machine.now();
        if let Some(operations) = cut_after {
            session.machine.system.disturb(&Disturbance::PowerCut(operations), now).expect("a power cut");
        }
        if let Some(request) = self.request {
            perform(&mut session, request);
        }
        session
    }

    /// Flash operations that it takes.
    fn operations(&self) -> u64 {
        let mut session = self.begun(None);
        until(&mut session, self.saved, self.prepared.seconds() + 0.7);
        session.machine.system.facts().flash_operations - self.prepared.machine.system.facts().flash_operations
    }

    /// The board, on again after the power was cut in the midst of an operation.
    fn cut(&self, operation: u64) -> Session {
        let mut session = self.begun(Some(operation));
        let at_most_s = session.seconds() + 0.7;
        while session.resets.is_empty() && session.seconds() < at_most_s {
            session.slice(at_most_s).expect("a run");
        }
        run(&mut session, 0.1);
        assert!(matches!(session.resets[..], [(_, ResetCause::PowerOn)]), "{operation}: {:?}", session.resets);
        assert_eq!(Outcome::of(&session).faults, [""; 0], "{operation}");
        session
    }
}

/// The first calibration: until it is saved as a whole there is none, and nothing to be afraid of.
pub fn calibration_survives(board: &str) {
    let prepared = calibrating(board);
    let save = Save { prepared: &prepared, request: None, saved: "stored: [None, " };
    let mut torn = 0;
    for operation in 0..save.operations() {
        let mut session = save.cut(operation);
        let status = ask(&mut session, "status");
        assert!(status.contains("calibrated: false"), "{board}, {operation}: {status}");
        assert!(status.contains("stored: [Blank, Blank, Blank]"), "{board}, {operation}: {status}");
        torn += u32::from(session.machine.profile().activities().contains_key(&NMI));
    }
    println!("{board}: cut at {} operations, {torn} times a torn word was read", save.operations());
    assert!(torn > 10, "{board}: {torn}");
}

/// The setting is the first value or the second, never anything else, and the second from one operation on.
fn setting_survives(board: &str, prepared: &Session, values: [&str; 2], before: &str) {
    let save = Save { prepared, request: Some("send save"), saved: "unsaved: false" };
    let mut found = Vec::new();
    for operation in 0..save.operations() {
        let mut session = save.cut(operation);
        let status = ask(&mut session, "status");
        assert!(status.contains("calibrated: true"), "{board}, {operation}: {status}");
        let reply = ask(&mut session, "get max_speed_rad_s");
        let value = values.iter().position(|value| reply.contains(&format!(" value: {value},")));
        let value = value.unwrap_or_else(|| panic!("{board}, {operation}: {reply}"));
        let stored = format!("stored: [None, Blank, {}]", [before, "None"][value]);
        assert!(status.contains(&stored), "{board}, {operation}: {status}");
        found.push(value);
    }
    println!("{board}: {before} before, found after a cut at each operation: {found:?}");
    assert!(found.len() > 2 && found.is_sorted() && found[0] == 0, "{board}: {found:?}");
}

/// Nothing is stored, then the old settings or the new ones; and the calibration is still there.
pub fn settings_survive(board: &str) {
    let mut prepared = calibrated(board);
    let default = ask(&mut prepared, "get max_speed_rad_s");
    let default = default.split_once(" value: ").and_then(|(_, rest)| rest.split_once(',')).expect("a value").0;
    ask(&mut prepared, "set max_speed_rad_s 111");
    setting_survives(board, &prepared, [default, "111.0"], "Blank");
    ask(&mut prepared, "save");
    run(&mut prepared, 0.1);
    ask(&mut prepared, "set max_speed_rad_s 123");
    setting_survives(board, &prepared, ["111.0", "123.0"], "None");
}
