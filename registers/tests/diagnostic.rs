//! The diagnostic channel as a client sees it, at a drive that only remembers what it was asked for.

use hallservo_registers::axis::{Command, Identity, Mode, Refused, State};
use hallservo_registers::diagnostic::{Build, Change, Diagnostic, Halls, Host, Kind, Setting};
use hallservo_registers::{Axis, Tunnel};
use proptest::prelude::*;

const COMMUTATION: Kind<'static> = Kind::Choice("block|sinusoidal|field-oriented");

/// A drive with four settings.
struct Drive {
    values: [f32; 4],
    id: u8,
    /// Whether the control interrupt answers.
    answers: bool,
    change: Option<Change>,
    changes: Vec<Change>,
    commands: Vec<Command>,
    renewed: u32,
    is_over: bool,
}

impl Default for Drive {
    fn default() -> Self {
        Self {
            values: [3.0, 4.0, 1.0, 2.0],
            id: 1,
            answers: true,
            change: None,
            changes: Vec::new(),
            commands: Vec::new(),
            renewed: 0,
            is_over: false,
        }
    }
}

impl Axis for Drive {
    fn identity(&self) -> Identity {
        Identity { model: 0x6873, firmware: 0x010203, serial: [1, 2, 0xffff_ffff] }
    }

    fn state(&self) -> State {
        State { mode: Mode::Position, position: 0.25, voltage: 24.5, ..State::UNKNOWN }
    }

    fn command(&mut self, command: &Command) -> Result<(), Refused> {
        self.commands.push(*command);
        if matches!(command, Command::Brake) { Err(Refused) } else { Ok(()) }
    }

    fn set_output(&mut self, _: f32, _: bool) -> Result<(), Refused> {
        Ok(())
    }

    fn require_reindex(&mut self) -> Result<(), Refused> {
        Err(Refused)
    }

    fn recapture(&mut self) -> Result<(), Refused> {
        Ok(())
    }
}

impl Host for Drive {
    type Refusal = &'static str;

    fn settings(&self) -> u16 {
        5
    }

    fn setting(&self, number: u16) -> Option<Setting<'_>> {
        let (name, kind, place) = match number {
            0 => ("max_current_a", Kind::Real, 0),
            1 => ("pole_pairs", Kind::Whole, 1),
            // One that this drive does not have.
            2 => return None,
            3 => ("reversed", Kind::Switch, 2),
            4 => ("commutation", COMMUTATION, 3),
            _ => return None,
        };
        Some(Setting { name, kind, value: self.values[place] })
    }

    fn id(&self) -> u8 {
        self.id
    }

    fn begin(&mut self, change: Change) {
        self.changes.push(change);
        self.change = Some(change);
    }

    fn outcome(&mut self) -> Option<Result<(), &'static str>> {
        let change = self.change.take_if(|_| self.answers)?;
        Some(match change {
            Change::Set(0, value) if value > 8.0 => Err("max_current_a is too large, by °\nfar"),
            Change::Set(number, value) => {
                self.values[usize::from(number.saturating_sub(u16::from(number > 2)))] = value;
                Ok(())
            }
            Change::Id(id) => {
                self.id = id;
                Ok(())
            }
            _ => Ok(()),
        })
    }

    fn renew(&mut self, _: &Command) -> bool {
        self.renewed += 1;
        !self.is_over
    }

    fn build(&self) -> Build {
        Build { board: "simulated", release: "0.1.0", commit: [7; 20] }
    }

    fn halls(&self) -> Halls {
        Halls { codes: [2000, 2048, 4095], amplitude: 1.0, angle_deg: -12.5, calibrated: true }
    }
}

/// Everything that there is to read, in pieces of a frame.
fn read(channel: &mut Diagnostic, drive: &mut Drive) -> Vec<u8> {
    read_in(channel, drive, &[61])
}

/// The same in pieces of these sizes, again and again.
fn read_in(channel: &mut Diagnostic, drive: &mut Drive, sizes: &[usize]) -> Vec<u8> {
    let (mut all, mut empty) = (Vec::new(), 0);
    for size in sizes.iter().cycle() {
        let mut piece = vec![0; *size];
        let length = channel.transmit(&mut piece);
        channel.serve(drive);
        all.extend(&piece[..length]);
        empty = if length == 0 { empty + 1 } else { 0 };
        // One without anything, as telemetry is prepared for a client that reads.
        if empty == 2 {
            break;
        }
    }
    all
}

/// In frames.
fn write(channel: &mut Diagnostic, drive: &mut Drive, bytes: &[u8]) {
    for frame in bytes.chunks(61) {
        channel.receive(frame);
        channel.serve(drive);
    }
}

fn ask(channel: &mut Diagnostic, drive: &mut Drive, line: &str) -> String {
    write(channel, drive, line.as_bytes());
    write(channel, drive, b"\r\n");
    String::from_utf8(read(channel, drive)).unwrap()
}

/// At a new drive.
fn answer(line: &str) -> String {
    ask(&mut Diagnostic::new(), &mut Drive::default(), line)
}

#[test]
fn the_configuration_is_dumped_and_read() {
    let dump =
        "id.id 1\r\nservo.max_current_a 3\r\nservo.pole_pairs 4\r\nservo.reversed 1\r\nservo.commutation 2\r\nOK\r\n";
    assert_eq!(answer("conf enumerate"), dump);
    assert_eq!(answer("conf enumerate id"), "id.id 1\r\nOK\r\n");
    assert_eq!(answer("conf list"), "id\r\nuuid\r\nservo\r\nOK\r\n");
    assert_eq!(answer("conf get servo.max_current_a"), "3\r\n");
    assert_eq!(answer("conf get uuid.uuid.4"), "2\r\n");
    assert_eq!(answer("conf get uuid.uuid.16"), "ERR error reading: there is no such value\r\n");
    assert_eq!(answer("conf get servo.max_current"), "ERR error reading: there is no such setting\r\n");
    assert_eq!(answer("conf get motor.poles"), "ERR unknown group\r\n");
    assert_eq!(answer("conf enumerate motor"), "ERR unknown group\r\n");
    let uuid = answer("conf enumerate uuid");
    assert!(uuid.starts_with("uuid.uuid.0 1\r\n") && uuid.ends_with("uuid.uuid.15 0\r\nOK\r\n"), "{uuid}");
    assert_eq!(uuid.lines().count(), 17);
}

#[test]
fn a_setting_is_set_or_refused_with_the_drives_words() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    assert_eq!(ask(channel, drive, "conf set servo.max_current_a 2.5"), "OK\r\n");
    assert_eq!(ask(channel, drive, "conf get servo.max_current_a"), "2.5\r\n");
    assert_eq!(ask(channel, drive, "conf set servo.commutation sinusoidal"), "OK\r\n");
    assert_eq!(ask(channel, drive, "conf set servo.reversed false"), "OK\r\n");
    assert_eq!(ask(channel, drive, "conf set id.id 3"), "OK\r\n");
    assert_eq!(drive.values, [2.5, 4.0, 0.0, 1.0]);
    // In one line of ASCII.
    assert_eq!(ask(channel, drive, "conf set servo.max_current_a 9"), "ERR max_current_a is too large, by ??far\r\n");
    assert_eq!(ask(channel, drive, "conf set servo.max_current_a much"), "ERR error setting: not a number\r\n");
    assert_eq!(ask(channel, drive, "conf set servo.max_current_a"), "ERR error setting: not a number\r\n");
    assert_eq!(ask(channel, drive, "conf set servo.commutation six"), "ERR error setting: none of its names\r\n");
    assert_eq!(ask(channel, drive, "conf set uuid.uuid.0 1"), "ERR error setting: it cannot be set\r\n");
    assert_eq!(ask(channel, drive, "conf set id.id 256"), "ERR error setting: not a whole number from 0 to 255\r\n");
    // What is so already needs no drive.
    let changes = drive.changes.len();
    assert_eq!(ask(channel, drive, "conf set servo.max_current_a 2.5\nconf set id.id 3"), "OK\r\nOK\r\n");
    assert_eq!(drive.changes.len(), changes);
    for command in ["conf write", "conf load", "conf default"] {
        assert_eq!(ask(channel, drive, command), "OK\r\n");
    }
    assert_eq!(drive.changes[drive.changes.len() - 3..], [Change::Save, Change::Load, Change::Default]);
}

#[test]
fn an_answer_waits_for_the_drive_and_what_comes_meanwhile_waits_too() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive { answers: false, ..Drive::default() });
    assert_eq!(ask(channel, drive, "conf set servo.max_current_a 2\nconf get servo.max_current_a"), "");
    assert_eq!(ask(channel, drive, "d pos nan 0 1"), "");
    assert!(drive.commands.is_empty());
    drive.answers = true;
    channel.tick(drive);
    let late = "ERR not obeyed: it came while other lines waited\r\n";
    assert_eq!(String::from_utf8(read(channel, drive)).unwrap(), format!("OK\r\n2\r\n{late}"));
    assert!(drive.commands.is_empty());
}

#[test]
fn a_stop_is_obeyed_when_it_comes_whatever_waits() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive { answers: false, ..Drive::default() });
    assert_eq!(ask(channel, drive, "conf write\nconf default"), "");
    assert_eq!(ask(channel, drive, "d  stop "), "");
    assert_eq!(drive.commands, [Command::Stop]);
    drive.answers = true;
    channel.tick(drive);
    let answers = "OK\r\nERR not carried out: a stop came after it\r\nOK\r\n";
    assert_eq!(String::from_utf8(read(channel, drive)).unwrap(), answers);
    assert_eq!(drive.changes, [Change::Save]);
}

#[test]
fn a_motion_is_obeyed_although_answers_were_not_read() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    write(channel, drive, b"tel list\nd pos nan 0 0.5\nd brake\nd raw 1 1 1\nd stop\n");
    assert_eq!(drive.commands.len(), 3);
    let Command::Position(motion) = drive.commands[0] else { panic!() };
    assert!(motion.position.is_nan() && motion.max_torque == 0.5);
    let answers = "servo_stats\r\nhalls\r\ncan\r\nfirmware\r\ngit\r\nOK\r\nOK\r\n\
        ERR refused: the drive cannot now, or another tool controls it\r\nERR this drive does not have it\r\nOK\r\n";
    assert_eq!(String::from_utf8(read(channel, drive)).unwrap(), answers);
}

/// How often the motion is renewed in so many milliseconds, while the client reads every so often.
fn renewals(channel: &mut Diagnostic, drive: &mut Drive, milliseconds: u32, reads_every: u32) -> u32 {
    drive.renewed = 0;
    for now in 1..=milliseconds {
        channel.tick(drive);
        if now % reads_every == 0 {
            channel.transmit(&mut [0; 61]);
        }
    }
    drive.renewed
}

#[test]
fn a_motion_lasts_as_long_as_the_client_reads_and_nothing_else_is_commanded() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    ask(channel, drive, "d pos nan 1 nan");
    assert_eq!(renewals(channel, drive, 1000, 10), 50);
    // A setting does not end it, nor does a line that is none.
    ask(channel, drive, "conf get servo.pole_pairs\nd jump\nd recapture");
    assert_eq!(renewals(channel, drive, 100, 10), 5);
    assert!(renewals(channel, drive, 2000, 5000) <= 50);
    assert_eq!(renewals(channel, drive, 1000, 10), 0);
    for end in ["d stop", "d pos nan 1 nan t0.5", "d brake\nd stop"] {
        ask(channel, drive, "d pos nan 1 nan");
        assert_eq!(renewals(channel, drive, 100, 10), 5);
        ask(channel, drive, end);
        assert_eq!(renewals(channel, drive, 100, 10), 0, "{end}");
    }
    ask(channel, drive, "d pos nan 1 nan");
    drive.is_over = true;
    assert_eq!(renewals(channel, drive, 100, 10), 1);
    assert_eq!(drive.commands.iter().filter(|command| matches!(command, Command::Position(_))).count(), 6);
}

#[test]
fn what_is_not_known_is_answered() {
    assert_eq!(answer("unlock"), "ERR unknown command\r\n");
    assert_eq!(answer("d jump"), "ERR unknown command\r\n");
    assert_eq!(answer("conf"), "ERR unknown subcommand\r\n");
    assert_eq!(answer("tel"), "ERR unknown subcommand\r\n");
    assert_eq!(answer("tel schema servo"), "ERR unknown name\r\n");
    assert_eq!(answer("conf schema motor"), "ERR unknown name\r\n");
    assert_eq!(answer("tel rate halls fast"), "ERR not a whole number from 0 to 65535\r\n");
    assert_eq!(answer("d stöp"), "ERR the line is longer than 127 bytes, or no ASCII\r\n");
    assert_eq!(answer(" \r\n\r\n\t"), "");
}

#[test]
fn telemetry_as_text() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    assert_eq!(ask(channel, drive, "tel text"), "OK\r\n");
    let halls = "halls.code.0 2000\r\nhalls.code.1 2048\r\nhalls.code.2 4095\r\nhalls.amplitude 1\r\n\
        halls.angle_deg -12.5\r\nhalls.calibrated 1\r\nOK\r\n";
    assert_eq!(ask(channel, drive, "tel get halls"), halls);
    let stats = ask(channel, drive, "tel get servo_stats");
    for line in ["servo_stats.mode 10", "servo_stats.position 0.25", "servo_stats.bus_V 24.5", "servo_stats.d_A NaN"] {
        assert!(stats.lines().any(|one| one == line), "{stats}");
    }
    assert!(stats.ends_with("servo_stats.encoder_velocity NaN\r\nOK\r\n"));
    let firmware = ask(channel, drive, "tel get firmware");
    assert!(firmware.contains("firmware.board simulated\r\nfirmware.release 0.1.0\r\n"), "{firmware}");
}

#[test]
fn a_schema_and_its_data() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    write(channel, drive, b"tel schema halls\n");
    let schema = [
        b"schema halls\r\n".as_slice(),
        &62_u32.to_le_bytes(),
        &[16, 0],
        b"\0\x04code\0\x13\x03\x04\x02\0",
        b"\0\x09amplitude\0\x07\0",
        b"\0\x09angle_deg\0\x07\0",
        b"\0\x0acalibrated\0\x02\0",
        &[0; 5],
    ];
    assert_eq!(read(channel, drive), schema.concat());
    write(channel, drive, b"tel get halls\n");
    let data = [
        b"emit halls\r\n".as_slice(),
        &15_u32.to_le_bytes(),
        &[0xd0, 0x07, 0x00, 0x08, 0xff, 0x0f],
        &1.0_f32.to_le_bytes(),
        &(-12.5_f32).to_le_bytes(),
        &[1],
    ];
    assert_eq!(read(channel, drive), data.concat());
    write(channel, drive, b"conf schema servo\nconf data servo\n");
    let whole = [
        b"cschema servo\r\n".as_slice(),
        &108_u32.to_le_bytes(),
        &[16, 0],
        b"\0\x0dmax_current_a\0\x07\0",
        b"\0\x0apole_pairs\0\x03\x04\0",
        b"\0\x08reversed\0\x02\0",
        b"\0\x0bcommutation\0\x11\x04\x01\x03\0\x05block\x01\x0asinusoidal\x02\x0efield-oriented\0",
        &[0; 5],
        b"cdata servo\r\n",
        &10_u32.to_le_bytes(),
        &3.0_f32.to_le_bytes(),
        &4_i32.to_le_bytes(),
        &[1, 2],
    ];
    assert_eq!(read(channel, drive), whole.concat());
}

#[test]
fn channels_are_sent_at_their_rates_and_never_within_an_answer() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    assert_eq!(ask(channel, drive, "tel rate halls 10\ntel rate git 100"), "OK\r\nOK\r\n");
    let mut sent = Vec::new();
    for _ in 0..200 {
        channel.tick(drive);
        sent.extend(read(channel, drive));
    }
    let count = |text: &[u8]| sent.windows(text.len()).filter(|part| *part == text).count();
    assert_eq!((count(b"emit halls\r\n"), count(b"emit git\r\n")), (20, 2));

    // What is due while an answer is on its way comes after it, once.
    write(channel, drive, b"conf enumerate\n");
    let mut answer = [0; 9];
    assert_eq!(channel.transmit(&mut answer), 9);
    (0..55).for_each(|_| channel.tick(drive));
    let rest = read(channel, drive);
    let end = rest.windows(4).position(|part| part == b"OK\r\n").unwrap();
    assert!(!rest[..end].windows(4).any(|part| part == b"emit"));
    assert_eq!(rest.windows(4).filter(|part| part == b"emit").count(), 1);

    assert_eq!(ask(channel, drive, "tel stop"), "OK\r\n");
    (0..200).for_each(|_| channel.tick(drive));
    assert!(read(channel, drive).is_empty());
}

#[test]
fn a_blob_has_the_announced_length_though_the_settings_change_on_the_way() {
    let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
    write(channel, drive, b"conf data servo\nconf get id.id\n");
    let mut head = [0; 17];
    assert_eq!(channel.transmit(&mut head), 17);
    drive.values = [f32::NAN; 4];
    assert_eq!(read(channel, drive).len(), 10 + 3);
}

#[derive(Clone, Debug)]
enum Event {
    Line(String),
    Bytes(Vec<u8>),
    Read(usize),
    Ticks(u16),
    Answers(bool),
}

fn event() -> impl Strategy<Value = Event> {
    let words = prop::sample::select(vec![
        "conf",
        "tel",
        "d",
        "enumerate",
        "list",
        "get",
        "set",
        "write",
        "load",
        "default",
        "schema",
        "data",
        "rate",
        "fmt",
        "text",
        "stop",
        "pos",
        "zero",
        "within",
        "servo",
        "id",
        "uuid",
        "servo.max_current_a",
        "servo.commutation",
        "uuid.uuid.3",
        "id.id",
        "servo_stats",
        "halls",
        "firmware",
        "git",
        "1",
        "0",
        "nan",
        "-1e38",
        "inf",
        "p",
        "s1",
        "é",
        ".",
        "99999999999",
    ]);
    prop_oneof![
        prop::collection::vec(words, 0..6).prop_map(|words| Event::Line(words.join(" "))),
        prop::collection::vec(any::<u8>(), 0..200).prop_map(Event::Bytes),
        (0..300_usize).prop_map(Event::Read),
        (0..300_u16).prop_map(Event::Ticks),
        any::<bool>().prop_map(Event::Answers),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Whatever comes: no panic, no end of an answer that never comes, nothing that moves but by a whole line, and the
    /// channel answers as if nothing had been, afterwards.
    #[test]
    fn whatever_comes_it_answers_afterwards(events in prop::collection::vec(event(), 0..60)) {
        let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
        for event in events {
            match event {
                Event::Line(line) => write(channel, drive, format!("{line}\n").as_bytes()),
                Event::Bytes(bytes) => write(channel, drive, &bytes),
                Event::Read(length) => {
                    let mut buffer = vec![0; length];
                    prop_assert!(channel.transmit(&mut buffer) <= length);
                    channel.serve(drive);
                }
                Event::Ticks(count) => (0..count).for_each(|_| channel.tick(drive)),
                Event::Answers(answers) => drive.answers = answers,
            }
        }
        drive.answers = true;
        write(channel, drive, b"\ntel stop\n");
        // At most what waits: 256 bytes of lines, each answered by no more than the dump or a schema, and one emission
        // of each channel.
        let rest = read(channel, drive);
        prop_assert!(rest.len() < 256 / 5 * 2000 + 4 * 1100, "{}", rest.len());
        prop_assert_eq!(ask(channel, drive, "conf get servo.pole_pairs").lines().count(), 1);
        prop_assert_eq!(ask(channel, drive, "tel list"), "servo_stats\r\nhalls\r\ncan\r\nfirmware\r\ngit\r\nOK\r\n");
    }

    /// However it is cut into pieces, an answer is the same.
    #[test]
    fn pieces_of_any_size_make_the_same_answer(sizes in prop::collection::vec(1..70_usize, 1..20)) {
        let lines = b"conf enumerate\nconf schema servo\nconf data servo\ntel schema servo_stats\ntel get firmware\n";
        let (channel, drive) = (&mut Diagnostic::new(), &mut Drive::default());
        write(channel, drive, lines);
        let whole = read(channel, drive);
        write(channel, drive, lines);
        let all = read_in(channel, drive, &sizes);
        prop_assert_eq!(all, whole);
    }
}
