//! A computer or a link that stands still for a while, with a command on its way: what lay about is obeyed when it comes,
//! though the drive has stopped its motor since.

use crate::process::{Drive, call};
use crate::tool::request;
use hallservo_protocol::{Ask, Decoder, Request};
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
    drive.log_until("Disarm");
    let (driven, stopped) = (drive.log_last("Speed(50.0)"), drive.log_last("Speed(0.0)"));
    assert!(driven.at_s < stopped.at_s, "{driven:?} {stopped:?}");
}
