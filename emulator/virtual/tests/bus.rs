//! Boards on one CAN, and clients of the register protocol there.

mod common;

use chip::can::counters::State;
use chip::can::frame::Frame;
use chip::can::station::Station;
use chip::can::timing::{Rate, Timing};
use common::{NUCLEO, ask, calibrated, session};
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
    bus.run(1e-3).unwrap();
    for id in 1..=3 {
        assert_eq!(exchange(&mut bus, request(id, &QUERY)), [(id << 8, vec![0x21, 0x00, 0x00, 0x21, 0x0f, 0x00])]);
    }
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
