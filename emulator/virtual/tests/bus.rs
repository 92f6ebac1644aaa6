//! Boards on one CAN.

mod common;

use chip::can::frame::Frame;
use chip::can::station::Station;
use chip::can::timing::Timing;
use common::{NUCLEO, session};
use virtual_board::bus::Bus;

#[test]
fn first() {
    let station = Station::new(Timing::fast());
    let mut bus = Bus::of_running(vec![session(NUCLEO, "")], vec![station]);
    let start = std::time::Instant::now();
    bus.run(0.1).unwrap();
    eprintln!("{:?}", start.elapsed());
    bus.stations[0].send(0.0, Frame::switched(0x8001, true, &[1, 2, 3, 4, 5, 6, 7, 8, 9]));
    bus.stations[0].send(0.0, Frame::switched(0x8002, true, &[1, 2, 3, 4, 5, 6, 7, 8, 9]));
    bus.run(0.01).unwrap();
    eprintln!("{:?} {:?}", bus.stations, bus.wire);
    let outcome = virtual_board::outcome::Outcome::of(&bus.boards[0]);
    eprintln!("{:#?} {:?}", outcome.verdict(), outcome.facts.clocks);
    for line in &bus.boards[0].lines { eprintln!("{line:?}"); }
}
