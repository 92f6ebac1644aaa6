//! Small firmwares, each of them on a board with either chip: one for each peripheral, and a motor's, right and with
//! one mistake. They are wired for these two boards (`firmwares/chip/src/board.rs`).

use bus::ResetCause;
use chip::Board;
use plant::PlantParameters;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, OnceLock};
use virtual_board::{firmware, outcome::Outcome, session::Session};

/// Builds all of them, once.
fn elf(name: &str) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmwares/chip");
        let one = firmware::executable(&sources, &["build", "--release"], "motor").expect("the firmwares build");
        one.parent().expect("a folder").into()
    });
    folder.join(name)
}

fn boards() -> [Arc<Board>; 2] {
    ["nucleo-g474re-ihm08m1", "b-g431b-esc1"].map(|name| firmware::board(name).expect("a board"))
}

fn session(board: &Arc<Board>, name: &str) -> Session {
    let image = std::fs::read(elf(name)).expect("a built firmware");
    Session::new(board, image, &PlantParameters::imperfect(1), 1).expect("a session")
}

fn messages(session: &Session) -> Vec<&str> {
    session.lines.iter().map(|line| line.message.as_str()).collect()
}

/// Runs a firmware to its end; it has asserted what it can see, and this returns what the report finds wrong.
fn run(session: &mut Session, seconds: f64) -> Vec<String> {
    session.run_until(seconds).expect("a run");
    assert_eq!(messages(session).last(), Some(&"done"), "{:#?}", session.lines);
    Outcome::of(session).verdict()
}

/// Whatever this firmware does is right, on both boards.
fn right(name: &str, seconds: f64, see: impl Fn(&Session)) {
    for board in &boards() {
        let mut session = session(board, name);
        assert_eq!(run(&mut session, seconds), [""; 0], "{}", board.name);
        see(&session);
    }
}

/// The firmware does one thing wrong at its end, which is all that the report names.
fn one_wrong(name: &str, seconds: f64, named: &str) {
    for board in &boards() {
        let wrong = run(&mut session(board, name), seconds);
        assert!(matches!(&wrong[..], [only] if only.starts_with(named)), "{}: {wrong:#?}", board.name);
    }
}

/// Last value of a column of the motor's trace, and its mean over a time.
fn motor(session: &Session, name: &str, over_s: f64) -> (f64, f64) {
    let column = session.trace.names.iter().position(|known| known == name).expect("a column");
    let since_s = session.seconds() - over_s;
    let values: Vec<_> = session.trace.rows.iter().filter(|row| row[0] > since_s).map(|row| row[column]).collect();
    (*values.last().expect("a row"), values.iter().sum::<f64>() / values.len() as f64)
}

#[test]
fn the_right_motor_firmware_turns_the_motor_and_nothing_is_found() {
    for board in &boards() {
        let mut session = session(board, "motor");
        session.run_until(1.2).expect("a run");
        let outcome = Outcome::of(&session);
        assert_eq!(outcome.verdict(), [""; 0]);
        assert_eq!(messages(&session).last(), Some(&"9 turns of the field, 9 of the Hall"));
        // Ten turns of the field a second, four pole pairs; twice around in a fifth of a second.
        let (_, speed) = motor(&session, "speed / rad/s", 0.2);
        assert!((speed / (core::f64::consts::TAU * 10.0 / 4.0) - 1.0).abs() < 0.01, "{speed}");
        for leg in &outcome.facts.legs {
            for dead_ns in [leg.dead_time_rising_ns, leg.dead_time_falling_ns] {
                assert!((dead_ns.min - 500.0).abs() < 1e-3 && (dead_ns.max - 500.0).abs() < 1e-3, "{dead_ns:?}");
            }
        }
        let control = outcome.control.expect("a control interrupt");
        assert!((control.rate_hz / 40e3 - 1.0).abs() < 1e-3, "{}", control.rate_hz);
    }
}

/// What `cargo virtual BOARD --elf FIRMWARE` ends with: its exit code, and what it finds wrong.
fn command(board: &Board, name: &str) -> (Option<i32>, Vec<String>) {
    let output = Command::new(env!("CARGO_BIN_EXE_virtual"))
        .args([&board.name, "--seconds", "0.05", "--elf"])
        .arg(elf(name))
        .output()
        .expect("the command starts");
    let text = String::from_utf8(output.stdout).expect("text");
    let wrong = text.lines().skip_while(|line| *line != "Wrong").skip(2).take_while(|line| !line.is_empty());
    (output.status.code(), wrong.map(|line| line.trim().into()).collect())
}

#[test]
fn four_wrong_motor_firmwares_are_reported_by_name() {
    for board in &boards() {
        assert_eq!(command(board, "motor"), (Some(0), Vec::new()));
        for (name, told) in [
            ("motor_no_dead_time", "dead time: leg U has less than 100 ns"),
            ("motor_moe_first", "idle states: MOE is set while OSSI is clear"),
            ("motor_wrong_function", "alternate function: P"),
            ("motor_adc_unclocked", "ADC12 is not clocked: write to 0x50000308"),
        ] {
            let (code, wrong) = command(board, name);
            assert_eq!(code, Some(1), "{}, {name}", board.name);
            assert!(wrong[0].starts_with(told), "{}, {name}: {wrong:#?}", board.name);
            assert!(name != "motor_adc_unclocked" || wrong[0].contains("converter.rs:"), "{}", wrong[0]);
            // One mistake, and nothing else but what follows from it.
            let kind = told.split(':').next().unwrap_or_default();
            let follows = |line: &String| line.starts_with(kind) || line.starts_with("shoot-through at");
            assert!(wrong.iter().all(follows), "{}, {name}: {wrong:#?}", board.name);
        }
    }
}

#[test]
fn only_without_dead_time_there_is_shoot_through() {
    for board in &boards() {
        for name in ["motor_no_dead_time", "motor_moe_first", "motor_wrong_function"] {
            let mut session = session(board, name);
            session.run_until(0.02).expect("a run");
            let events = session.machine.system.facts().legs.map(|leg| leg.shoot_through);
            // The L6398 has a dead time of its own, the L6387 has not.
            let expected = name == "motor_no_dead_time" && board.driver.own_dead_time_s == 0.0;
            assert_eq!(events.map(|count| count > 0), [expected; 3], "{}, {name}", board.name);
        }
    }
}

#[test]
fn rcc() {
    right("rcc", 0.25, |session| {
        let at_s: Vec<_> = session.lines.iter().map(|line| line.at_ns as f64 * 1e-9).collect();
        // Looked at every 100 us.
        for [begin, end] in [[0, 1], [2, 3]] {
            assert!((at_s[end] - at_s[begin] - 0.1).abs() < 0.25e-3, "{at_s:?}");
        }
        let facts = session.machine.system.facts();
        let clock = |name: &str| facts.clocks.iter().find(|clock| clock.name == name).expect("a clock").hz;
        assert_eq!([clock("HCLK"), clock("PCLK1"), clock("APB1 timers")], [170e6, 42.5e6, 85e6]);
    });
}

#[test]
fn gpio() {
    one_wrong("gpio", 0.01, "GPIOB: the configuration of a locked pin is written");
}

#[test]
fn tim1() {
    for board in &boards() {
        let mut session = session(board, "tim1");
        for (line, ticks) in [20, 127, 130, 254, 256, 504, 512, 1008].into_iter().enumerate() {
            while session.lines.len() <= line {
                session.slice(1.0).expect("a run");
            }
            for leg in session.machine.system.facts().legs {
                for range in [leg.dead_time_rising_ns, leg.dead_time_falling_ns] {
                    let expected_ns = f64::from(ticks) / 0.17;
                    assert!((range.max - expected_ns).abs() < 1e-3, "{}, {ticks}: {range:?}", board.name);
                }
            }
        }
        assert_eq!(run(&mut session, 0.02), [""; 0]);
        let facts = session.machine.system.facts();
        assert_eq!(facts.moe.iter().map(|edge| edge.on).collect::<Vec<_>>(), [true, false]);
        assert!((facts.pwm.expect("a PWM").hz - 20e3).abs() < 1e-6);
    }
}

#[test]
fn adc() {
    right("adc", 0.01, |session| {
        let sampling = session.machine.system.facts().sampling;
        assert_eq!(sampling.len(), 4, "{sampling:?}");
        for rank in [1, 2] {
            let of = |adc| sampling.iter().find(|one| one.adc == adc && one.rank == rank).expect("a conversion");
            let (first, second) = (of("ADC1"), of("ADC2"));
            assert_eq!(first.held_ns, second.held_ns);
            assert!(first.signal.starts_with("bus voltage") && first.trigger == "TIM1_TRGO2", "{first:?}");
        }
        let divider = if session.board().name.starts_with("nucleo") { 9.31 / 178.31 } else { 18.0 / 187.0 };
        let (bus_v, _) = motor(session, "bus / V", 0.001);
        let code = (bus_v * divider / 3.3 * 4096.0).round();
        let told = number_after(&session.lines[0].message, "bus");
        assert!((told - code).abs() <= 3.0, "{told} instead of {code}");
    });
}

fn number_after(message: &str, word: &str) -> f64 {
    let mut words = message.split(' ').skip_while(|found| *found != word).skip(1);
    words.next().and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{message}"))
}

#[test]
fn comparator_dac_and_opamp() {
    right("analog", 0.01, |session| {
        // The bus' divider at 24 V, or 128.6 mV of a shunt without current.
        let volts = if session.board().name.starts_with("nucleo") { 24.0 * 9.31 / 178.31 } else { 0.1286 };
        for (line, word) in session.lines.iter().zip(["comparator", "op-amp"]) {
            let code = number_after(&line.message, word);
            assert!((code - volts / 3.3 * 4096.0).abs() < 4.0, "{word}: {code}, {volts} V");
        }
    });
}

#[test]
fn usart() {
    for board in &boards() {
        let mut session = session(board, "usart");
        session.run_until(0.01).expect("a run");
        session.receive(b"HAL".to_vec()).expect("a port");
        let mut sent = Vec::new();
        while session.seconds() < 0.02 {
            sent.extend(session.slice(0.02).expect("a run"));
        }
        assert_eq!(sent, b"IBM");
        assert_eq!(Outcome::of(&session).verdict(), [""; 0]);
    }
}

#[test]
fn iwdg() {
    right("iwdg", 0.6, |session| {
        assert_eq!(messages(session), ["hungry", "done", "Watchdog", "bitten", "done"]);
        let [(at_s, ResetCause::Watchdog)] = session.resets[..] else { panic!("{:?}", session.resets) };
        // Fed for the last time at 320 ms.
        assert!((at_s - 0.42).abs() < 1e-3, "{at_s}");
    });
}

#[test]
fn flash() {
    one_wrong("flash", 0.03, "FLASH: a double word is programmed that is not erased: PROGERR");
}

#[test]
fn tim3() {
    right("tim3", 0.08, |_| {});
}
