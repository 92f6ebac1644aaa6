//! Register clients and our own tools on one line: neither is ever mistaken for the other, and one controls at a time.

use crate::tool::{arm, ask_as, calibrated, done, drive, request, run, status};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use hallservo_protocol::{Answer, Ask, Refusal};
use proptest::prelude::*;
use simulator::Simulator;
use simulator::flash::Flash;
use std::sync::LazyLock;

/// A flash with a calibration.
static FLASH: LazyLock<Vec<u8>> = LazyLock::new(|| calibrated().1);

/// Position mode, from where it is with a revolution a second; and what is asked for with it: mode and fault.
const MOVE: &str = "can send 8001 01000a0e200000c07f0000803f1100110f";
const BRAKE: &str = "can send 8001 01000f1100110f";
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

/// A float in a frame.
fn hex(value: f64) -> String {
    (value as f32).to_le_bytes().map(|byte| format!("{byte:02x}")).concat()
}

/// A client that waits for the end of a motion is not told of it while the drive still checks the motor.
#[test]
fn a_motion_is_complete_when_it_has_arrived() {
    let mut drive = ready();
    let status = status(&mut drive);
    let (start, from) = (status.position_turns, drive.plant.truth().mechanical_angle_rad);
    for way in [0.5, -0.5] {
        let request = format!("can send 8001 01000a0e20{}{}1100110b", hex(start + way), hex(0.0));
        let mut said = String::new();
        let told = (0..300).find(|_| {
            said = line(&mut drive, &request, 10);
            said.contains("210b01")
        });
        let turned = (drive.plant.truth().mechanical_angle_rad - from) / std::f64::consts::TAU;
        // The check alone takes more than a tenth of a second: a request is sent every 10 ms.
        assert!(told.is_some_and(|requests| requests > 10), "{told:?} {said}");
        assert!((turned - way).abs() < 0.02, "{turned} of {way} after {told:?} requests");
        line(&mut drive, STOP, 300);
    }
}

#[test]
fn the_same_position_is_another_one_after_the_output_was_set() {
    let mut drive = ready();
    let from = drive.plant.truth().mechanical_angle_rad;
    let request = format!("can send 8001 01000a0e20{}{}1100110b", hex(0.5), hex(0.0));
    for turns in [0.5, 1.0] {
        line(&mut drive, &format!("can send 8001 0db102{}", hex(0.0)), 5);
        let told = (0..300).find(|_| line(&mut drive, &request, 10).contains("210b01"));
        let turned = (drive.plant.truth().mechanical_angle_rad - from) / std::f64::consts::TAU;
        assert!(told.is_some() && (turned - turns).abs() < 0.02, "{turned} of {turns} after {told:?} requests");
    }
}

#[test]
fn one_controls_and_anyone_stops() {
    let mut drive = ready();
    arm(&mut drive);
    done(&mut drive, Ask::Speed(20.0));
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
    // The check at arming comes first, and after a fault it is the long one.
    line(&mut drive, MOVE, 900);
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

/// "Not a number" elsewhere means for ever. The short form leaves out the number that is only too large.
#[test]
fn no_watchdog_of_a_client_is_for_ever() {
    // As MOVE, and the time-out, register 0x27, which counts from the line, the check at arming included.
    let cases = [[0.2, 0.2], [f32::NAN, 60.0], [f32::INFINITY, 60.0], [1e30, 60.0]];
    for [timeout, holds_s] in cases.into_iter().take(sim::of(3, 4)) {
        let mut drive = ready();
        let timeout: String = timeout.to_le_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        line(&mut drive, &format!("can send 8001 01000a0e200000c07f0000803f0d27{timeout}"), 1200);
        let turning = |drive: &mut Simulator| drive.plant.truth().speed_rad_s > 5.0;
        run(&mut drive, (1000.0 * holds_s) as u32 - if holds_s > 1.0 { 1300 } else { 0 });
        assert_eq!(turning(&mut drive), holds_s > 1.0, "{timeout}");
        run(&mut drive, 1000);
        assert!(!turning(&mut drive) && drive.plant.truth().speed_rad_s.abs() < 0.1, "{timeout}");
        // What comes late is not obeyed before the client has stopped the drive.
        line(&mut drive, MOVE, 500);
        assert!(drive.plant.truth().speed_rad_s.abs() < 0.1, "{timeout}");
        assert_eq!(mode(&mut drive), (11, 0));
    }
}

/// The largest current of a winding in some milliseconds.
fn largest_a(drive: &mut Simulator, milliseconds: u32) -> f64 {
    let mut largest_a = 0.0_f64;
    for _ in 0..milliseconds {
        drive.step();
        largest_a =
            drive.plant.truth().currents_a.iter().fold(largest_a, |largest, current| largest.max(current.abs()));
    }
    largest_a
}

#[test]
fn a_brake_shorts_the_windings() {
    let mut drive = ready();
    for _ in 0..10 {
        line(&mut drive, MOVE, 100);
    }
    let from_rad_s = drive.plant.truth().speed_rad_s;
    line(&mut drive, BRAKE, 20);
    assert_eq!(mode(&mut drive), (15, 0));
    run(&mut drive, 150);
    let left_rad_s = drive.plant.truth().speed_rad_s;
    assert!(from_rad_s > 4.0 && left_rad_s.abs() < 0.2, "{from_rad_s} {left_rad_s}");
    // A hand that turns the shaft meets a damper: ψ²·pole pairs²·1.5/R, with the windings' own ψ and R.
    for speed_rad_s in [-20.0, 15.0] {
        drive.plant.set_dyno(Some(speed_rad_s)).unwrap();
        line(&mut drive, BRAKE, 50);
        let truth = drive.plant.truth();
        let peak_v = truth.back_emf_v.iter().fold(0.0_f64, |peak, volts| peak.max(volts.abs()));
        let current_a = largest_a(&mut drive, 100);
        assert!(drive.plant.truth().torque_nm * speed_rad_s < 0.0);
        let by_resistance_a = peak_v / 3.75;
        assert!((0.6..1.3).contains(&(current_a / by_resistance_a)), "{current_a} A of {by_resistance_a} A");
    }
    drive.plant.set_dyno(None).unwrap();
    line(&mut drive, STOP, 5);
    assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Ready, (0, 0)));
    // From there it arms.
    line(&mut drive, BRAKE, 700);
    assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Running, (15, 0)));
    // A position from there, and back.
    line(&mut drive, MOVE, 700);
    assert_eq!(mode(&mut drive), (10, 0));
    assert!(drive.plant.truth().speed_rad_s > 4.0);
    // Nobody repeats it: as any command it times out.
    line(&mut drive, BRAKE, 3000);
    assert_ne!(mode(&mut drive).0, 15);
}

#[test]
fn the_windings_are_shorted_only_where_the_current_stays_within_its_limit() {
    const MOST_A: f64 = 0.5;
    let mut drive = ready();
    done(&mut drive, Ask::Set { name: "max_current_a", value: MOST_A as f32 });
    done(&mut drive, Ask::Release);
    // By the settings' resistance and flux linkage.
    let most_rad_s = MOST_A * 3.75 / 5e-3 / f64::from(Settings::default().pole_pairs);
    drive.plant.set_dyno(Some(1.1 * most_rad_s)).unwrap();
    run(&mut drive, 100);
    let said = line(&mut drive, BRAKE, 100);
    assert!(said.contains("300003"), "{said}");
    assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Ready, (0, 0)));
    // A little below the current rises to little less, and no further from whatever was before.
    drive.plant.set_dyno(Some(-0.9 * most_rad_s)).unwrap();
    run(&mut drive, 100);
    drive.read();
    drive.write(format!("{BRAKE}\n").as_bytes());
    let current_a = largest_a(&mut drive, 300);
    assert_eq!(mode(&mut drive), (15, 0));
    assert!((0.5 * MOST_A..1.25 * MOST_A).contains(&current_a), "{current_a}");
    // What drives it faster ends it.
    drive.plant.set_dyno(Some(-1.1 * most_rad_s)).unwrap();
    run(&mut drive, 30);
    assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Ready, (1, Fault::OverCurrent.code())));
    line(&mut drive, BRAKE, 100);
    assert_eq!(drive.drive().mode(), Mode::Ready);
    line(&mut drive, STOP, 10);
    assert_eq!(mode(&mut drive), (0, 0));
}

#[test]
fn modes_that_no_limit_holds_in_are_refused() {
    let mut drive = ready();
    // PWM, voltages, inductance; and some that there are not.
    for number in [5, 6, 7, 8, 14, 16, 99] {
        let said = line(&mut drive, &format!("can send 8001 0100{number:02x}1100110f"), 100);
        assert!(said.contains("300003"), "{number}: {said}");
        assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Ready, (0, 0)), "{number}");
    }
    // Duties, voltages, and a voltage or a current in place of the regulated one: no such register, and no motion.
    for number in (0x10..=0x1b).chain([0x1e, 0x2a, 0x2c]) {
        let said = line(&mut drive, &format!("can send 8001 01000a0d{number:02x}{}1100110f", hex(1.0)), 100);
        assert!(said.contains(&format!("30{number:02x}01")), "{number:#x}: {said}");
        assert_eq!((drive.drive().mode(), mode(&mut drive)), (Mode::Ready, (0, 0)), "{number:#x}");
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
