//! FDCAN1 through the bus and at its pins, with other nodes on the wire.

mod common;

use bus::{Complaint, Cycle};
use chip::can::counters::State;
use chip::can::frame::Frame;
use chip::can::station::Station;
use chip::can::timing::{Rate, Timing};
use chip::can::wire::{Node, STEP_S, Wire};
use common::{Bench, RCC, esc, nucleo};

const CAN: u32 = 0x4000_6400;
const RAM: u32 = 0x4000_a400;
const CCCR: u32 = CAN + 0x18;
const ECR: u32 = CAN + 0x40;
const PSR: u32 = CAN + 0x44;
const IR: u32 = CAN + 0x50;
const RXGFC: u32 = CAN + 0x80;
const RXF0S: u32 = CAN + 0x90;
const TXFQS: u32 = CAN + 0xc4;
const TXBRP: u32 = CAN + 0xc8;
const TXBAR: u32 = CAN + 0xcc;

/// 170 tq of 1/170 µs; sampled at 67 %.
const NOMINAL: u32 = 55 << 25 | 112 << 8 | 55;
/// 34 tq; delay compensated.
const DATA: u32 = 1 << 23 | 20 << 8 | 11 << 4 | 11;

/// A chip with its controller set up as its firmware would; the tests' wire goes on with it.
struct Rig {
    bench: Bench,
    wire: Wire,
}

impl Rig {
    fn new() -> Self {
        Self::with(NOMINAL, DATA, 22 << 8)
    }

    fn with(nominal: u32, data: u32, delay: u32) -> Self {
        let mut bench = Bench::new(&nucleo());
        bench.clocks();
        bench.set(RCC + 0x58, 1 << 25);
        bench.set(RCC + 0x88, 2 << 24);
        bench.alternate(b'B', 9, 9);
        bench.alternate(b'A', 11, 9);
        configure(&mut bench);
        bench.write(CCCR, 3 | 1 << 8 | 1 << 9);
        bench.write(CAN + 0x1c, nominal);
        bench.write(CAN + 0x0c, data);
        bench.write(CAN + 0x48, delay);
        bench.write(CAN + 0xdc, 7);
        bench.write(CCCR, 1 << 8 | 1 << 9);
        Self { bench, wire: Wire::default() }
    }

    fn seconds(&self) -> f64 {
        use bus::Bus;
        self.bench.chip.seconds(self.bench.now)
    }

    /// Runs the chip and the wire, for these microseconds.
    fn run(&mut self, microseconds: u32, others: &mut [&mut Station]) {
        let steps = (f64::from(microseconds) * 1e-6 / STEP_S).ceil() as u32;
        for _ in 0..steps {
            self.bench.run((STEP_S * 170e6) as Cycle);
            let now_s = self.seconds();
            let mut nodes: Vec<&mut dyn Node> = vec![self.bench.chip.can()];
            nodes.extend(others.iter_mut().map(|other| &mut **other as &mut dyn Node));
            self.wire.settle(&mut nodes, now_s);
        }
    }

    fn read(&mut self, address: u32) -> u32 {
        self.bench.read(address)
    }

    fn put(&mut self, buffer: u32, frame: &Frame) {
        let id = if frame.extended { frame.id | 1 << 30 } else { frame.id << 18 };
        let base = RAM + 0x278 + 72 * buffer;
        self.bench.write(base, id);
        let format = u32::from(frame.fd) << 21 | u32::from(frame.switched) << 20;
        self.bench.write(base + 4, format | frame.code() << 16);
        for (at, bytes) in frame.data.chunks(4).enumerate() {
            let word = bytes.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte));
            self.bench.write(base + 8 + 4 * at as u32, word);
        }
        self.bench.write(TXBAR, 1 << buffer);
    }

    fn counters(&mut self) -> [u32; 2] {
        let ecr = self.read(ECR);
        [ecr & 0xff, ecr >> 8 & 0x7f]
    }
}

/// INIT, and then CCE, which cannot be set without it.
fn configure(bench: &mut Bench) {
    for control in [1, 3] {
        let kept = bench.read(CCCR) & !3;
        bench.write(CCCR, kept | control);
    }
}

fn adapter() -> Station {
    Station::new(Timing::fast())
}

fn frame(id: u32, bytes: u8) -> Frame {
    Frame::switched(id, id > 0x7ff, &(0..bytes).collect::<Vec<u8>>())
}

#[test]
fn a_frame_goes_out_and_is_acknowledged() {
    let (mut rig, mut other) = (Rig::new(), adapter());
    rig.run(100, &mut [&mut other]);
    assert_eq!(rig.read(PSR) & 0x18, 1 << 3, "idle, after eleven recessive bits");
    let asked_s = rig.seconds();
    rig.put(0, &frame(0x100, 8));
    rig.run(300, &mut [&mut other]);
    let (at_s, seen) = other.received.remove(0);
    assert_eq!(seen, frame(0x100, 8));
    let [nominal, data] = seen.bits().map(f64::from);
    let took_s = (nominal - 1.0) * 1e-6 + data * 0.2e-6;
    let waited_s = at_s - took_s - asked_s;
    assert!((0.0..1e-6).contains(&waited_s), "begins when it is asked for: {waited_s}");
    assert_eq!((rig.read(TXBRP), rig.read(CAN + 0xd4)), (0, 1));
    assert_eq!(rig.read(IR) & (1 << 7 | 1 << 9), 1 << 7 | 1 << 9);
    assert_eq!(rig.read(PSR) & 0x707, 0, "no error, in neither phase");
    assert_eq!(rig.read(PSR) & 0x707, 0x707, "no change since it was read");
}

#[test]
fn frames_come_in_by_the_filters_and_the_fifo_overflows() {
    let (mut rig, mut other) = (Rig::new(), adapter());
    configure(&mut rig.bench);
    rig.bench.write(CCCR, 3 | 1 << 8 | 1 << 9);
    rig.bench.write(RXGFC, 1 << 24 | 2 << 2 | 2 << 4);
    rig.bench.write(RAM + 0x70, 1 << 29 | 1);
    rig.bench.write(RAM + 0x74, 2 << 30 | 0x1fff_00ff);
    rig.bench.write(CAN + 0x54, 1);
    rig.bench.write(CAN + 0x5c, 1);
    rig.bench.write(CCCR, 1 << 8 | 1 << 9);
    rig.run(60, &mut [&mut other]);
    for id in [0x8002, 0x8001, 0x0001, 0x1_8001] {
        other.send(0.0, Frame { extended: true, ..frame(id, 5) });
    }
    rig.run(600, &mut [&mut other]);
    assert_eq!(other.sent, 4, "acknowledged, whether a filter knows it or not");
    assert_eq!(rig.read(RXF0S), 2 | 2 << 16);
    assert_eq!(rig.read(RAM + 0xb0), 0x8001 | 1 << 30);
    assert_eq!(rig.read(RAM + 0xb4) & !0xffff, 1 << 21 | 1 << 20 | 5 << 16);
    assert_eq!(rig.read(RAM + 0xb8), 0x0302_0100);
    assert_ne!(bus::Bus::interrupts(&rig.bench.chip) >> 21 & 1, 0);
    rig.bench.write(CAN + 0x94, 0);
    assert_eq!(rig.read(RXF0S), 1 | 1 << 8 | 2 << 16);
    for _ in 0..3 {
        other.send(0.0, Frame { extended: true, ..frame(0x8001, 64) });
    }
    rig.run(1000, &mut [&mut other]);
    assert_eq!(rig.read(RXF0S), 3 | 1 << 8 | 1 << 16 | 1 << 24 | 1 << 25, "full, and one is lost");
    assert_eq!(rig.read(IR) & 7, 7);
    rig.bench.write(IR, 7);
    assert_eq!(bus::Bus::interrupts(&rig.bench.chip) >> 21 & 1, 0);
}

#[test]
fn the_more_urgent_goes_first_whoever_sends_it() {
    let (mut rig, mut other) = (Rig::new(), adapter());
    let mut third = adapter();
    rig.run(60, &mut [&mut other, &mut third]);
    let at_s = rig.seconds() + 200e-6;
    other.send(at_s - 150e-6, frame(0x700, 64));
    third.send(at_s - 20e-6, frame(0x050, 1));
    rig.run(140, &mut [&mut other, &mut third]);
    for (buffer, id) in [(0, 0x300), (1, 0x100), (2, 0x8001)] {
        rig.put(buffer, &frame(id, 1));
    }
    assert_eq!(rig.read(TXFQS) >> 21 & 1, 1, "all three are taken");
    rig.run(1000, &mut [&mut other, &mut third]);
    let ids: Vec<u32> = third.received.iter().map(|(_, frame)| frame.id).collect();
    assert_eq!(ids, [0x700, 0x300, 0x100, 0x8001], "as a FIFO, and after what was on the wire");
    let ids: Vec<u32> = other.received.iter().map(|(_, frame)| frame.id).collect();
    assert_eq!(ids, [0x050, 0x300, 0x100, 0x8001]);
}

#[test]
fn nobody_there_is_no_bus_off_and_a_disconnected_node_is() {
    let mut rig = Rig::new();
    rig.run(60, &mut []);
    rig.put(0, &frame(1, 0));
    rig.run(20_000, &mut []);
    assert_eq!(rig.counters(), [128, 0]);
    assert_eq!(rig.read(PSR) & 0xe7, 3 | 1 << 5 | 1 << 6, "acknowledge error, passive");
    assert_eq!(rig.read(TXBRP), 1, "it goes on");
    let mut other = adapter();
    rig.run(1000, &mut [&mut other]);
    assert_eq!((other.received.len(), rig.counters()), (1, [127, 0]));

    let mut rig = Rig::new();
    rig.bench.alternate(b'B', 9, 7);
    rig.run(60, &mut [&mut other]);
    rig.put(0, &frame(1, 0));
    rig.run(3000, &mut [&mut other]);
    assert_ne!(rig.read(PSR) >> 7 & 1, 0, "it never sees its own bits");
    assert_eq!(other.failed, 0);
}

/// 900 kbit/s: nothing comes through while it has its say; then the others go on without it.
#[test]
fn a_wrong_nominal_rate_is_disturbing_then_passive_and_bus_off_when_it_sends() {
    let mut rig = Rig::with(60 << 25 | 126 << 8 | 60, DATA, 22 << 8);
    let (mut one, mut two) = (adapter(), adapter());
    rig.run(60, &mut [&mut one, &mut two]);
    one.send(0.0, frame(0x200, 8));
    rig.run(3000, &mut [&mut one, &mut two]);
    assert_eq!(rig.read(RXF0S), 0, "nothing wrong is delivered");
    assert_eq!((one.sent, two.received.len()), (1, 1));
    assert_eq!(rig.counters()[1], 127);
    assert_ne!(rig.read(PSR) & 1 << 5, 0, "passive");
    assert!((14..=16).contains(&one.failed), "{}", one.failed);
    rig.put(0, &frame(0x001, 8));
    rig.run(5000, &mut [&mut one, &mut two]);
    assert_ne!(rig.read(PSR) & 1 << 7, 0, "bus-off");
    assert_eq!(rig.read(CCCR) & 1, 1, "INIT is set");
    assert_ne!(rig.read(IR) & 1 << 19, 0);
    assert_eq!(one.received.len() + two.received.len(), 1);
    two.send(0.0, frame(0x300, 8));
    rig.run(1000, &mut [&mut one, &mut two]);
    assert_eq!(one.received.len(), 1, "the others go on");
}

#[test]
fn a_wrong_data_rate_shows_only_where_the_rate_is_switched() {
    let mut rig = Rig::with(NOMINAL, 1 << 23 | 26 << 8 | 15 << 4 | 15, 22 << 8);
    let mut other = adapter();
    rig.run(60, &mut [&mut other]);
    other.send(0.0, Frame { switched: false, ..frame(0x200, 8) });
    rig.run(300, &mut [&mut other]);
    assert_eq!((other.sent, rig.read(RXF0S) & 0x7f), (1, 1));
    other.send(0.0, frame(0x200, 8));
    rig.run(300, &mut [&mut other]);
    assert_eq!(rig.read(RXF0S) & 0x7f, 1);
    assert!(other.failed > 0 && other.sent == 1, "disturbed");
    assert_eq!(rig.read(PSR) >> 8 & 7, 1, "stuff error, in the data phase");
}

#[test]
fn recovery_from_bus_off_takes_129_sequences_of_eleven_recessive_bits() {
    let (mut rig, mut other) = (Rig::new(), adapter());
    rig.run(60, &mut [&mut other]);
    rig.bench.alternate(b'B', 9, 7);
    rig.put(0, &frame(0x001, 8));
    rig.run(3000, &mut [&mut other]);
    assert_ne!(rig.read(PSR) & 1 << 7, 0);
    rig.bench.alternate(b'B', 9, 9);
    rig.run(3000, &mut [&mut other]);
    assert_ne!(rig.read(PSR) & 1 << 7, 0, "not by itself");
    rig.bench.write(IR, 1 << 19);
    rig.bench.write(CCCR, 1 << 8 | 1 << 9);
    rig.run(127 * 11, &mut [&mut other]);
    assert_ne!(rig.read(PSR) & 1 << 7, 0, "not yet");
    rig.run(60, &mut [&mut other]);
    assert_eq!(rig.read(PSR) & 0xe0, 0);
    assert_eq!(rig.counters(), [0, 0]);
    assert_ne!(rig.read(IR) & 1 << 19, 0, "told, too");
}

#[test]
fn without_compensation_of_the_delay_a_sender_at_5_mbit_s_does_not_see_its_own_bits() {
    for (data, delay, passes) in
        [(DATA, 22 << 8, true), (DATA & !(1 << 23), 0, false), (DATA, 0, false), (DATA, 60 << 8, false)]
    {
        let (mut rig, mut other) = (Rig::with(NOMINAL, data, delay), adapter());
        rig.run(60, &mut [&mut other]);
        rig.put(0, &frame(0x100, 8));
        rig.run(300, &mut [&mut other]);
        assert_eq!(other.received.len() == 1, passes, "{data:#x} {delay:#x}");
        let told = rig.read(PSR) >> 16 & 0x7f;
        // 255 ns of 170 MHz are 44 periods.
        assert_eq!(told, if data >> 23 == 0 { 0 } else { 44 + (delay >> 8) }, "TDCV");
    }
    // At 2 Mbit/s the sample point is late enough.
    let mut rig = Rig::with(NOMINAL, 4 << 16 | 10 << 8 | 4 << 4 | 4, 0);
    let timing = rig.bench.chip.can().timing();
    let mut other = Station::new(Timing { data: timing.data, ..Timing::fast() });
    rig.run(60, &mut [&mut other]);
    rig.put(0, &frame(0x100, 8));
    rig.run(300, &mut [&mut other]);
    assert_eq!(other.received.len(), 1);
}

/// The internal oscillator is good to 1 %.
#[test]
fn clocks_that_differ_by_two_percent_understand_each_other_and_by_four_do_not() {
    for (share, heard) in [(0.02, true), (-0.02, true), (0.04, false), (-0.04, false)] {
        let (mut rig, mut other) = (Rig::new(), Station::new(Timing::fast().off_by(share)));
        rig.run(60, &mut [&mut other]);
        other.send(0.0, frame(0x200, 64));
        rig.run(300, &mut [&mut other]);
        assert_eq!(rig.read(RXF0S) & 0x7f, u32::from(heard), "{share}");
    }
}

#[test]
fn two_with_one_identifier_disturb_each_other() {
    let (mut one, mut two, mut rig) = (adapter(), adapter(), Rig::new());
    rig.run(60, &mut [&mut one, &mut two]);
    one.send(1e-3, frame(0x200, 8));
    two.send(1e-3, frame(0x200, 7));
    rig.run(10_000, &mut [&mut one, &mut two]);
    assert_eq!(rig.read(RXF0S), 0);
    assert!(one.state() == State::Off && two.state() == State::Off);
}

#[test]
fn a_node_of_the_classic_format_destroys_fd_frames() {
    let (mut one, mut two, mut rig) = (adapter(), adapter(), Rig::new());
    two.fd = false;
    rig.run(60, &mut [&mut one, &mut two]);
    one.send(0.0, frame(0x200, 8));
    rig.run(300, &mut [&mut one, &mut two]);
    assert_eq!((rig.read(RXF0S), one.sent), (0, 0));
    rig.put(0, &Frame { id: 5, data: vec![1, 2], ..Frame::default() });
    rig.run(5000, &mut [&mut one, &mut two]);
    assert_eq!(two.received[0].1, Frame { id: 5, data: vec![1, 2], ..Frame::default() });
}

#[test]
fn what_is_wrong_is_complained_of() {
    let mut bench = Bench::new(&esc());
    bench.clocks();
    assert_eq!(bench.try_write(CCCR, 1), Some(Complaint::Unclocked { peripheral: "FDCAN1" }));
    assert_eq!(bench.try_write(RAM, 1), Some(Complaint::Unclocked { peripheral: "FDCAN RAM" }));
    bench.set(RCC + 0x58, 1 << 25);
    assert_eq!(bench.read(CAN + 4), 0x8765_4321);
    let complaint = |bench: &mut Bench, address, value| bench.try_write(address, value).unwrap().to_string();
    assert!(complaint(&mut bench, CAN + 0x1c, 1).contains("without INIT and CCE"));
    assert!(complaint(&mut bench, TXBAR, 1).contains("while INIT is set"));
    assert!(complaint(&mut bench, CCCR, 0).contains("kernel clock does not run"));
    bench.set(RCC + 0x88, 2 << 24);
    configure(&mut bench);
    bench.write(CAN + 0x1c, 60 << 25 | 112 << 8 | 55);
    assert!(complaint(&mut bench, CCCR, 0).contains("jump width"));
    configure(&mut bench);
    bench.write(CAN + 0x1c, 20 << 25 | 60 << 8 | 20);
    assert!(complaint(&mut bench, CCCR, 0).contains("more than 1 Mbit/s"));
    configure(&mut bench);
    assert!(complaint(&mut bench, CCCR, 3 | 1 << 7).contains("not modelled"));
    assert!(complaint(&mut bench, RAM + 0x350, 1).contains("not modelled"), "that of FDCAN2");
    assert_eq!(bench.try_write(CAN + 0x400, 1), Some(Complaint::Unmapped), "the small chip has one");
}

#[test]
fn the_transceiver_of_the_esc_has_to_be_switched_on() {
    for (level, heard) in [(false, 1), (true, 0)] {
        let mut rig = Rig::new();
        rig.bench = Bench::new(&esc());
        let bench = &mut rig.bench;
        bench.clocks();
        bench.set(RCC + 0x58, 1 << 25);
        bench.set(RCC + 0x88, 2 << 24);
        bench.alternate(b'B', 9, 9);
        bench.alternate(b'A', 11, 9);
        bench.write(0x4800_0818, 1 << if level { 11 } else { 27 });
        let moder = bench.read(0x4800_0800);
        bench.write(0x4800_0800, moder & !(3 << 22) | 1 << 22);
        configure(bench);
        bench.write(CCCR, 3 | 1 << 8 | 1 << 9);
        bench.write(CAN + 0x1c, NOMINAL);
        bench.write(CAN + 0x0c, DATA);
        bench.write(CAN + 0x48, 22 << 8);
        bench.write(CCCR, 1 << 8 | 1 << 9);
        let (mut one, mut two) = (adapter(), adapter());
        rig.run(60, &mut [&mut one, &mut two]);
        one.send(0.0, frame(0x200, 8));
        rig.run(300, &mut [&mut one, &mut two]);
        assert_eq!((two.received.len(), rig.read(RXF0S) & 0x7f), (1, heard));
    }
}

#[test]
fn rates_are_those_of_the_registers() {
    let mut rig = Rig::new();
    let timing = rig.bench.chip.can().timing();
    assert_eq!(timing.nominal, Rate::new(170e6, 1, [113, 56, 56]));
    assert!((timing.nominal.bit_s() - 1e-6).abs() < 1e-15 && (timing.data.bit_s() - 200e-9).abs() < 1e-15);
}
