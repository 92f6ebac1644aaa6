//! Frames and lines that are damaged, cut, mixed or made up.

use hallservo_registers::axis::{Axis, Command, Identity, Mode, Refused, State};
use hallservo_registers::frame::{Bytes, NOP, padded};
use hallservo_registers::register::{Access, TABLE};
use hallservo_registers::{Address, FRAME, NoTunnel, Reply, Request, Server, Tunnel, line, register};
use proptest::prelude::*;

/// Counts what it is told.
#[derive(Default)]
struct Counter {
    commands: u32,
    stops: u32,
    changes: u32,
    refuses: bool,
}

impl Counter {
    fn told(&self) -> u32 {
        self.commands + self.stops + self.changes
    }

    fn answer(&mut self) -> Result<(), Refused> {
        self.changes += 1;
        if self.refuses { Err(Refused) } else { Ok(()) }
    }
}

impl Axis for Counter {
    fn identity(&self) -> Identity {
        Identity { model: 4, firmware: 0x0001_0203, serial: [1, 2, 3] }
    }

    fn state(&self) -> State {
        State { mode: Mode::Stopped, position: 0.5, voltage: 24.0, temperature: 20.0, ..State::UNKNOWN }
    }

    fn command(&mut self, command: &Command) -> Result<(), Refused> {
        if *command == Command::Stop {
            self.stops += 1;
            return Ok(());
        }
        self.commands += 1;
        if self.refuses { Err(Refused) } else { Ok(()) }
    }

    fn set_output(&mut self, position: f32, _: bool) -> Result<(), Refused> {
        assert!(position.is_finite());
        self.answer()
    }

    fn require_reindex(&mut self) -> Result<(), Refused> {
        self.answer()
    }

    fn recapture(&mut self) -> Result<(), Refused> {
        self.answer()
    }
}

fn request(identifier: u32, bytes: &[u8]) -> Request {
    Request { identifier, bytes: Bytes::from_slice(bytes).unwrap() }
}

fn handle(counter: &mut Counter, bytes: &[u8]) -> Option<Reply> {
    Server::new(Address::default()).handle(&request(0x8001, bytes), counter, &mut NoTunnel)
}

/// A position, a velocity and a query: the documentation's example.
const EXAMPLE: &[u8] =
    &[0x01, 0x00, 0x0a, 0x07, 0x20, 0x60, 0x00, 0x20, 0x01, 0x50, 0xff, 0x14, 0x04, 0x00, 0x13, 0x0d];

#[test]
fn the_example_of_the_documentation() {
    let mut counter = Counter::default();
    let reply = handle(&mut counter, EXAMPLE).unwrap();
    assert_eq!(reply.identifier, 0x100);
    let expected = [0x24, 4, 0, 0, 0, 0x88, 0x13, 0x00, 0x80, 0x00, 0x80, 0x23, 0x0d, 48, 20, 0];
    assert_eq!((&reply.bytes[..], counter.commands), (&expected[..], 1));
}

#[test]
fn a_frame_is_done_as_a_whole_or_not_at_all() {
    let mut counter = Counter::default();
    for length in 1..EXAMPLE.len() {
        let whole = [3, 11, 14].contains(&length);
        let reply = handle(&mut counter, &EXAMPLE[..length]);
        assert_eq!(counter.told(), u32::from(whole), "{length}");
        assert_eq!(reply.is_some(), length == 14, "{length}");
        counter = Counter::default();
    }
    // An unknown register, one that is only read, a value that is none, and no mode: nothing happens.
    for bad in [&[0x01, 0x0f, 1][..], &[0x01, 0x2c, 0], &[0x01, 0x01, 0], &[0x01, 0x2d, 1]] {
        let frame = [&[0x01, 0x00, 0x0a], bad, &[0x11, 0x00]].concat();
        let reply = handle(&mut counter, &frame).unwrap();
        assert_eq!((counter.told(), &reply.bytes[..3]), (0, &[0x21, 0x00, 0x00][..]), "{bad:?}");
        assert_eq!(reply.bytes[3..5], [0x30, bad[1]], "{bad:?}");
    }
    assert!(handle(&mut counter, &[0x05, 0x20, 0, 0]).is_some() && counter.told() == 0);
    // Refused by the drive: it is said, and what the client reads comes first.
    counter.refuses = true;
    assert_eq!(handle(&mut counter, &[0x01, 0x00, 0x0a, 0x11, 0x00]).unwrap().bytes[..], [0x21, 0, 0, 0x30, 0, 3]);
}

#[test]
fn only_what_is_for_the_drive() {
    let mut counter = Counter::default();
    let mut server = Server::new(Address { id: 5, prefix: 0x123 });
    let stop = [0x01, 0x00, 0x00, 0x11, 0x00];
    for (identifier, answered) in [
        (0x0123_8005, Some(0x0123_0500)),
        (0x0123_a305, Some(0x0123_0523)),
        (0x0123_807f, Some(0x0123_0500)),
        (0x0123_0005, None),
        (0x0123_8006, None),
        (0x8005, None),
        (0x0124_8005, None),
        (0x0123_8085, None),
    ] {
        let before = counter.stops;
        let reply = server.handle(&request(identifier, &stop), &mut counter, &mut NoTunnel);
        assert_eq!(reply.map(|reply| reply.identifier), answered, "{identifier:x}");
        assert_eq!(counter.stops - before, u32::from(answered.is_some() || identifier == 0x0123_0005));
    }
    // By its UUID: the chip's serial number and the model.
    let mine = [&[0x0a, 0xd4, 0x02, 1, 0, 0, 0, 2, 0, 0, 0][..], &stop].concat();
    let other = [&[0x0a, 0xd4, 0x02, 1, 0, 0, 0, 9, 0, 0, 0][..], &stop].concat();
    counter = Counter::default();
    assert!(handle(&mut counter, &other).is_none() && counter.told() == 0);
    assert!(handle(&mut counter, &mine).is_some() && counter.stops == 1);
}

#[test]
fn every_register_is_answered_in_every_format() {
    let mut counter = Counter::default();
    for number in 0..0x200_u16 {
        for kind in [0x11, 0x15, 0x19, 0x1d] {
            let mut bytes = vec![kind, number as u8 & 0x7f | if number > 0x7f { 0x80 } else { 0 }];
            bytes.extend((number > 0x7f).then_some((number >> 7) as u8));
            let reply = handle(&mut counter, &bytes).unwrap();
            let row = TABLE.iter().find(|row| row.number == number);
            let word = row.is_some_and(|row| row.quantity == register::Quantity::Word);
            let readable = row.is_some_and(|row| row.access != Access::Write) && (!word || kind == 0x19);
            assert_eq!(reply.bytes[0], if readable { kind ^ 0x30 } else { 0x31 }, "{number:#x} {kind:#x}");
        }
    }
}

#[test]
fn the_table_is_in_order_and_has_names() {
    assert!(TABLE.windows(2).all(|rows| rows[0].number < rows[1].number));
    assert!(TABLE.iter().all(|row| register::name(row.number.into()).is_some()));
}

/// Says and hears.
struct Echo(Vec<u8>);

impl Tunnel for Echo {
    fn receive(&mut self, bytes: &[u8]) {
        self.0.extend(bytes);
    }

    fn transmit(&mut self, buffer: &mut [u8]) -> usize {
        let length = buffer.len().min(self.0.len());
        buffer[..length].copy_from_slice(&self.0[..length]);
        self.0.drain(..length);
        length
    }
}

#[test]
fn the_stream_comes_in_pieces() {
    let (mut server, mut counter, mut echo) = (Server::new(Address::default()), Counter::default(), Echo(vec![]));
    let mut ask = |bytes: &[u8], echo: &mut Echo| {
        server.handle(&request(0x8001, bytes), &mut counter, echo).map(|reply| reply.bytes.to_vec())
    };
    let hello = [&[0x40, 1, 5][..], b"hello"].concat();
    assert_eq!(ask(&hello, &mut echo).unwrap(), [&[0x41, 1, 5][..], b"hello"].concat());
    echo.0 = vec![7; 100];
    assert_eq!(ask(&[0x42, 1, 3], &mut echo).unwrap(), [0x41, 1, 3, 7, 7, 7]);
    // As much as a frame has room for.
    assert_eq!(ask(&[0x42, 1, 64], &mut echo).unwrap().len(), FRAME);
    // Numbered: again until it has arrived.
    let first = ask(&[0x44, 1, 0, 10], &mut echo).unwrap();
    assert_eq!(first[..4], [0x43, 1, 1, 10]);
    assert_eq!(ask(&[0x44, 1, 0, 10], &mut echo).unwrap(), first);
    let second = ask(&[0x44, 1, 1, 60], &mut echo).unwrap();
    assert_eq!((second[2], usize::from(second[3])), (2, 100 - 3 - 61 - 10));
    assert_eq!(ask(&[0x44, 1, 2, 60], &mut echo).unwrap()[2..], [2, 0]);
    echo.0 = vec![9];
    assert_eq!(ask(&[0x44, 1, 2, 60], &mut echo).unwrap()[2..], [3, 1, 9]);
    // Another channel is silent.
    assert_eq!(ask(&[0x42, 2, 60], &mut echo).unwrap(), [0x41, 2, 0]);
    assert_eq!(counter.told(), 0);
}

/// A line and what the decoder makes of it.
fn decode(decoder: &mut line::Decoder, bytes: &[u8]) -> Vec<Result<Request, line::Error>> {
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

/// With check sum, as `line::reply` makes it: its words exchanged for those of a request.
fn checked(content: &str) -> String {
    let sum = content.bytes().chain([b' ']).fold(0_u8, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| if crc & 0x80 != 0 { crc << 1 ^ 0x97 } else { crc << 1 })
    });
    format!("{content} *{sum:02X}\n")
}

#[test]
fn once_a_check_sum_was_seen_it_is_demanded() {
    let mut decoder = line::Decoder::new();
    let plain = b"can send 8001 010000\n";
    assert!(decode(&mut decoder, plain)[0].is_ok());
    assert_eq!(decode(&mut decoder, b"can send 8001 010000 *00\n"), [Err(line::Error::Checksum)]);
    // A wrong one was none.
    assert!(decode(&mut decoder, plain)[0].is_ok());
    assert!(decode(&mut decoder, checked("can send 8001 010000").as_bytes())[0].is_ok());
    assert_eq!(decode(&mut decoder, plain), [Err(line::Error::NoChecksum)]);
    // The client turns its own on by this word.
    assert!(line::error(line::Error::NoChecksum).as_str().starts_with("ERR checksum"));
    assert_eq!(line::ok().as_str(), "OK *BD\n");
}

#[test]
fn lines_that_are_none() {
    let mut decoder = line::Decoder::new();
    assert_eq!(decode(&mut decoder, b"\r\n \n\n"), []);
    for (text, error) in [
        ("can on", line::Error::Unknown),
        ("can  send 8001 00", line::Error::Unknown),
        ("Can send 8001 00", line::Error::Unknown),
        ("conf get id.id", line::Error::Unknown),
        ("can send", line::Error::Malformed),
        ("can send 20000000 00", line::Error::Malformed),
        ("can send 8001 0", line::Error::Malformed),
        ("can send 8001 0g", line::Error::Malformed),
        ("can send 8001 00 x", line::Error::Malformed),
        ("can send 800100000 00", line::Error::Malformed),
    ] {
        assert_eq!(decode(&mut decoder, format!("{text}\n").as_bytes()), [Err(error)], "{text}");
    }
    let long = format!("can send 8001 {}\n", "00".repeat(65));
    assert_eq!(decode(&mut decoder, long.as_bytes()), [Err(line::Error::Malformed)]);
    assert_eq!(decode(&mut decoder, &[b'c'; 300]), []);
    assert_eq!(decode(&mut decoder, b"\n"), [Err(line::Error::TooLong)]);
    // Noise spoils a line, and no more.
    assert_eq!(decode(&mut decoder, b"can send\x81 8001 010000\n"), []);
    assert!(decode(&mut decoder, b"can send 8001 010000\n")[0].is_ok());
}

#[test]
fn a_frame_of_the_other_protocol_hides_every_line_in_it() {
    let hostile = b"\ncan send 8001 01000a\ncan send 8001 010000\r\n";
    for before in [&b""[..], b"can send 8001 010000", b"\0\0"] {
        let mut decoder = line::Decoder::new();
        // Zero, the distance to the next zero, the version.
        let frame = [before, &[0, 40, 5], hostile, &[1, 2, 3], hostile, &[0]].concat();
        assert_eq!(decode(&mut decoder, &frame), []);
        assert!(decode(&mut decoder, b"can send 8001 010000\n")[0].is_ok());
    }
    // One that never ends is over some day.
    let mut decoder = line::Decoder::new();
    decode(&mut decoder, &[0, 40, 5]);
    let request = b"can send 8001 010000\n";
    let first = (1..).find(|_| !decode(&mut decoder, request).is_empty()).unwrap();
    assert!(first * request.len() <= usize::from(line::FOREIGN) + 2 * request.len(), "{first}");
}

#[test]
fn the_longest_reply_has_room_in_a_line() {
    let bytes = Bytes::from_slice(&[0xa5; FRAME]).unwrap();
    let line = line::reply(&Reply { identifier: 0x1fff_ffff, bytes });
    assert!(line.ends_with('\n') && line.len() <= line::LINE);
    assert!(line.as_str().starts_with("rcv 1fffffff a5a5"));
    assert_eq!(checked(line.rsplit_once(" *").unwrap().0), line.as_str());
    assert_eq!([0, 8, 9, 20, 25, 33, 48, 49, 64].map(padded), [0, 8, 12, 20, 32, 48, 48, 64, 64]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Any bytes: no panic, a short answer.
    #[test]
    fn any_frame(
        identifier in any::<u32>(), bytes in prop::collection::vec(any::<u8>(), 0..=FRAME), for_us in any::<bool>(),
    ) {
        let identifier = if for_us { 0x8001 } else { identifier };
        let mut server = Server::new(Address::default());
        let mut counter = Counter::default();
        if let Some(reply) = server.handle(&request(identifier, &bytes), &mut counter, &mut Echo(vec![1; 100])) {
            prop_assert!(!reply.bytes.is_empty() && reply.bytes.len() <= FRAME);
        }
    }

    /// Frames as clients send them with bytes exchanged, and padded.
    #[test]
    fn a_mutated_frame(
        place in 0..EXAMPLE.len(), byte in any::<u8>(), cut in 0..=EXAMPLE.len(), padding in 0..40_usize,
    ) {
        let mut bytes = EXAMPLE.to_vec();
        bytes[place] = byte;
        bytes.truncate(cut);
        bytes.resize(bytes.len() + padding, NOP);
        let mut counter = Counter::default();
        let _ = handle(&mut counter, &bytes);
        prop_assert!(counter.told() <= 1);
    }
}

/// Seeded, and fast enough for ten millions.
struct Random(u64);

impl Random {
    const fn new() -> Self {
        Self(0x9e37_79b9_7f4a_7c15)
    }

    const fn below(&mut self, most: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) as usize % most
    }
}

/// Frames of clients with bytes exchanged, cut and joined: answers that fit, and at most one command a frame.
fn mutate_frames(count: u64) {
    const FRAMES: [&[u8]; 7] = [
        EXAMPLE,
        &[0x01, 0x00, 0x00, 0x11, 0x00],
        &[0x0d, 0xb0, 0x02, 0, 0, 0x80, 0x3e],
        &[0x01, 0xb3, 0x02, 1, 0x01, 0xb2, 0x02, 1],
        &[0x40, 1, 5, b'h', b'e', b'l', b'l', b'o'],
        &[0x44, 1, 0, 48, 0x42, 1, 60],
        &[0x18, 4, 0xd0, 0x02, 0x1c, 0, 0, 0x14, 0x7f, 0x20],
    ];
    let (mut random, mut server, mut echo) = (Random::new(), Server::new(Address::default()), Echo(vec![]));
    for _ in 0..count {
        let mut bytes: Vec<u8> = (0..=random.below(3)).flat_map(|_| FRAMES[random.below(7)].iter().copied()).collect();
        for _ in 0..random.below(4) {
            let place = random.below(bytes.len());
            bytes[place] = random.below(256) as u8;
        }
        bytes.truncate(1 + random.below(FRAME));
        let mut counter = Counter::default();
        if let Some(reply) = server.handle(&request(0x8001, &bytes), &mut counter, &mut echo) {
            assert!((1..=FRAME).contains(&reply.bytes.len()));
        }
        assert!(counter.commands + counter.stops <= 1 && counter.told() <= 4);
        assert!(echo.0.len() <= 64 * 64, "{}", echo.0.len());
        if echo.0.len() > 1000 {
            echo.0.clear();
        }
    }
}

#[test]
fn mutated_frames() {
    mutate_frames(100_000);
}

#[test]
#[ignore = "ten million"]
fn mutated_frames_long() {
    mutate_frames(10_000_000);
}

/// Lines with bits turned over, bytes lost or too many: how many of them move the drive, of those with turned bits
/// alone and of the others.
fn mutate_lines(count: u64) -> [f64; 2] {
    let good = checked("can send 8001 01000a0e200000803f0000004011001f01130d bF").into_bytes();
    let mut random = Random::new();
    let mut next = |most| random.below(most);
    let mut decoder = line::Decoder::new();
    decode(&mut decoder, &good);
    let (mut moved, mut tried) = ([0.0; 2], [0.0; 2]);
    for _ in 0..count {
        let mut bytes = good.clone();
        let mut shifted = false;
        for _ in 0..=next(3) {
            let place = next(bytes.len() - 1);
            match next(6) {
                0 => _ = bytes.remove(place),
                1 => bytes.insert(place, next(256) as u8),
                _ => bytes[place] ^= 1 << next(8),
            }
            shifted |= bytes.len() != good.len();
        }
        if bytes == good {
            continue;
        }
        let mut counter = Counter::default();
        let mut server = Server::new(Address::default());
        for found in decode(&mut decoder, &bytes).into_iter().flatten() {
            server.handle(&found, &mut counter, &mut NoTunnel);
        }
        decode(&mut decoder, b"\0\n");
        tried[usize::from(shifted)] += 1.0;
        moved[usize::from(shifted)] += f64::from(u8::from(counter.commands > 0));
    }
    println!("{moved:?} of {tried:?}");
    [moved[0] / tried[0], moved[1] / tried[1]]
}

#[test]
fn damaged_lines_hardly_ever_move_the_drive() {
    // A CRC of eight bits, and what a frame has to be like.
    assert!(mutate_lines(100_000).iter().all(|share| *share < 1e-3));
}

#[test]
#[ignore = "ten million"]
fn damaged_lines_hardly_ever_move_the_drive_long() {
    assert!(mutate_lines(10_000_000).iter().all(|share| *share < 1e-3));
}

/// Whether a line is a request.
fn passes(bytes: &[u8]) -> bool {
    let mut decoder = line::Decoder::new();
    decode(&mut decoder, checked("can send 8001 50").as_bytes());
    decode(&mut decoder, bytes).iter().any(Result::is_ok)
}

#[test]
fn no_bit_may_be_wrong() {
    let good = checked("can send 8001 01000a0e200000803f00000040 bF").into_bytes();
    assert!(passes(&good));
    for bit in 0..8 * good.len() {
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        // The line's end may be the other one.
        assert!(!passes(&bytes) || bytes.ends_with(b"\r"), "bit {bit}");
    }
}
