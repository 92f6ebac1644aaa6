//! A computer or a link that stands still for a while, with commands on their way: what lay about when the drive has
//! stopped its motor does not set it in motion again.

use crate::process::{Drive, call};
use crate::tool::{arm, ask, ask_as, begin, calibrated, done, request, run, status};
use hallservo::control::impedance::{self, Motion};
use hallservo::fault::{Fault, Limits};
use hallservo_protocol::{Activity, Answer, Ask, Decoder, Refusal, Request};
use simulator::Simulator;
use simulator::fault::Kind;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

/// A frame's time is 20 ms of the drive's: three seconds.
const SILENCE: u16 = 150;
/// Which of the commands comes late.
const LATE: usize = 6;

/// A line to the drive on which one command for a speed comes late. Its port.
fn slow_line(drive: &Drive) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp:{}", listener.local_addr().unwrap());
    let there = TcpStream::connect(drive.port.strip_prefix("tcp:").unwrap()).unwrap();
    thread::spawn(move || {
        let (here, _) = listener.accept().unwrap();
        let (mut answers, mut back) = (there.try_clone().unwrap(), here.try_clone().unwrap());
        thread::spawn(move || std::io::copy(&mut answers, &mut back));
        pass(here, there);
    });
    port
}

fn pass(mut here: TcpStream, mut there: TcpStream) {
    let (mut decoder, mut frame, mut commands, mut byte) = (Decoder::new(), Vec::new(), 0, [0]);
    while here.read_exact(&mut byte).is_ok() {
        frame.push(byte[0]);
        let Some(request_came) = decoder.push::<Request<'_>>(byte[0]) else { continue };
        if matches!(request_came, Ok(Request { ask: Ask::Speed(speed), .. }) if speed != 0.0) {
            commands += 1;
            if commands == LATE {
                // Meanwhile time passes at the drive.
                (0..SILENCE).for_each(|id| there.write_all(&request(60_000 + id, Ask::Status)).unwrap());
            }
        }
        there.write_all(&frame).unwrap();
        frame.clear();
    }
}

#[test]
fn a_command_that_comes_after_the_drive_has_stopped_does_not_set_the_motor_in_motion_again() {
    let mut drive = Drive::start(&["--log"]);
    drive.ok(&["calibrate"]);
    drive.ok(&["arm"]);
    drive.forget_log();
    let line = slow_line(&drive);
    let output = call(&line, &["speed", "50", "--seconds", "20"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(7) && said.contains("heard nothing from this one"), "{said}");
    assert!(call(&line, &["stop"]).status.success());
    let (off, late) = (drive.log_until("Disarm"), drive.log_last("Speed(50.0)"));
    assert!(late.speed_rad_s.abs() < 1.0 && off.speed_rad_s.abs() < 1.0, "{late:?} {off:?}");
}

/// Arms, turns at 50 rad/s, falls silent until the drive has stopped its motor.
fn stopped_by_silence() -> Simulator {
    let (mut drive, _) = calibrated();
    arm(&mut drive);
    done(&mut drive, Ask::Speed(50.0));
    run(&mut drive, 500);
    assert!(drive.plant.truth().speed_rad_s > 45.0);
    run(&mut drive, 1500);
    assert!(drive.plant.truth().speed_rad_s.abs() < 1.0);
    drive
}

/// The largest speed while what is asked arrives, one each millisecond, and half a second after.
fn fastest(drive: &mut Simulator, asked: &[Ask<'_>]) -> f64 {
    let mut fastest = 0.0_f64;
    for k in 0..asked.len() + 500 {
        if let Some(ask) = asked.get(k) {
            drive.write(&request(k as u16, *ask));
        }
        drive.step();
        fastest = fastest.max(drive.plant.truth().speed_rad_s.abs());
    }
    fastest
}

/// What lay in a buffer of the computer or of an adapter while nothing was heard, the computer being gone.
#[test]
fn what_comes_late_of_a_tool_that_has_fallen_silent_moves_nothing() {
    let motion = Motion::To {
        position_turns: None,
        speed_rad_s: 20.0,
        stop_turns: None,
        max_speed_rad_s: None,
        max_acceleration_rad_s2: None,
    };
    let impedance = impedance::Request { motion, ..impedance::Request::default() };
    for late in [Ask::Speed(50.0), Ask::Torque(0.02), Ask::Voltage(0.2), Ask::Position(5.0), Ask::Impedance(impedance)]
    {
        let mut drive = stopped_by_silence();
        let speed = fastest(&mut drive, &[late; 20]);
        assert!(speed < 1.0, "{late:?}: {speed} rad/s");
        // A command of zero, which changes nothing, does not open the way for what is behind it.
        let speed = fastest(&mut drive, &[Ask::Status, Ask::Speed(0.0), late, Ask::Status, late]);
        assert!(speed < 1.0, "{late:?}: {speed} rad/s");
        ask(&mut drive, late, |answer| {
            let why = Refusal::Drive(hallservo::drive::Refusal::Fault(Fault::CommandTimeout));
            assert_eq!(answer, Answer::Refused(why), "{late:?}");
        });
        // However long it takes; and nobody else is kept from it.
        run(&mut drive, 1200);
        assert!(fastest(&mut drive, &[late]) < 1.0, "{late:?}");
        assert!(ask_as(2, &mut drive, Ask::Speed(20.0), |answer| answer == Answer::Done));
    }
}

/// By release, which is no set-point; or off and on.
#[test]
fn a_tool_takes_up_again_what_has_stopped_for_its_silence() {
    let mut drive = stopped_by_silence();
    done(&mut drive, Ask::Release);
    assert!(fastest(&mut drive, &[Ask::Speed(50.0)]) > 45.0);
    let mut drive = stopped_by_silence();
    done(&mut drive, Ask::Disarm);
    run(&mut drive, 500);
    arm(&mut drive);
    assert!(fastest(&mut drive, &[Ask::Speed(50.0)]) > 45.0);
}

/// The same where it was heard all the time, and only commanded nothing.
#[test]
fn a_tool_that_was_heard_is_obeyed_though_the_drive_has_stopped() {
    let (mut drive, _) = calibrated();
    arm(&mut drive);
    for _ in 0..20 {
        status(&mut drive);
        run(&mut drive, 100);
    }
    assert!(status(&mut drive).limits.contains(Limits::TIMEOUT));
    assert!(fastest(&mut drive, &[Ask::Speed(50.0)]) > 45.0);
}

/// What restarts the time for which a command holds, and is no set-point, does not open the way either: a setting, of
/// that tool's or another's.
#[test]
fn what_comes_late_behind_a_setting_moves_nothing() {
    let set = Ask::Set { name: "position_bandwidth_hz", value: 10.0 };
    let mut drive = stopped_by_silence();
    let speed = fastest(&mut drive, &[set, Ask::Status, Ask::Status, Ask::Speed(50.0)]);
    assert!(speed < 1.0, "{speed} rad/s");
    let mut drive = stopped_by_silence();
    for what in [set, Ask::Release] {
        assert!(ask_as(2, &mut drive, what, |answer| !matches!(answer, Answer::Refused(_))));
    }
    let speed = fastest(&mut drive, &[Ask::Speed(50.0)]);
    assert!(speed < 1.0, "{speed} rad/s");
}

/// Who was silent while the bridge was off has missed nothing.
#[test]
fn a_tool_that_was_silent_before_it_arms_is_obeyed() {
    let (mut drive, _) = calibrated();
    done(&mut drive, Ask::Set { name: "position_bandwidth_hz", value: 10.0 });
    run(&mut drive, 1500);
    arm(&mut drive);
    for _ in 0..20 {
        status(&mut drive);
        run(&mut drive, 100);
    }
    assert!(status(&mut drive).limits.contains(Limits::TIMEOUT));
    done(&mut drive, Ask::Speed(50.0));
    // Nor after a fault, which switches off as well.
    let mut drive = stopped_by_silence();
    drive.happen(Kind::Bus(60.0)).unwrap();
    run(&mut drive, 50);
    drive.happen(Kind::Bus(24.0)).unwrap();
    run(&mut drive, 50);
    done(&mut drive, Ask::Clear);
    arm(&mut drive);
    for _ in 0..20 {
        status(&mut drive);
        run(&mut drive, 100);
    }
    done(&mut drive, Ask::Speed(50.0));
}

/// Who has left what it began unattended may brake it when it comes back, and be obeyed then.
#[test]
fn what_goes_on_unattended_is_braked_by_its_tool() {
    for what in [Ask::Calibrate, Ask::Identify, Ask::LearnCogging, Ask::Swing] {
        let (mut drive, _) = calibrated();
        begin(&mut drive, what);
        run(&mut drive, 2500);
        let activity = status(&mut drive).activity;
        assert_ne!(activity, Activity::None, "{what:?}");
        run(&mut drive, 1200);
        assert_eq!(status(&mut drive).activity, activity, "{what:?}");
        done(&mut drive, Ask::Speed(0.0));
        run(&mut drive, 500);
        assert!(drive.plant.truth().speed_rad_s.abs() < 1.0, "{what:?}");
        done(&mut drive, Ask::Disarm);
        run(&mut drive, 300);
        arm(&mut drive);
        assert!(fastest(&mut drive, &[Ask::Speed(50.0)]) > 45.0, "{what:?}");
    }
}
