//! Power that goes at every flash operation of a save.

use crate::support::{ESC, NUCLEO, ask, calibrated, run, says, until};
use bus::{Disturbance, ResetCause, System};
use virtual_board::session::Session;

/// Flash operations until the log says `done`, beginning with `request`.
fn operations(prepared: &Session, request: &str, done: &str) -> u64 {
    let mut whole = prepared.fork();
    ask(&mut whole, request);
    let at_most_s = whole.seconds() + 0.5;
    until(&mut whole, done, at_most_s);
    whole.machine.system.facts().flash_operations - prepared.machine.system.facts().flash_operations
}

/// The same with the power cut in the midst of an operation, and the board on again.
fn cut(prepared: &Session, operation: u64, request: &str) -> Session {
    let mut session = prepared.fork();
    let now = session.machine.now();
    session.machine.system.disturb(&Disturbance::PowerCut(operation), now).expect("a power cut");
    ask(&mut session, request);
    run(&mut session, 0.15);
    assert!(matches!(session.resets[..], [(_, ResetCause::PowerOn)]), "{operation}: {:?}", session.resets);
    session
}

/// The setting is the first value or the second, never anything else, and the second from one operation on.
fn intact(board: &str, prepared: &Session, done: &str, values: [&str; 2], stored: &str) {
    let operations = operations(prepared, "save", done);
    assert!(operations > 2, "{operations}");
    let mut found = Vec::new();
    for operation in 0..operations {
        let mut session = cut(prepared, operation, "save");
        let status = ask(&mut session, "status");
        assert!(status.contains("calibrated: true"), "{board}, {operation}: {:#?}", session.lines);
        assert!(!says(&session, "cannot be used"), "{board}, {operation}: {:#?}", session.lines);
        let reply = ask(&mut session, "get max_speed_rad_s");
        let value = values.iter().position(|value| reply.contains(&format!(" value: {value},")));
        let value = value.unwrap_or_else(|| panic!("{board}, {operation}: {reply}"));
        let expected = ["stored: [None, Blank, ", ["None", stored][usize::from(value == 0)], "]"].concat();
        assert!(status.contains(&expected), "{board}, {operation}: {status}");
        found.push(value);
    }
    println!(
        "{board}: {operations} operations, the new value from cut {} on",
        found.iter().filter(|new| **new == 0).count()
    );
    assert!(found.is_sorted() && found[0] == 0, "{board}: {found:?}");
}

/// Before anything was stored, a save that is cut leaves nothing stored, and nothing to be afraid of; later, the old or the new.
fn settings_survive(board: &str) {
    let mut prepared = calibrated(board);
    ask(&mut prepared, "set max_speed_rad_s 111");
    let default = ask(&mut calibrated(board), "get max_speed_rad_s");
    let default = default.split_once(" value: ").and_then(|(_, rest)| rest.split_once(',')).expect("a value").0;
    intact(board, &prepared, "record 2 saved", [default, "111.0"], "Blank");
    ask(&mut prepared, "save");
    until(&mut prepared, "record 2 saved", 10.0);
    ask(&mut prepared, "set max_speed_rad_s 123");
    intact(board, &prepared, "record 2 saved", ["111.0", "123.0"], "None");
}

#[test]
fn power_cuts_leave_the_settings_of_the_nucleo_intact() {
    settings_survive(NUCLEO);
}

#[test]
fn power_cuts_leave_the_settings_of_the_esc_intact() {
    settings_survive(ESC);
}
