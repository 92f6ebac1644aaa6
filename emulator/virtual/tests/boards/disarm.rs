//! A request to disarm acts within 2 ms, whatever the tasks do, and nothing else does.

use crate::support::{CHECKED_S, ask, calibrated, frame, motor, perform, run, turning};
use chip::Edge;
use hallservo_protocol::Ask;
use virtual_board::session::Session;

/// From the first bit of the request to the bridge off.
const OFF_S: f64 = 2e-3;

fn edges(session: &Session) -> Vec<Edge> {
    session.machine.system.facts().moe
}

/// Bytes over the line, now.
fn send(session: &mut Session, bytes: Vec<u8>) {
    session.receive(bytes).expect("a serial port");
}

/// Sends it amid what goes on, and returns how long the bridge was on, s.
fn off_after(board: &str, what: &str, session: &mut Session, bytes: Vec<u8>) -> f64 {
    let (at_s, before) = (session.seconds(), edges(session));
    assert!(before.last().is_some_and(|edge| edge.on), "{board}, {what}: the bridge is off");
    send(session, bytes);
    run(session, 5e-3);
    let [off] = &edges(session)[before.len()..] else { panic!("{board}, {what}: {:?}", edges(session)) };
    let took_s = off.at_s - at_s;
    assert!(!off.on && took_s < OFF_S, "{board}, {what}: {off:?} after {at_s}");
    took_s
}

pub fn acts_whatever_the_tasks_do(board: &str) {
    let turning = turning(board);
    let worst = |what: &str, prepare: fn(&mut Session), around: fn(Vec<u8>) -> Vec<u8>| {
        let mut longest_s = 0.0_f64;
        for instant in 0..8_u16 {
            let mut session = turning.fork();
            prepare(&mut session);
            run(&mut session, f64::from(instant) * 0.31e-3);
            let bytes = around(frame(1 + 40 * instant, Ask::Disarm));
            longest_s = longest_s.max(off_after(board, what, &mut session, bytes));
        }
        println!("{board}, {what}: off after {:.0} µs at most", longest_s * 1e6);
    };
    worst("the tasks are idle", |_| {}, |disarm| disarm);
    worst("the tasks hang", |session| perform(session, "hang tasks"), |disarm| disarm);
    worst("a request waits for its answer", |session| send(session, frame(7, Ask::Calibrate)), |disarm| disarm);
    worst("telemetry fills the line", |session| perform(session, "send telemetry 1000"), |disarm| disarm);
    // No more than the time that the garbage takes on the line.
    let among = |disarm: Vec<u8>| [vec![0x55; 20], vec![0], disarm, vec![0xaa; 300]].concat();
    worst("amid garbage, the tasks hang", |session| perform(session, "hang tasks"), among);
}

/// While the field turns for a calibration, and the records keep the tasks busy.
pub fn breaks_a_calibration_off(board: &str) {
    let calibrated = calibrated(board);
    for after_s in [0.05, 0.7, 1.9] {
        let mut session = calibrated.fork();
        ask(&mut session, "calibrate");
        run(&mut session, after_s);
        let took_s = off_after(board, "calibrating", &mut session, frame(9, Ask::Disarm));
        println!("{board}, calibrating for {after_s} s: off after {:.0} µs", took_s * 1e6);
        run(&mut session, 0.3);
        assert!(ask(&mut session, "status").contains("activity: None"), "{board}: {:#?}", session.lines);
    }
}

/// What was asked for before has its turn after a save, and switches nothing on; what comes after the answer does.
pub fn nothing_from_before_it_arms(board: &str) {
    let mut session = calibrated(board);
    let before = edges(&session).len();
    ask(&mut session, "set max_speed_rad_s 123");
    let asked = [Ask::Save, Ask::Arm, Ask::Speed(40.0), Ask::Disarm];
    send(&mut session, asked.into_iter().zip(100..).flat_map(|(ask, id)| frame(id, ask)).collect());
    run(&mut session, 0.5);
    let answered = session.lines.iter().filter(|line| line.level == "REPLY" && line.message.starts_with("#10")).count();
    assert_eq!(answered, 4, "{board}: {:#?}", session.lines);
    assert_eq!(edges(&session)[before..], [], "{board}");
    for request in ["arm", "speed 40"] {
        assert!(ask(&mut session, request).contains("Done"), "{board}, {request}: {:#?}", session.lines);
    }
    run(&mut session, CHECKED_S + 0.5);
    let speed = motor(&session, "speed / rad/s");
    assert!((speed - 40.0).abs() < 4.0, "{board}: {speed}");
    assert!(ask(&mut session, "disarm").contains("Done"));
    assert!(edges(&session).last().is_some_and(|edge| !edge.on));
}

/// Every frame to disarm with a flipped bit, with the tasks at work and hanging; and other requests.
pub fn garbage_does_not_disarm(board: &str) {
    let good = frame(5, Ask::Disarm);
    let flipped = |bit: usize| {
        let mut frame = good.clone();
        frame[bit / 8] ^= 1 << (bit % 8);
        frame
    };
    let bits = 8..8 * (good.len() - 1);
    for hangs in [false, true] {
        let mut session = turning(board);
        let before = edges(&session).len();
        if hangs {
            perform(&mut session, "hang tasks");
        }
        for bit in bits.clone().step_by(if hangs { 3 } else { 1 }) {
            send(&mut session, [vec![0], flipped(bit), vec![0]].concat());
            run(&mut session, 1e-3);
        }
        assert_eq!(edges(&session)[before..], [], "{board}, tasks hang: {hangs}");
    }
}
