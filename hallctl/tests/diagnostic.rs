//! The diagnostic channel of register clients at a simulated drive: what moves, what ends it, and what becomes of the
//! settings.

use crate::tool::{ask, ask_as, calibrated, done, drive, run, status};
use hallservo::board::Output;
use hallservo::mode::Mode;
use hallservo::settings::TABLE;
use hallservo_protocol::{Answer, Ask, Refusal};
use simulator::Simulator;
use simulator::flash::Flash;
use std::fmt::Write;
use std::sync::LazyLock;

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

fn ready() -> Simulator {
    let mut drive = drive(Flash::of(FLASH.clone()));
    run(&mut drive, 10);
    drive
}

/// Sends a frame, and gives the bytes of the reply's channel after some milliseconds.
fn frame(drive: &mut Simulator, bytes: &[u8], milliseconds: u32) -> Vec<u8> {
    let mut line = String::from("can send 8001 ");
    bytes.iter().for_each(|byte| write!(line, "{byte:02x}").unwrap());
    drive.read();
    drive.write(line.as_bytes());
    drive.write(b"\n");
    run(drive, milliseconds);
    let said = String::from_utf8_lossy(&drive.read()).into_owned();
    let Some(reply) = said.split("rcv 100 4101").nth(1) else { return Vec::new() };
    let digits: Vec<u8> = reply.bytes().take_while(u8::is_ascii_hexdigit).collect();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    let bytes: Vec<u8> = digits.chunks(2).map(byte).collect();
    bytes[1..=usize::from(bytes[0])].to_vec()
}

/// What comes in some milliseconds, read every so many.
fn poll(drive: &mut Simulator, milliseconds: u32, every: u32) -> String {
    let mut all = Vec::new();
    (0..milliseconds / every).for_each(|_| all.extend(frame(drive, &[0x42, 1, 48], every)));
    String::from_utf8_lossy(&all).into_owned()
}

/// Sends a line, and reads its answer.
fn say(drive: &mut Simulator, line: &str) -> String {
    let bytes = [line.as_bytes(), b"\n"].concat();
    let mut answer = Vec::new();
    for part in bytes.chunks(48) {
        answer.extend(frame(drive, &[&[0x40, 1, part.len() as u8], part].concat(), 3));
    }
    String::from_utf8_lossy(&answer).into_owned() + &poll(drive, 60, 3)
}

/// Turning by a line of text, past the check at arming.
fn turning() -> Simulator {
    let mut drive = ready();
    assert_eq!(say(&mut drive, "d pos nan 2 nan"), "OK\r\n");
    poll(&mut drive, 1000, 20);
    assert_eq!(drive.drive().mode(), Mode::Running);
    drive
}

#[test]
fn a_motion_lasts_as_long_as_the_client_reads() {
    let mut drive = turning();
    // Several times the drive's time-out.
    poll(&mut drive, 3000, 50);
    let turns = drive.plant.truth().speed_rad_s / std::f64::consts::TAU;
    assert!((1.5..2.5).contains(&turns), "{turns}");
    run(&mut drive, 3500);
    let turns = drive.plant.truth().speed_rad_s / std::f64::consts::TAU;
    assert!(turns.abs() < 0.1, "{turns}");
    // Reading again moves nothing.
    poll(&mut drive, 1000, 20);
    let turns = drive.plant.truth().speed_rad_s / std::f64::consts::TAU;
    assert!(turns.abs() < 0.1, "{turns}");
}

#[test]
fn whoever_stops_the_motor_it_stays_off_though_the_client_reads_on() {
    let mut drive = turning();
    ask_as(8, &mut drive, Ask::Disarm, |answer| assert_eq!(answer, Answer::Done));
    for milliseconds in 0..2000 {
        drive.step();
        assert_ne!(drive.drive().mode(), Mode::Running, "{milliseconds} ms after");
        if milliseconds % 20 == 0 {
            frame(&mut drive, &[0x42, 1, 48], 0);
        }
    }

    // By a register, between any two renewals.
    for wait in 0..22 {
        let mut drive = turning();
        run(&mut drive, wait);
        frame(&mut drive, &[0x01, 0x00, 0x00], 5);
        assert_eq!(drive.drive().mode(), Mode::Ready);
        poll(&mut drive, 300, 5);
        assert_eq!(drive.drive().mode(), Mode::Ready, "{wait} ms");
    }

    // By text, and by a fault.
    let mut drive = turning();
    assert_eq!(say(&mut drive, "d stop"), "OK\r\n");
    poll(&mut drive, 300, 5);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    let mut drive = turning();
    drive.plant.set_supply(40.0).unwrap();
    poll(&mut drive, 300, 5);
    drive.plant.set_supply(24.0).unwrap();
    poll(&mut drive, 300, 5);
    assert!(matches!(drive.drive().mode(), Mode::Faulted(_)));
    assert!(say(&mut drive, "d pos nan 2 nan").starts_with("ERR refused"));
}

/// Tasks that fit, save or hang have no time for it, and their turn comes late.
#[test]
fn a_stop_does_not_wait_for_the_tasks() {
    const STOPS: [&str; 3] = ["010000", "0d0000000000", "40010764 2073746f700a"];
    for stop in STOPS.map(|bytes| bytes.replace(' ', "")) {
        let mut drive = turning();
        drive.write(format!("can send 8001 {stop}\n").as_bytes());
        drive.neglect();
        assert_eq!((drive.drive().mode(), *drive.output()), (Mode::Ready, Output::OFF), "{stop}");
        run(&mut drive, 50);
        assert_eq!(drive.drive().mode(), Mode::Ready, "{stop}");
        // Not for ever. The answer to the line is still to be read.
        assert!(say(&mut drive, "d pos nan 2 nan").ends_with("OK\r\n"), "{stop}");
        poll(&mut drive, 500, 20);
        assert_eq!(drive.drive().mode(), Mode::Running, "{stop}");
    }
    // What came before it has its turn after it, and moves nothing; what is for another drive stops nothing.
    let mut drive = ready();
    drive.write(b"can send 8001 01000a\ncan send 8001 010000\n");
    (0..200).for_each(|_| drive.neglect());
    for _ in 0..200 {
        drive.step();
        assert_eq!((drive.drive().mode(), *drive.output()), (Mode::Ready, Output::OFF));
    }
    let mut drive = turning();
    drive.write(b"can send 8002 010000\n");
    (0..5).for_each(|_| drive.neglect());
    assert_eq!(drive.drive().mode(), Mode::Running);
}

#[test]
fn bandwidths_change_while_the_motor_turns() {
    let mut drive = turning();
    for (name, value) in
        [("speed_bandwidth_hz", "60"), ("current_bandwidth_hz", "900"), ("tracking_bandwidth_hz", "45")]
    {
        assert_eq!(say(&mut drive, &format!("conf set servo.{name} {value}")), "OK\r\n", "{name}");
        assert_eq!(say(&mut drive, &format!("conf get servo.{name}")), format!("{value}\r\n"));
        let turns = drive.plant.truth().speed_rad_s / std::f64::consts::TAU;
        assert!(drive.drive().mode() == Mode::Running && (1.5..2.5).contains(&turns), "{name}: {turns}");
    }
    // Within their ranges, and by who controls.
    assert!(say(&mut drive, "conf set servo.speed_bandwidth_hz 1e6").starts_with("ERR speed_bandwidth_hz"));
    let refused = Ask::Set { name: "speed_bandwidth_hz", value: 50.0 };
    ask_as(8, &mut drive, refused, |answer| assert_eq!(answer, Answer::Refused(Refusal::Controlled)));
    assert_eq!(say(&mut drive, "conf get servo.speed_bandwidth_hz"), "60\r\n");
}

#[test]
fn another_command_takes_the_place_of_a_motion() {
    let mut drive = turning();
    // Position mode at rest, by registers: velocity 0.
    frame(&mut drive, &[0x01, 0x00, 0x0a, 0x0e, 0x20, 0, 0, 0xc0, 0x7f, 0, 0, 0, 0], 5);
    poll(&mut drive, 700, 20);
    let turns = drive.plant.truth().speed_rad_s / std::f64::consts::TAU;
    assert!(turns.abs() < 0.2, "{turns}");
}

/// While the drive still checks the motor, and when it has arrived: what is renewed is where it was.
#[test]
fn setting_the_output_moves_nothing() {
    for waits in [0, 1000] {
        for line in ["d exact 5", "d nearest -7", "d req-reindex"] {
            let mut drive = ready();
            assert_eq!(say(&mut drive, "d exact 1"), "OK\r\n");
            let from = drive.plant.truth().mechanical_angle_rad;
            assert_eq!(say(&mut drive, "d pos 1.2 0 nan"), "OK\r\n");
            poll(&mut drive, waits, 20);
            assert_eq!(say(&mut drive, line), "OK\r\n");
            poll(&mut drive, 1500, 20);
            let turned = (drive.plant.truth().mechanical_angle_rad - from) / std::f64::consts::TAU;
            assert!(drive.drive().mode() == Mode::Running && (turned - 0.2).abs() < 0.02, "{line}: {turned}");
        }
    }
}

#[test]
fn settings_are_changed_while_the_bridge_is_off_and_nobody_else_controls() {
    let mut drive = ready();
    assert_eq!(say(&mut drive, "conf set servo.max_current_a 2.5"), "OK\r\n");
    assert_eq!(say(&mut drive, "conf get servo.max_current_a"), "2.5\r\n");
    assert!(say(&mut drive, "conf set servo.max_current_a 9").contains("ceiling is 6"));
    assert!(say(&mut drive, "conf set servo.adc_bits 10").contains("follows from the board"));
    assert!(say(&mut drive, "conf set servo.max_current_a.1 2").starts_with("ERR"));
    assert_eq!(say(&mut drive, "conf get servo.max_current_a"), "2.5\r\n");
    // Nobody has to wait for the client: the next tool may control.
    done(&mut drive, Ask::Set { name: "max_current_a", value: 2.25 });
    assert!(say(&mut drive, "conf set servo.max_current_a 2").contains("another tool controls"));
    done(&mut drive, Ask::Release);
    assert_eq!(say(&mut drive, "conf write"), "OK\r\n");
    assert!(!status(&mut drive).unsaved);
    assert_eq!(say(&mut drive, "conf default"), "OK\r\n");
    assert_eq!(say(&mut drive, "conf get servo.max_current_a"), "3\r\n");
    assert_eq!(say(&mut drive, "conf load"), "OK\r\n");
    assert_eq!(say(&mut drive, "conf get servo.max_current_a"), "2.25\r\n");

    let mut drive = turning();
    assert_eq!(say(&mut drive, "conf set servo.max_current_a 2"), "ERR not while Running\r\n");
    assert!(say(&mut drive, "conf write").starts_with("ERR not yet"));
    say(&mut drive, "d stop");
    ask(&mut drive, Ask::Release, |answer| assert_ne!(answer, Answer::Refused(Refusal::Controlled)));
}

#[test]
fn a_dump_has_every_setting_once() {
    let mut drive = ready();
    let mut dump = say(&mut drive, "conf enumerate");
    dump += &poll(&mut drive, 500, 3);
    let names: Vec<_> = dump.lines().filter_map(|line| line.strip_prefix("servo.")?.split(' ').next()).collect();
    // All settings of a drive without an encoder.
    assert_eq!(names, TABLE.iter().map(|entry| entry.name).collect::<Vec<_>>());
    assert!(dump.starts_with("id.id 1\r\n") && dump.ends_with("\r\nOK\r\n"), "{dump}");
}
