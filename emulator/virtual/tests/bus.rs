//! Boards on one CAN, and clients of the register protocol there.

mod common;

use chip::can::counters::State;
use chip::can::frame::{Frame, LENGTHS};
use chip::can::station::Station;
use chip::can::timing::{Rate, Timing};
use common::{ESC_ON_BUS, NUCLEO, ask, calibrated, session};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use virtual_board::bus::Bus;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

/// Reads mode and fault, 8 bits each.
const QUERY: [u8; 4] = [0x11, 0x00, 0x11, 0x0f];
/// Reads the position, a float.
const WHERE: [u8; 2] = [0x1d, 0x01];
/// Stops.
const STOP: [u8; 3] = [0x01, 0x00, 0x00];

/// To a position, revolutions, for half a second, at one revolution a second.
fn position(to: f32) -> Vec<u8> {
    let mut frame = vec![0x01, 0x00, 0x0a, 0x0d, 0x20];
    frame.extend(to.to_le_bytes());
    frame.extend([0x0d, 0x27]);
    frame.extend(0.5_f32.to_le_bytes());
    frame.extend([0x0d, 0x28]);
    frame.extend(1.0_f32.to_le_bytes());
    frame
}

/// To a drive, which is to reply to source 0.
fn request(id: u32, bytes: &[u8]) -> Frame {
    Frame::switched(0x8000 | id, true, bytes)
}

fn client() -> Station {
    Station::new(Timing::fast())
}

/// Boards that have calibrated, with the identifiers 1, 2, 3, …
fn boards(count: u32) -> Vec<Session> {
    let one = |id: u32| {
        let mut board = calibrated(NUCLEO);
        ask(&mut board, &format!("set bus_id {id}"));
        ask(&mut board, "release");
        board
    };
    (1..=count).map(one).collect()
}

fn send(bus: &mut Bus, frame: Frame) {
    let now_s = bus.seconds();
    bus.stations[0].send(now_s, frame);
}

/// Sends a request and returns the replies of the next milliseconds: who, and what without padding.
fn exchange(bus: &mut Bus, frame: Frame) -> Vec<(u32, Vec<u8>)> {
    bus.stations[0].received.clear();
    send(bus, frame);
    bus.run(5e-3).expect("a run");
    let replies = core::mem::take(&mut bus.stations[0].received);
    let unpadded = |data: &[u8]| data[..data.iter().rposition(|byte| *byte != 0x50).map_or(0, |at| at + 1)].to_vec();
    replies.iter().map(|(_, frame)| (frame.id, unpadded(&frame.data))).collect()
}

/// The reply to [`WHERE`] of a drive.
fn place(bus: &mut Bus, id: u32) -> f32 {
    let replies = exchange(bus, request(id, &WHERE));
    let [(source, bytes)] = &replies[..] else { panic!("{replies:?}") };
    assert_eq!((*source, &bytes[..2]), (id << 8, &[0x2d, 0x01][..]));
    f32::from_le_bytes(bytes[2..6].try_into().expect("four bytes"))
}

/// Nothing is wrong, no control period was lost, and none took longer than is promised.
fn unharmed(board: &Session) {
    assert_eq!(Outcome::of(board).verdict(), [""; 0]);
}

#[test]
fn each_answers_to_its_own_identifier_and_all_to_broadcasts() {
    let mut bus = Bus::of_running(boards(3), vec![client()]);
    bus.run(0.2).unwrap();
    for id in 1..=3 {
        assert_eq!(exchange(&mut bus, request(id, &QUERY)), [(id << 8, vec![0x21, 0x00, 0x00, 0x21, 0x0f, 0x00])]);
    }
    assert_eq!(health(&mut bus), [0; 5]);
    assert_eq!(exchange(&mut bus, request(4, &QUERY)), [], "there is none");
    assert_eq!(exchange(&mut bus, Frame::switched(0x0001, false, &QUERY)), [], "no reply is asked for");
    assert_eq!(exchange(&mut bus, request(0x1_0001, &QUERY)), [], "another prefix");
    let mut sources: Vec<u32> = exchange(&mut bus, request(0x7f, &QUERY)).iter().map(|(id, _)| *id).collect();
    sources.sort_unstable();
    assert_eq!(sources, [0x100, 0x200, 0x300]);
    ask(&mut bus.boards[1], "set bus_id 77");
    ask(&mut bus.boards[2], "set bus_prefix 5");
    bus.run(0.2).unwrap();
    assert_eq!(exchange(&mut bus, request(2, &QUERY)), []);
    assert_eq!(exchange(&mut bus, request(77, &QUERY)).len(), 1);
    assert_eq!(exchange(&mut bus, request(3, &QUERY)), []);
    assert_eq!(exchange(&mut bus, request(0x5_0003, &QUERY)), [(0x5_0300, vec![0x21, 0x00, 0x00, 0x21, 0x0f, 0x00])]);
    bus.boards.iter().for_each(unharmed);
}

/// Brings drives to the positions of a step, each at its own, and returns where they are.
fn go(bus: &mut Bus, steps: u32, target: impl Fn(u32, u32) -> f32) {
    let count = bus.boards.len() as u32;
    for step in 0..steps {
        for id in 1..=count {
            send(bus, Frame::switched(id, true, &position(target(id, step))));
        }
        bus.run(10e-3).expect("a run");
    }
}

/// Drives move together: each to its own place, and there at the same time.
fn coordinated(count: u32) {
    let mut bus = Bus::of_running(boards(count), vec![client()]);
    // Who has got another identifier listens to it after a tenth of a second.
    bus.run(0.2).unwrap();
    let starts: Vec<f32> = (1..=count).map(|id| place(&mut bus, id)).collect();
    let from = |id: u32| starts[id as usize - 1];
    let way = |id: u32| 0.05 * id as f32;
    // Time to arm, where it is.
    go(&mut bus, 80, |id, _| from(id));
    for id in 1..=count {
        assert_eq!(exchange(&mut bus, request(id, &QUERY)), [(id << 8, vec![0x21, 0x00, 0x0a, 0x21, 0x0f, 0x00])]);
    }
    go(&mut bus, 100, |id, step| from(id) + way(id) * (step + 1) as f32 / 100.0);
    go(&mut bus, 30, |id, _| from(id) + way(id));
    for id in 1..=count {
        let moved = place(&mut bus, id) - from(id);
        assert!((moved - way(id)).abs() < 0.01, "drive {id} has moved by {moved}, not {}", way(id));
    }
    for id in 1..=count {
        send(&mut bus, Frame::switched(id, true, &STOP));
    }
    bus.run(0.1).unwrap();
    bus.boards.iter().for_each(|board| assert!(!board.machine.system.bridge_is_on()));
    bus.boards.iter().for_each(unharmed);
    assert_eq!(bus.wire.errors, 0);
}

#[test]
fn three_move_together() {
    coordinated(3);
}

/// Too long for every time: `cargo test --release -p virtual --test bus -- --ignored`.
#[test]
#[ignore = "minutes"]
fn ten_move_together() {
    coordinated(10);
}

#[test]
fn a_flood_costs_no_control_period() {
    flood(NUCLEO, 0);
}

#[test]
fn a_flood_costs_the_smallest_board_no_control_period() {
    // Its firmware for the bus is not the one of the promise, and the tasks share its flash: 748 in the mean, not 745.
    flood(ESC_ON_BUS, 10);
}

/// The bus is full of frames for everybody, and of such that are for another one.
fn flood(board: &str, more_cycles: u64) {
    let mut turning = common::turning(board);
    turning.watch_control();
    let mut bus = Bus::of_running(vec![turning], vec![client(), client()]);
    bus.run(1e-3).unwrap();
    for (id, bytes) in [(0x8001, &QUERY[..]), (0x007f, &[0x50; 64]), (0x0001, &STOP[..0]), (0x0022, &[])] {
        let busy_s = bus.wire.busy_s;
        let from_s = bus.seconds();
        while bus.seconds() < from_s + 0.2 {
            while bus.stations[0].waiting() < 4 {
                send(&mut bus, Frame::switched(id, true, bytes));
            }
            bus.step().unwrap();
        }
        let share = (bus.wire.busy_s - busy_s) / (bus.seconds() - from_s);
        assert!(share > 0.98, "{id:#x}: {share}");
    }
    assert!(!bus.stations[1].received.is_empty());
    let board = &bus.boards[0];
    let speed = common::motor(board, "speed / rad/s");
    assert!((speed - 40.0).abs() < 4.0, "it turns on: {speed}");
    let outcome = Outcome::of(board);
    assert_eq!(outcome.verdict(), [""; 0]);
    let control = outcome.control.expect("a control interrupt");
    let [mean, most, _] = board.board().promises.control_cycles;
    let (seen, longest) = (control.mean_cycles[0], control.cycles.max);
    assert!(seen <= (mean + more_cycles) as f64 && longest <= most as f64, "{seen} {longest}");
    // It answers still, if not while a task computes a new model of the Halls.
    bus.run(0.1).unwrap();
    bus.stations[0].received.clear();
    send(&mut bus, request(1, &QUERY));
    bus.run(50e-3).unwrap();
    assert_eq!(bus.stations[0].received.len(), 1);
}

/// The B-G431B-ESC1's firmware for a bus has no procedures.
#[test]
fn what_a_firmware_does_not_have_is_refused_in_words() {
    let mut board = calibrated(ESC_ON_BUS);
    for what in ["identify", "learn-cogging"] {
        let answer = ask(&mut board, what);
        assert!(answer.contains("Elsewhere"), "{answer}");
    }
    common::run(&mut board, 0.1);
    assert!(!board.machine.system.bridge_is_on() && ask(&mut board, "status").contains("activity: None"));
}

/// A board at the wrong rate is off the bus after its first words and comes back; the others go on.
#[test]
fn who_has_the_wrong_rate_goes_off_and_the_others_go_on() {
    let slow = Timing { nominal: Rate::new(80e6, 1, [58, 31, 31]), ..Timing::fast() };
    let mut bus = Bus::of_running(boards(2), vec![client(), Station::new(slow)]);
    bus.run(0.2).unwrap();
    assert_eq!(exchange(&mut bus, request(2, &QUERY)).len(), 1, "once the other is passive");
    assert_eq!(bus.stations[1].state(), State::Passive);
    let now_s = bus.seconds();
    bus.stations[1].send(now_s, request(1, &QUERY));
    bus.run(20e-3).unwrap();
    assert_eq!(bus.stations[1].state(), State::Off);
    for _ in 0..20 {
        assert_eq!(exchange(&mut bus, request(1, &QUERY)).len(), 1);
    }
    bus.boards.iter().for_each(unharmed);
}

/// The board is the one whose rate is not the others': it goes off, and comes back when they have gone.
#[test]
fn a_board_among_others_of_another_rate_goes_off_and_comes_back() {
    let slow = Timing { nominal: Rate::new(80e6, 1, [58, 31, 31]), ..Timing::fast() };
    let mut bus = Bus::of_running(boards(1), vec![client(), Station::new(slow), Station::new(slow)]);
    bus.run(1e-3).unwrap();
    // It hears its client while the others are not there, and has something to say when they come.
    bus.stations[1].silent = true;
    bus.stations[2].silent = true;
    for _ in 0..40 {
        send(&mut bus, request(1, &QUERY));
    }
    bus.run(2e-3).unwrap();
    bus.stations[1].silent = false;
    bus.stations[2].silent = false;
    for at in 0..400 {
        let now_s = bus.seconds();
        bus.stations[1 + at % 2].send(now_s, Frame::switched(0x300 + at as u32, false, &[0; 8]));
        bus.run(0.2e-3).unwrap();
    }
    assert!(happened(&bus.boards[0], "bus-off"));
    bus.stations.truncate(1);
    bus.stations[0].restart();
    bus.run(0.3).unwrap();
    assert!(happened(&bus.boards[0], "on the bus again"));
    assert_eq!(exchange(&mut bus, request(1, &QUERY)).len(), 1);
    unharmed(&bus.boards[0]);
    // Coming back has cleared the error counters.
    let [transmit, _, passive, off, lost] = health(&mut bus);
    let times =
        bus.boards[0].machine.system.facts().events.iter().filter(|(_, event)| event.contains("bus-off")).count();
    assert_eq!((transmit, passive, off), (0, 0, times as i16));
    assert!(lost > 0, "forty requests in two milliseconds are more than wait");
}

/// What a client reads of the bus: the error counters of sending and receiving, whether passive, how often off, frames lost.
fn health(bus: &mut Bus) -> [i16; 5] {
    // Five of int16 from 0x700 on.
    let replies = exchange(bus, request(1, &[0x14, 0x05, 0x80, 0x0e]));
    let [(0x100, bytes)] = &replies[..] else { panic!("{replies:?}") };
    assert_eq!(bytes[..4], [0x24, 0x05, 0x80, 0x0e], "{bytes:x?}");
    core::array::from_fn(|index| i16::from_le_bytes([bytes[4 + 2 * index], bytes[5 + 2 * index]]))
}

fn happened(board: &Session, what: &str) -> bool {
    board.machine.system.facts().events.iter().any(|(_, event)| event.contains(what))
}

/// Frames of every form and content, whatever they say: the drive neither stumbles nor moves.
#[test]
fn nothing_that_comes_moves_a_drive_that_is_not_calibrated() {
    let mut random = Pcg64::seed_from_u64(1);
    let mut bus = Bus::of_running(vec![session(NUCLEO, "")], vec![client(), client()]);
    bus.run(0.05).unwrap();
    for _ in 0..4000 {
        let mut data = vec![0; LENGTHS[random.random_range(0..16)]];
        random.fill(&mut data[..]);
        let [fd, extended, remote] = [0.8, 0.7, 0.1].map(|share| random.random_bool(share));
        let id = random.random::<u32>() & 0x1fff_ff00 & if extended { 0xffff } else { 0x7ff } | 1;
        data.truncate(if fd { 64 } else { 8 });
        let frame = Frame { id, extended, remote: remote && !fd, fd, switched: fd, passive: false, data };
        send(&mut bus, Frame { data: if frame.remote { vec![0; frame.data.len()] } else { frame.data }, ..frame });
        if bus.stations[0].waiting() > 8 {
            bus.run(1e-3).unwrap();
        }
    }
    bus.run(0.2).unwrap();
    assert!(!bus.boards[0].machine.system.bridge_is_on());
    assert!(bus.boards[0].resets.is_empty() && bus.wire.errors == 0);
    // Whoever it was has told it to stop, or nothing.
    assert_eq!(exchange(&mut bus, request(1, &STOP)), []);
    assert_eq!(exchange(&mut bus, request(1, &QUERY))[0].1[..3], [0x21, 0x00, 0x00]);
    unharmed(&bus.boards[0]);
}

#[test]
fn a_flood_does_not_keep_a_calibration_from_its_end() {
    flood_a_calibration(NUCLEO);
}

#[test]
fn a_flood_does_not_keep_the_smallest_board_from_calibrating() {
    flood_a_calibration(ESC_ON_BUS);
}

/// The fit of a calibration and its save take the tasks longest; the watchdog is fed all the same, and what is asked
/// meanwhile is answered or lost, but nothing else.
fn flood_a_calibration(board: &str) {
    let mut bus = Bus::of_running(vec![common::calibrating(board)], vec![client(), client()]);
    bus.run(1e-3).unwrap();
    while bus.boards[0].machine.system.facts().flash_operations < 10 {
        while bus.stations[0].waiting() < 4 {
            send(&mut bus, request(1, &QUERY));
        }
        bus.step().unwrap();
        assert!(bus.seconds() < 8.0, "it is not saved");
    }
    bus.run(0.5).unwrap();
    assert!(bus.boards[0].resets.is_empty());
    assert_eq!(exchange(&mut bus, request(1, &QUERY)).len(), 1);
    let status = ask(&mut bus.boards[0], "status");
    assert!(status.contains("calibrated: true"), "{status}");
}
