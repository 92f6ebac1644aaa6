//! Whatever comes over the serial line.

use crate::support::{ask, frame, motor, run, turning};
use hallservo_protocol::Ask;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

/// Numbers that look random, and are the same in every run.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.next() as u8).collect()
    }
}

fn answers(session: &Session, id: u16) -> bool {
    session.lines.iter().any(|line| line.level == "REPLY" && line.message.starts_with(&format!("#{id} Status(")))
}

/// Garbage without pause, and frames that are damaged, do nothing to a turning drive and to its control interrupt; a
/// frame that is whole is answered whatever came before and comes after it.
pub fn hears_through_garbage(board: &str) {
    let quiet = turning(board);
    let mut session = quiet.fork();
    let mut noise = Noise(1);
    // For 0.2 s at the line's rate of 46 bytes a millisecond.
    for _ in 0..20 {
        session.receive(noise.bytes(460)).expect("a port");
        run(&mut session, 10e-3);
    }
    // The tasks stand still for up to 60 ms while a model of the sensors is built, and the port holds 256 bytes
    // meanwhile.
    run(&mut session, 0.1);
    for id in 100..130 {
        let mut bytes = noise.bytes(1 + id as usize % 60);
        bytes.extend(frame(id, Ask::Status));
        bytes.extend(noise.bytes(20));
        session.receive(bytes).expect("a port");
        let at_most_s = session.seconds() + 0.2;
        while !answers(&session, id) {
            assert!(session.seconds() < at_most_s, "{board}, {id}: {:#?}", session.lines);
            session.slice(at_most_s).expect("a run");
        }
    }
    // Whatever bit of it flips, a frame is obeyed as a whole or not at all. Its ends are zeros: without, it is two or
    // none.
    let disarm = frame(7, Ask::Disarm);
    for bit in 0..8 * disarm.len() {
        let mut bytes = disarm.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        if bit / 8 != 0 {
            session.receive(bytes).expect("a port");
            run(&mut session, 5e-3);
            assert!(session.machine.system.bridge_is_on(), "{board}, bit {bit}: {:#?}", session.lines);
        }
    }
    run(&mut session, 0.1);
    let status = ask(&mut session, "status");
    let garbage: u32 = status
        .split_once("garbage: ")
        .and_then(|(_, rest)| rest.split(',').next()?.parse().ok())
        .unwrap_or_else(|| panic!("{board}: {status}"));
    assert!(garbage > 50, "{board}: {status}");
    let speed = motor(&session, "speed / rad/s");
    assert!((speed - 40.0).abs() < 5.0, "{board}: {speed}");

    let mut beside = quiet.fork();
    run(&mut beside, session.seconds() - quiet.seconds());
    let [with, without] = [&session, &beside].map(Outcome::of);
    assert_eq!(with.verdict(), Vec::<String>::new());
    let [control, alone] = [with.control, without.control].map(|control| control.expect("a control interrupt"));
    println!(
        "{board}: {garbage} frames not understood; latency {:.0} ns with garbage, {:.0} ns without; duration {:.0}, \
         {:.0} ns",
        control.latency_ns.max, alone.latency_ns.max, control.duration_ns.max, alone.duration_ns.max
    );
    assert!(control.latency_ns.max < alone.latency_ns.max + 100.0, "{board}: {control:?}, {alone:?}");
    assert_eq!(control.latency_ns.count, alone.latency_ns.count, "{board}: no period is lost");
    ask(&mut session, "disarm");
    assert!(!session.machine.system.bridge_is_on(), "{board}");
}
