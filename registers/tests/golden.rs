//! Frames, numbers and lines of the real client: `golden.txt`, made by `golden.py`.

use hallservo_registers::axis::{Axis, Command, Identity, Position, Refused, State};
use hallservo_registers::frame::{Bytes, Format, Number};
use hallservo_registers::register::{self, Content, Quantity};
use hallservo_registers::{Address, NoTunnel, Request, Server, line};

const GOLDEN: &str = include_str!("golden.txt");

fn rows(kind: &str) -> impl Iterator<Item = Vec<&'static str>> {
    let rows = GOLDEN.lines().map(|line| line.splitn(5, ' ').collect::<Vec<_>>());
    rows.filter(move |row| row[0] == kind)
}

fn bytes(hex: &str) -> Bytes {
    let hex = hex.strip_prefix('-').unwrap_or(hex);
    (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect()
}

/// Remembers what it is told.
#[derive(Default)]
struct Recorder {
    command: Option<Command>,
    output: Option<(f32, bool)>,
    reindexed: bool,
    recaptured: bool,
}

impl Axis for Recorder {
    fn identity(&self) -> Identity {
        Identity::default()
    }

    fn state(&self) -> State {
        State::UNKNOWN
    }

    fn command(&mut self, command: &Command) -> Result<(), Refused> {
        self.command = Some(*command);
        Ok(())
    }

    fn set_output(&mut self, position: f32, nearest: bool) -> Result<(), Refused> {
        self.output = Some((position, nearest));
        Ok(())
    }

    fn require_reindex(&mut self) -> Result<(), Refused> {
        self.reindexed = true;
        Ok(())
    }

    fn recapture(&mut self) -> Result<(), Refused> {
        self.recaptured = true;
        Ok(())
    }
}

fn told(name: &str) -> Recorder {
    let row = rows("command").find(|row| row[1] == name).unwrap_or_else(|| panic!("{name}"));
    let (mut server, mut recorder) = (Server::new(Address::default()), Recorder::default());
    let request = Request { identifier: 0x0001, bytes: bytes(row[2]) };
    assert_eq!(server.handle(&request, &mut recorder, &mut NoTunnel), None);
    // What was written reads back the same.
    for entry in row.iter().skip(3).flat_map(|rest| rest.split(' ')) {
        let (number, value) = entry.split_once('=').unwrap();
        let (number, value) = (u32::from_str_radix(&number[2..], 16).unwrap(), value.parse::<f32>().unwrap());
        if register::find(number, false, Format::Float).is_err() || number == register::MODE {
            continue;
        }
        let mut read = vec![0x1d, number as u8];
        read.resize(8, 0x50);
        let request = Request { identifier: 0x8001, bytes: read.into_iter().collect() };
        let reply = server.handle(&request, &mut recorder, &mut NoTunnel).unwrap();
        let read = f32::from_le_bytes(reply.bytes[2..6].try_into().unwrap());
        // Too much for a short integer.
        let large = [register::COMMAND_STOP_POSITION, register::COMMAND_ACCELERATION_LIMIT].contains(&number);
        let fits = name != "everything-as-int16" || !large;
        let close = (read - value).abs() <= 0.005 || read.is_nan() && value.is_nan();
        assert!(close || !fits, "{name} {number:#x}: {read} {value}");
    }
    recorder
}

#[test]
fn commands_are_understood() {
    assert_eq!(told("stop").command, Some(Command::Stop));
    let expected = Position { position: 1.5, velocity: -0.25, ..Position::DEFAULT };
    let position = |name| match told(name).command {
        Some(Command::Position(position)) => position,
        other => panic!("{name}: {other:?}"),
    };
    let same = |a: Position, b: Position| assert_eq!(format!("{a:?}"), format!("{b:?}"));
    same(position("position"), expected);
    same(
        position("everything"),
        Position {
            position: f32::NAN,
            velocity: 2.0,
            torque: 0.03,
            kp_scale: 0.5,
            kd_scale: 0.25,
            max_torque: 0.04,
            stop_position: 7.5,
            timeout: 0.2,
            velocity_limit: 3.0,
            acceleration_limit: 40.0,
        },
    );
    // What a short integer cannot hold is the most that it can.
    assert_eq!(position("everything-as-int16").stop_position, 3.2767);
    let sparse = Position { position: 0.5, kp_scale: 0.0, kd_scale: 0.0, stop_position: 1.0, ..Position::DEFAULT };
    same(position("sparse"), sparse);
    assert_eq!(told("current").command, Some(Command::Current { d: 0.0, q: 1.25, timeout: 0.0 }));
    assert_eq!(told("brake").command, Some(Command::Brake));
    assert!(matches!(told("zero-velocity").command, Some(Command::ZeroVelocity(Position { kd_scale: 0.5, .. }))));
    let Some(Command::StayWithin { lower, upper, with }) = told("stay-within").command else { panic!() };
    assert_eq!((lower, upper, with.max_torque), (-1.0, 2.0, 0.02));
    assert_eq!(told("nearest").output, Some((0.25, true)));
    assert_eq!(told("exact").output, Some((-3.5, false)));
    assert!(told("recapture").recaptured && told("reindex").reindexed);
}

#[test]
fn numbers_are_scaled_as_the_client_scales_them() {
    for row in rows("number") {
        let quantity = register::TABLE.iter().map(|register| register.quantity);
        let quantity = quantity.chain([Quantity::Acceleration]).find(|quantity| format!("{quantity:?}") == row[1]);
        let quantity = quantity.unwrap_or_else(|| panic!("{row:?}"));
        let rest: Vec<_> = row[4].split(' ').collect();
        let (value, hex) = (row[3].parse::<f32>().unwrap(), rest[0]);
        let raw = bytes(hex);
        let integer = raw.iter().rev().fold(0_i64, |bits, byte| bits << 8 | i64::from(*byte));
        let shift = 64 - 8 * raw.len() as u32;
        let integer = (integer << shift >> shift) as i32;
        let (number, format) = match row[2] {
            "Int8" => (Number::Integer(integer, Format::Int8), Format::Int8),
            "Int16" => (Number::Integer(integer, Format::Int16), Format::Int16),
            "Int32" => (Number::Integer(integer, Format::Int32), Format::Int32),
            _ => (Number::Float(f32::from_bits(integer as u32)), Format::Float),
        };
        // The client rounds towards zero, the drive to the nearest.
        match (register::encode(Content::Real(value), quantity, format), number) {
            (Number::Integer(ours, _), Number::Integer(theirs, _)) => {
                assert!(ours.abs_diff(theirs) <= 1 + theirs.unsigned_abs() / 10_000_000, "{row:?} {ours} {theirs}");
            }
            (Number::Float(ours), Number::Float(theirs)) => assert!(ours == theirs || ours.is_nan() && theirs.is_nan()),
            other => panic!("{row:?} {other:?}"),
        }
        let Content::Real(back) = register::decode(number, quantity) else { panic!("{row:?}") };
        let unit = match row[2] {
            "Int8" => quantity.units()[0],
            "Int16" => quantity.units()[1],
            "Int32" => quantity.units()[2],
            _ => 1e-6,
        };
        let close = (back - value).abs() <= 1.01 * unit || value.abs() > 1e6 || back.is_nan() && value.is_nan();
        assert!(close, "{row:?} {back}");
    }
}

#[test]
fn lines_are_understood() {
    for row in rows("line") {
        let mut decoder = line::Decoder::new();
        // The line is what follows the frame.
        let text = row[3..].join(" ");
        let found: Vec<_> = text.bytes().chain([b'\n']).filter_map(|byte| decoder.push(byte)).collect();
        let request = Request { identifier: u32::from_str_radix(row[1], 16).unwrap(), bytes: bytes(row[2]) };
        assert_eq!(found, [Ok(request)], "{text}");
    }
}
