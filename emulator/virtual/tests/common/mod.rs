//! Boards with their firmwares, and what is asked of them.

// Each test uses what it needs.
#![allow(dead_code)]

use chip::{Board, Chip};
use cortex::Machine;
use plant::PlantParameters;
use std::sync::{Mutex, OnceLock};
use virtual_board::{firmware, script, session::Session};

pub const NUCLEO: &str = "nucleo-g474re-ihm08m1";
pub const ESC: &str = "b-g431b-esc1";

fn elf(board: &str) -> Vec<u8> {
    static BUILT: [OnceLock<Vec<u8>>; 2] = [const { OnceLock::new() }; 2];
    let build = || std::fs::read(firmware::build(board).expect("the firmware builds")).expect("it is there");
    BUILT[usize::from(board == ESC)].get_or_init(build).clone()
}

pub fn session(board: &str, script: &str) -> Session {
    let known = Board::named(board).expect("a board");
    let mut session = Session::new(known, elf(board), &PlantParameters::unkind(1), 1).expect("a session");
    session.follow(script::parse(script).expect("a script"));
    session
}

pub fn says(session: &Session, text: &str) -> bool {
    session.lines.iter().any(|line| line.message.contains(text))
}

pub fn until(session: &mut Session, text: &str, at_most_s: f64) {
    while !says(session, text) {
        assert!(session.seconds() < at_most_s, "no {text:?} until {at_most_s} s: {:#?}", session.lines);
        session.slice(at_most_s).expect("a run");
    }
}

pub fn run(session: &mut Session, seconds: f64) {
    session.run_until(session.seconds() + seconds).expect("a run");
}

/// A board that has calibrated and saved what it found, with its bridge off. It does so once for all tests.
pub fn calibrated(board: &str) -> Session {
    static DONE: [Mutex<Option<Machine<Chip>>>; 2] = [const { Mutex::new(None) }; 2];
    let mut done = DONE[usize::from(board == ESC)].lock().expect("the board calibrates");
    if let Some(machine) = &*done {
        let mut session = session(board, "");
        session.machine = machine.clone();
        return session;
    }
    let mut session = session(board, "at 30ms send calibrate");
    until(&mut session, "record 0 saved", 8.0);
    run(&mut session, 0.05);
    *done = Some(session.machine.clone());
    session
}

/// … that turns, field-oriented.
pub fn turning(board: &str) -> Session {
    let mut session = calibrated(board);
    ask(&mut session, "arm");
    ask(&mut session, "speed 40");
    run(&mut session, 0.25);
    session
}

pub fn perform(session: &mut Session, what: &str) {
    session.follow(script::parse(&format!("at 0s {what}")).expect("a script"));
    session.slice(f64::INFINITY).expect("a run");
}

/// Sends a request; what the drive answers.
pub fn ask(session: &mut Session, what: &str) -> String {
    let before = session.lines.len();
    perform(session, &format!("send {what}"));
    // The longest reply takes 5.5 ms at the line's rate.
    run(session, 8e-3);
    let reply = session.lines[before..].iter().find(|line| line.level == "REPLY");
    reply.map_or_else(String::new, |line| line.message.clone())
}

/// Last value of a column of the motor's trace.
pub fn motor(session: &Session, name: &str) -> f64 {
    let column = session.trace.names.iter().position(|known| known == name).expect("a column");
    session.trace.rows.last().expect("a row")[column]
}
