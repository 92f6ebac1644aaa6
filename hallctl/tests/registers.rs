//! Register clients and our own tools on one line: neither is ever mistaken for the other, and one controls at a time.

mod tool;

use hallctl::simulate::Simulator;
use hallctl::simulate::flash::Flash;
use hallservo::mode::Mode;
use hallservo_protocol::{Answer, Ask, Refusal};
use proptest::prelude::*;
use std::sync::LazyLock;
use tool::{ask_as, calibrated, done, drive, request, run, status};

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

/// Position mode, from where it is with a revolution a second; and what is asked for with it: mode and fault.
const MOVE: &str = "can send 8001 01000a0e200000c07f0000803f1100110f";
const STOP: &str = "can send 8001 0100001100110f";
const QUERY: &str = "can send 8001 1100110f";

fn ready() -> Simulator {
    let mut drive = drive(Flash::of(FLASH.clone()));
    run(&mut drive, 10);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    drive
}

/// Sends a line, lets some milliseconds pass, and gives what came back as text.
fn line(drive: &mut Simulator, text: &str, milliseconds: u32) -> String {
    drive.read();
    drive.write(text.as_bytes());
    drive.write(b"\n");
    run(drive, milliseconds);
    String::from_utf8_lossy(&drive.read()).into_owned()
}

/// Mode and fault.
fn mode(drive: &mut Simulator) -> (u8, u8) {
    let said = line(drive, QUERY, 5);
    let data = said.split("rcv 100 ").nth(1).unwrap_or_else(|| panic!("{said}")).as_bytes();
    let byte = |at: usize| u8::from_str_radix(std::str::from_utf8(&data[at..at + 2]).unwrap(), 16).unwrap();
    // 21 00 mode 21 0f fault
    (byte(4), byte(10))
}

#[test]
fn a_line_arms_moves_and_stops() {
    let mut drive = ready();
    let said = line(&mut drive, MOVE, 20);
    assert!(said.starts_with("OK *BD\nrcv 100 2100"), "{said}");
    assert_eq!(drive.drive().mode(), Mode::Running);
    for _ in 0..20 {
        line(&mut drive, MOVE, 50);
    }
    assert_eq!(mode(&mut drive), (10, 0));
    let turns = drive.plant.truth().speed_rad_s / std::f64::consts::TAU;
    assert!((0.5..1.5).contains(&turns), "{turns}");
    line(&mut drive, STOP, 5);
    assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Ready, (0, 0)));
}

#[test]
fn one_controls_and_anyone_stops() {
    let mut drive = ready();
    done(&mut drive, Ask::Arm);
    done(&mut drive, Ask::Speed(20.0));
    // The check at arming comes first.
    run(&mut drive, 600);
    // A client looks, but may not move.
    let said = line(&mut drive, MOVE, 5);
    assert!(said.contains("300003"), "{said}");
    assert_eq!(mode(&mut drive).0, 10);
    run(&mut drive, 100);
    done(&mut drive, Ask::Speed(20.0));
    assert_eq!(drive.drive().mode(), Mode::Running);
    // It may stop, which ends the control.
    line(&mut drive, STOP, 5);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    line(&mut drive, MOVE, 100);
    assert_eq!(drive.drive().mode(), Mode::Running);
    for refused in [Ask::Speed(5.0), Ask::Arm, Ask::Calibrate, Ask::Set { name: "max_current_a", value: 1.0 }] {
        ask_as(8, &mut drive, refused, |answer| {
            assert_eq!(answer, Answer::Refused(Refusal::Controlled), "{refused:?}")
        });
    }
    ask_as(8, &mut drive, Ask::Disarm, |answer| assert_eq!(answer, Answer::Done));
    run(&mut drive, 5);
    assert_eq!((drive.drive().mode(), mode(&mut drive).0), (Mode::Ready, 0));
    // Whoever falls silent has lost the control.
    line(&mut drive, MOVE, 100);
    run(&mut drive, 3000);
    ask_as(8, &mut drive, Ask::Speed(0.0), |answer| assert_ne!(answer, Answer::Refused(Refusal::Controlled)));
}

#[test]
fn a_fault_is_cleared_by_a_stop_and_by_nothing_else() {
    let mut drive = ready();
    line(&mut drive, MOVE, 200);
    drive.plant.set_supply(40.0).unwrap();
    run(&mut drive, 20);
    assert_eq!(mode(&mut drive), (1, 34));
    drive.plant.set_supply(24.0).unwrap();
    run(&mut drive, 100);
    line(&mut drive, MOVE, 100);
    assert_eq!(mode(&mut drive), (1, 34));
    line(&mut drive, STOP, 10);
    assert_eq!(mode(&mut drive), (0, 0));
    // The check at arming comes first.
    line(&mut drive, MOVE, 600);
    assert_eq!(mode(&mut drive).0, 10);
}

#[test]
fn no_calibration_is_a_fault_of_the_client_alone() {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    line(&mut drive, MOVE, 20);
    assert_eq!((mode(&mut drive), drive.drive().mode()), ((1, 36), Mode::Unarmed));
    line(&mut drive, STOP, 10);
    assert_eq!(mode(&mut drive), (0, 0));
}

/// "Not a number" elsewhere means for ever.
#[test]
fn no_watchdog_of_a_client_is_for_ever() {
    // As MOVE, and the time-out, register 0x27.
    for [timeout, holds_s] in [[f32::NAN, 60.0], [f32::INFINITY, 60.0], [1e30, 60.0], [0.2, 0.2]] {
        let mut drive = ready();
        let timeout: String = timeout.to_le_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        line(&mut drive, &format!("can send 8001 01000a0e200000c07f0000803f0d27{timeout}"), 600);
        let turning = |drive: &mut Simulator| drive.plant.truth().speed_rad_s > 5.0;
        run(&mut drive, (1000.0 * holds_s) as u32 - 700 * u32::from(holds_s > 1.0));
        assert_eq!(turning(&mut drive), holds_s > 1.0, "{timeout}");
        run(&mut drive, 1000);
        assert!(!turning(&mut drive) && drive.plant.truth().speed_rad_s.abs() < 0.1, "{timeout}");
    }
}

#[test]
fn telemetry_ends_with_the_first_line() {
    let mut drive = ready();
    done(&mut drive, Ask::Telemetry(1000.0));
    line(&mut drive, QUERY, 5);
    let said = line(&mut drive, QUERY, 100);
    assert!(said.starts_with("OK *BD\nrcv 100 ") && said.lines().count() == 2, "{said}");
}

#[test]
fn a_line_without_end_is_no_way_to_keep_others_off() {
    let mut drive = ready();
    drive.write(&[b'c'; 5000]);
    run(&mut drive, 200);
    assert_eq!(status(&mut drive).client, 0);
    line(&mut drive, "", 1);
    assert!(line(&mut drive, QUERY, 5).starts_with("OK"));
}

/// Pieces of a line in which a lot goes on, and none that would move the drive.
fn piece() -> impl Strategy<Value = Vec<u8>> {
    let text = || prop_oneof![Just(MOVE), Just("can send 8001 01000a"), Just("can send 0001 01000a")];
    prop_oneof![
        // Whole frames of our own that carry a line as a name.
        3 => (any::<u16>(), text()).prop_map(|(id, text)| request(id, Ask::Get(&format!("\n{text}\r\n")))),
        2 => (any::<u16>(), text(), any::<f32>())
            .prop_map(|(id, text, value)| request(id, Ask::Set { name: &format!("\n{text}\n"), value })),
        2 => any::<u16>().prop_map(|id| request(id, Ask::Status)),
        // Lines with a wrong check sum, and for others.
        3 => text().prop_map(|text| format!("{text} *00\n").into_bytes()),
        2 => Just(MOVE.replace("8001", "8002").into_bytes()),
        2 => Just(format!("\n{QUERY}\n").into_bytes()),
        // Noise without a line's end.
        2 => prop::collection::vec(prop_oneof![0x80..=0xff_u8, 1..9_u8], 0..40),
        1 => Just(vec![0]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn neither_is_mistaken_for_the_other(pieces in prop::collection::vec(piece(), 1..12)) {
        let mut drive = ready();
        for bytes in &pieces {
            drive.write(bytes);
            run(&mut drive, 3);
            drive.read();
        }
        run(&mut drive, 20);
        prop_assert_eq!(drive.drive().mode(), Mode::Ready);
        // Both are still served.
        drive.write(&[0]);
        prop_assert!(status(&mut drive).calibrated);
        line(&mut drive, "", 1);
        prop_assert!(line(&mut drive, QUERY, 5).starts_with("OK"));
    }
}
