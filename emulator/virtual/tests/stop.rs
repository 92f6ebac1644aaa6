//! A stop of the register protocol, by the bus or as a line of text, acts within 2 ms whatever the tasks do, and what
//! was asked for before it moves nothing.

mod common;

use chip::Edge;
use chip::can::frame::Frame;
use chip::can::station::Station;
use chip::can::timing::Timing;
use common::{ESC_ON_BUS, NUCLEO, ask, calibrated, frame, perform, run, turning};
use hallservo_protocol::{Ask, MagnetsAsk};
use virtual_board::bus::Bus;
use virtual_board::session::Session;

/// From the first bit of the request to the bridge off.
const OFF_S: f64 = 2e-3;
/// The mode "stopped".
const STOPPED: [u8; 3] = [0x01, 0x00, 0x00];
/// The mode "position" where the rotor is.
const HOLD: [u8; 3] = [0x01, 0x00, 0x0a];
/// A line of the diagnostic channel, padded as clients do to a length that a bus has.
const D_STOP: &[u8] = b"\x40\x01\x07d stop\nPP";

/// The same to the drive by either way.
#[derive(Clone, Copy, Debug)]
enum Way {
    Bus,
    Line,
}

impl Way {
    fn send(self, bus: &mut Bus, bytes: &[u8]) {
        match self {
            Self::Bus => {
                let now_s = bus.seconds();
                bus.stations[0].send(now_s, Frame::switched(0x8001, true, bytes));
            }
            Self::Line => {
                let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                let line = format!("can send 8001 {hex}\n");
                bus.boards[0].receive(line.into_bytes()).expect("a serial port");
            }
        }
    }
}

fn wired(board: Session) -> Bus {
    let mut bus = Bus::of_running(vec![board], vec![Station::new(Timing::fast())]);
    bus.run(5e-3).expect("a run");
    bus
}

fn edges(bus: &Bus) -> Vec<Edge> {
    bus.boards[0].machine.system.facts().moe
}

/// Sends it amid what goes on, and returns how long the bridge was on, s.
fn off_after(what: &str, bus: &mut Bus, way: Way, bytes: &[u8]) -> f64 {
    let (at_s, before) = (bus.boards[0].seconds(), edges(bus));
    assert!(before.last().is_some_and(|edge| edge.on), "{what}: the bridge is off");
    way.send(bus, bytes);
    bus.run(5e-3).expect("a run");
    let [off] = &edges(bus)[before.len()..] else { panic!("{what}: {:?}", edges(bus)) };
    let took_s = off.at_s - at_s;
    assert!(!off.on && took_s < OFF_S, "{what}: {off:?} after {at_s}");
    took_s
}

fn acts_whatever_the_tasks_do(board: &str, way: Way, stops: &[&[u8]]) {
    type Prepare = fn(&mut Bus);
    const PREPARED: [(&str, Prepare); 4] = [
        ("the tasks are idle", |_| {}),
        ("the tasks hang", |bus| perform(&mut bus.boards[0], "hang tasks")),
        ("a query waits for its answer", |bus| Way::Bus.send(bus, &[0x1f, 0x01])),
        ("the tasks hang, and no frame has room", |bus| {
            perform(&mut bus.boards[0], "hang tasks");
            (0..8).for_each(|_| Way::Bus.send(bus, &HOLD));
        }),
    ];
    let turning = turning(board);
    for (what, prepare) in PREPARED {
        let mut longest_s = 0.0_f64;
        for (instant, stop) in stops.iter().cycle().take(4).enumerate() {
            let mut bus = wired(turning.fork());
            prepare(&mut bus);
            bus.run(1e-3 + 0.31e-3 * instant as f64).expect("a run");
            longest_s = longest_s.max(off_after(&format!("{board}, {way:?}, {what}"), &mut bus, way, stop));
        }
        println!("{board}, {way:?}, {what}: off after {:.0} µs at most", longest_s * 1e6);
    }
}

#[test]
fn by_the_bus_it_acts_whatever_the_tasks_do() {
    // With a query behind it, as clients send it; as a float, to all; as text.
    acts_whatever_the_tasks_do(
        NUCLEO,
        Way::Bus,
        &[&STOPPED, &[1, 0, 0, 0x11, 0, 0x1f, 1], &[13, 0, 0, 0, 0, 0], D_STOP],
    );
}

#[test]
fn by_the_bus_it_acts_whatever_the_tasks_of_the_smallest_board_do() {
    acts_whatever_the_tasks_do(ESC_ON_BUS, Way::Bus, &[&STOPPED, &[1, 0, 0, 0x11, 0, 0x1f, 1]]);
}

#[test]
fn as_a_line_it_acts_whatever_the_tasks_do() {
    acts_whatever_the_tasks_do(NUCLEO, Way::Line, &[&STOPPED, D_STOP]);
}

/// Which has no diagnostic channel: `d stop` is nobody's there.
#[test]
fn as_a_line_it_acts_whatever_the_tasks_of_the_smallest_board_do() {
    acts_whatever_the_tasks_do(ESC_ON_BUS, Way::Line, &[&STOPPED, &[1, 0, 0, 0x11, 0, 0x1f, 1]]);
}

/// While the field turns for a calibration, and the records keep the tasks busy.
#[test]
fn it_breaks_a_calibration_off() {
    for (board, way) in [(NUCLEO, Way::Line), (ESC_ON_BUS, Way::Bus), (ESC_ON_BUS, Way::Line)] {
        for after_s in [0.05, 1.9] {
            let mut session = calibrated(board);
            ask(&mut session, "calibrate");
            let mut bus = wired(session);
            bus.run(after_s).expect("a run");
            off_after(&format!("{board}, {way:?}, calibrating"), &mut bus, way, &STOPPED);
            bus.run(0.3).expect("a run");
            assert!(ask(&mut bus.boards[0], "status").contains("activity: None"), "{board}");
        }
    }
}

/// While the motor turns by itself to learn something, and the tasks sum up.
#[test]
fn it_breaks_learning_off() {
    const LEARNING: [(&str, Ask<'static>); 2] =
        [("Cogging", Ask::LearnCogging), ("Magnets", Ask::Magnets(MagnetsAsk::Learn))];
    for (activity, learn) in LEARNING {
        let mut session = calibrated(NUCLEO);
        session.receive(frame(9, learn)).expect("a serial port");
        // Where nothing is learnt yet, and where something is.
        for further_s in [0.8, 2.5] {
            run(&mut session, further_s);
            for (way, stop) in [(Way::Line, &STOPPED[..]), (Way::Line, D_STOP), (Way::Bus, &STOPPED)] {
                let what = format!("{activity}, {way:?}, after another {further_s} s");
                let mut bus = wired(session.fork());
                assert!(ask(&mut bus.boards[0], "status").contains(&format!("activity: {activity}")), "{what}");
                off_after(&what, &mut bus, way, stop);
                stays_off(&what, &mut bus);
                let status = ask(&mut bus.boards[0], "status");
                assert!(
                    status.contains("activity: None") && status.contains("anti_cogging: false"),
                    "{what}: {status}"
                );
                arms_again(&what, &mut bus);
            }
        }
    }
}

/// The sensors are learnt while the motor turns: a new model every second, whose making stalls the tasks.
#[test]
fn it_does_not_wait_for_the_adaptation() {
    for board in [NUCLEO, ESC_ON_BUS] {
        let mut session = turning(board);
        let learnt =
            |status: &str| status.split("learnt: ").nth(1).and_then(|rest| rest.split(',').next().map(String::from));
        let before = learnt(&ask(&mut session, "status"));
        let mut longest_s = 0.0_f64;
        for instant in 0..24 {
            let way = if instant % 2 == 0 { Way::Line } else { Way::Bus };
            let what = format!("{board}, {way:?}, at instant {instant} of the adaptation");
            let mut bus = wired(session.fork());
            longest_s = longest_s.max(off_after(&what, &mut bus, way, &STOPPED));
            if instant % 8 == 0 {
                stays_off(&what, &mut bus);
                arms_again(&what, &mut bus);
            }
            run(&mut session, 0.09);
        }
        let status = ask(&mut session, "status");
        assert!(status.contains("learning: On") && learnt(&status) != before, "{board}: {status}");
        println!("{board}: while it learns, off after {:.0} µs at most", longest_s * 1e6);
    }
}

fn stays_off(what: &str, bus: &mut Bus) {
    let before = edges(bus).len();
    bus.run(1.0).expect("a run");
    assert_eq!(edges(bus)[before..], [], "{what}");
}

fn arms_again(what: &str, bus: &mut Bus) {
    for _ in 0..100 {
        Way::Bus.send(bus, &HOLD);
        bus.run(10e-3).expect("a run");
        if edges(bus).last().is_some_and(|edge| edge.on) {
            return;
        }
    }
    let told = ["status", "history 0"].map(|request| ask(&mut bus.boards[0], request));
    panic!("{what}: {told:#?}");
}

/// A save stalls the tasks; what was sent before the stop has its turn after it, and switches nothing on.
#[test]
fn nothing_from_before_it_arms() {
    const WAYS: [(&str, Way); 4] =
        [(NUCLEO, Way::Line), (NUCLEO, Way::Bus), (ESC_ON_BUS, Way::Bus), (ESC_ON_BUS, Way::Line)];
    for (board, way) in WAYS {
        let mut session = calibrated(board);
        ask(&mut session, "set max_speed_rad_s 123");
        ask(&mut session, "release");
        let mut bus = wired(session);
        let (before, writes) = (edges(&bus).len(), bus.boards[0].machine.system.facts().flash_operations);
        bus.boards[0].receive(frame(9, Ask::Save)).expect("a serial port");
        while bus.boards[0].machine.system.facts().flash_operations == writes {
            bus.step().expect("a step");
        }
        way.send(&mut bus, &HOLD);
        way.send(&mut bus, &STOPPED);
        bus.run(1.0).expect("a run");
        assert_eq!(edges(&bus)[before..], [], "{board}, {way:?}");
        // What comes after it does.
        for _ in 0..30 {
            way.send(&mut bus, &HOLD);
            bus.run(10e-3).expect("a run");
        }
        assert!(edges(&bus).last().is_some_and(|edge| edge.on), "{board}, {way:?}");
        way.send(&mut bus, &STOPPED);
        bus.run(10e-3).expect("a run");
        assert!(edges(&bus).last().is_some_and(|edge| !edge.on), "{board}, {way:?}");
    }
}
