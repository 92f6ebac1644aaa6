//! Boards with their firmwares, and what is asked of them.

// Each test uses what it needs.
#![allow(dead_code)]

pub mod rate;

use chip::{Board, Chip};
use cortex::Machine;
use hallservo_protocol::{Ask, FRAME, Request, encode};
use libtest_mimic::{Arguments, Trial};
use plant::PlantParameters;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};
use virtual_board::{firmware, script, session::Session};

pub const NUCLEO: &str = "nucleo-g474re-ihm08m1";
pub const ESC: &str = "b-g431b-esc1";
/// With the firmware that speaks on a bus.
pub const ESC_ON_BUS: &str = "b-g431b-esc1 --bus";

/// Something that is made once for each board, on whichever test comes first.
struct PerBoard<T>(Mutex<BTreeMap<String, Arc<OnceLock<T>>>>);

impl<T: Clone> PerBoard<T> {
    const fn new() -> Self {
        PerBoard(Mutex::new(BTreeMap::new()))
    }

    fn get(&self, board: &str, make: impl FnOnce() -> T) -> T {
        let place = Arc::clone(self.0.lock().expect("no panic").entry(board.into()).or_default());
        place.get_or_init(make).clone()
    }
}

/// A test's name, and the test of a board.
type Test = (&'static str, fn(&str));
/// … and whether a board is meant.
type TestOfSome = (&'static str, fn(&str), fn(&str) -> bool);

/// Runs every test on every board that there is, as the standard harness would; `cargo test … NAME` chooses by test or
/// board.
pub fn on_every_board(tests: &[Test]) {
    on_boards(&tests.iter().map(|&(name, test)| -> TestOfSome { (name, test, |_| true) }).collect::<Vec<_>>());
}

/// The same on the boards that are meant.
pub fn on_boards(tests: &[TestOfSome]) {
    let boards = Board::names(&firmware::boards()).expect("the boards' folder");
    let trials = boards.iter().flat_map(|board| {
        tests.iter().filter(|(.., is_meant)| is_meant(board)).map(move |&(name, test, _)| {
            let of = board.clone();
            Trial::test(format!("{board}::{name}"), move || {
                test(&of);
                Ok(())
            })
        })
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit();
}

pub fn board(name: &str) -> Arc<Board> {
    firmware::board(name.trim_end_matches(" --bus")).expect("a board")
}

fn elf(board: &str) -> Vec<u8> {
    static BUILT: PerBoard<Vec<u8>> = PerBoard::new();
    let for_bus = board.ends_with(" --bus");
    let build = || if for_bus { firmware::build_for_bus(&self::board(board)) } else { firmware::build(board) };
    BUILT.get(board, || std::fs::read(build().expect("the firmware builds")).expect("it is there"))
}

pub fn session(board: &str, script: &str) -> Session {
    session_with(board, &PlantParameters::imperfect(1), script)
}

/// … with another motor.
pub fn session_with(board: &str, motor: &PlantParameters, script: &str) -> Session {
    let known = self::board(board);
    let mut session = Session::new(&known, elf(board), motor, 1).expect("a session");
    session.follow(script::parse(script).expect("a script"));
    session
}

pub fn says(session: &Session, text: &str) -> bool {
    session.lines.iter().any(|line| line.message.contains(text))
}

/// Runs until the status has such a text, and returns it. Not every board has the flash for a log.
pub fn until(session: &mut Session, text: &str, at_most_s: f64) -> String {
    loop {
        let status = ask(session, "status");
        if status.contains(text) {
            return status;
        }
        assert!(session.seconds() < at_most_s, "no {text:?} until {at_most_s} s: {status}, {:#?}", session.lines);
        run(session, 0.01);
    }
}

pub fn run(session: &mut Session, seconds: f64) {
    session.run_until(session.seconds() + seconds).expect("a run");
}

/// A board shortly before its calibration is complete, and when it is over: saved, the rotor at rest. It does so once
/// for all tests.
fn calibration(board: &str) -> [Machine<Chip>; 2] {
    static DONE: PerBoard<[Machine<Chip>; 2]> = PerBoard::new();
    DONE.get(board, || {
        let mut session = session(board, "at 30ms send calibrate");
        let mut before = session.machine.clone();
        while session.machine.system.facts().flash_operations == 0 {
            before = session.machine.clone();
            run(&mut session, 0.1);
            assert!(session.seconds() < 8.0, "{:#?}", session.lines);
        }
        let status = until(&mut session, "activity: None", 12.0);
        assert!(status.contains("calibrated: true") && status.contains("stored: [None, "), "{status}");
        [before, session.machine]
    })
}

fn resumed(board: &str, machine: Machine<Chip>) -> Session {
    let mut session = session(board, "");
    session.machine = machine;
    session
}

/// A board that is about to save its calibration, for the first time.
pub fn calibrating(board: &str) -> Session {
    let [before, _] = calibration(board);
    resumed(board, before)
}

/// A board that has calibrated, and whose commands need no repetition.
pub fn calibrated(board: &str) -> Session {
    let [_, after] = calibration(board);
    let mut session = resumed(board, after);
    ask(&mut session, "set command_timeout_s 60");
    session
}

/// Longest check at arming, s.
pub const CHECKED_S: f64 = 1.0;

/// Arms, and waits for the check.
pub fn arm(session: &mut Session) {
    ask(session, "arm");
    run(session, CHECKED_S);
}

/// … that turns, field-oriented.
pub fn turning(board: &str) -> Session {
    let mut session = calibrated(board);
    arm(&mut session);
    ask(&mut session, "speed 40");
    run(&mut session, 0.7);
    session
}

pub fn perform(session: &mut Session, what: &str) {
    session.follow(script::parse(&format!("at 0s {what}")).expect("a script"));
    session.slice(f64::INFINITY).expect("a run");
}

/// A request as bytes.
pub fn frame(id: u16, ask: Ask<'_>) -> Vec<u8> {
    let mut frame = [0; FRAME];
    let length = encode(&Request { id, client: 1, unattended: true, ask }, &mut frame).expect("a frame");
    frame[..length].to_vec()
}

/// Sends a request; what the drive answers.
pub fn ask(session: &mut Session, what: &str) -> String {
    let before = session.lines.len();
    perform(session, &format!("send {what}"));
    // While a model of the sensors is built, the tasks are late.
    let at_most_s = session.seconds() + 0.5;
    loop {
        // A reset may have cut a frame in two.
        let reply = session.lines[before..].iter().find(|line| line.level == "REPLY" && line.message.starts_with('#'));
        if let Some(reply) = reply {
            return reply.message.clone();
        }
        assert!(session.seconds() < at_most_s, "no reply to {what}: {:#?}", session.lines);
        session.slice(at_most_s).expect("a run");
    }
}

/// Last value of a column of the motor's trace.
pub fn motor(session: &Session, name: &str) -> f64 {
    let column = session.trace.names.iter().position(|known| known == name).expect("a column");
    session.trace.rows.last().expect("a row")[column]
}
