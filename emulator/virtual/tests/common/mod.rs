//! The firmwares as they would be flashed, on their boards.

// Each test uses what it needs.
#![allow(dead_code)]

use chip::Board;
use plant::PlantParameters;
use std::sync::OnceLock;
use virtual_board::{firmware, script, session::Session};

/// The reference board.
pub const NUCLEO: &str = "nucleo-g474re-ihm08m1";
/// The small one.
pub const ESC: &str = "b-g431b-esc1";

fn elf(board: &str) -> Vec<u8> {
    static BUILT: [OnceLock<Vec<u8>>; 2] = [const { OnceLock::new() }; 2];
    let build = || std::fs::read(firmware::build(board).expect("the firmware builds")).expect("it is there");
    BUILT[usize::from(board == ESC)].get_or_init(build).clone()
}

/// A board at power-on, with a script.
pub fn session(board: &str, script: &str) -> Session {
    let known = Board::named(board).expect("a board");
    let mut session = Session::new(known, elf(board), &PlantParameters::unkind(1), 1).expect("a session");
    session.follow(script::parse(script).expect("a script"));
    session
}

/// Whether a line with this text was logged.
pub fn says(session: &Session, text: &str) -> bool {
    session.lines.iter().any(|line| line.message.contains(text))
}

/// Runs until a line with this text is logged.
pub fn until(session: &mut Session, text: &str, at_most_s: f64) {
    while !says(session, text) {
        assert!(session.seconds() < at_most_s, "no {text:?} until {at_most_s} s: {:#?}", session.lines);
        session.slice(at_most_s).expect("a run");
    }
}

/// A board that has calibrated, with its bridge off.
pub fn calibrated(board: &str) -> Session {
    let mut session = session(board, "at 30ms send calibrate");
    until(&mut session, "calibrated", 8.0);
    until(&mut session, "Ready after", 8.2);
    session.run_until(session.seconds() + 0.05).expect("a run");
    session
}

/// Sends a request and waits for its reply.
pub fn ask(session: &mut Session, what: &str) {
    let at_us = (session.seconds() * 1e6).ceil();
    session.follow(script::parse(&format!("at {at_us}us send {what}")).expect("a request"));
    // The longest reply takes 5.5 ms at the line's rate.
    session.run_until(session.seconds() + 8e-3).expect("a run");
}
