//! The simulated drive at the end of a line: TCP on loopback, or a pseudo-terminal.

pub mod load;
#[cfg(unix)]
mod terminal;

use crate::out::Out;
use crate::say;
use anyhow::{Context, Result};
use clap::builder::PossibleValuesParser;
use hallservo::mode::Mode;
use hallservo::settings::Control;
use hallservo_protocol::{Answer, Ask, Decoder, Reply, Request};
use hallservo_registers::line;
use load::LoadOptions;
use plant::PlantParameters;
use plant::heads::Encoder;
use rig::motors::{MOTORS, with_windings};
use serde_json::json;
use simulator::fault::{Kind, ScheduledEvent};
use simulator::flash::Flash;
use simulator::rings::Pairs;
use simulator::{Simulator, defaults, of_motor, uneven};
use std::io::{BufRead, Read, Write, stdin};
use std::net::{TcpListener, TcpStream};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// How the drive's time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Pace {
    /// As on the wall
    Real,
    /// Each request is worth 20 ms, or what its answer takes, as fast as this machine computes; nobody asks, no time
    /// passes
    Fast,
}

/// What to simulate, and where.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Listen here; port 0 takes a free one
    #[arg(long, value_name = "tcp:HOST:PORT", default_value = "tcp:127.0.0.1:0", value_parser = address)]
    pub listen: String,
    /// Be a pseudo-terminal instead
    #[cfg(unix)]
    #[arg(long)]
    pub pty: bool,
    /// Seed of the motor, its sensors and the noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Another motor, on a board that fits it
    #[arg(long, value_parser = PossibleValuesParser::new(MOTORS.map(|motor| motor.name)))]
    pub motor: Option<String>,
    /// Two rings of so many pole pairs on the shaft, under two opposite heads each
    #[arg(long, value_name = "37/45")]
    pub encoder: Option<Pairs>,
    /// Distance of the rings' centre from the axis, in mm
    #[arg(long, value_name = "MM", default_value_t = 0.05, requires = "encoder", value_parser = eccentricity)]
    pub eccentricity: f64,
    /// Uneven magnets: 1 is as bad as cheap ones are, 0.5 half of it
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = unevenness)]
    pub uneven: f64,
    /// Two Halls instead of three, so many electrical degrees apart; the drive is told by `settings set halls 2`
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = apart)]
    pub two_halls: Option<f64>,
    /// Field of the windings at the largest current, as a share of the magnets'
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = coil_field)]
    pub coil_field: f64,
    /// What the shaft turns
    #[command(flatten)]
    pub load: LoadOptions,
    /// How time passes
    #[arg(long, value_enum, default_value_t = Pace::Real)]
    pub speed: Pace,
    /// Keep the flash in this file; without, it is forgotten in the end
    #[arg(long, value_name = "FILE")]
    pub flash: Option<PathBuf>,
    /// Something happens after so long in the state running: hall-open@40s, hall-2-stuck@5s, bus-60V@1s,
    /// load-0.05Nm@1s, hot@1s, late@1s, mend@5s; typed without its time, as hall-open, it happens at once
    #[arg(long, value_name = "EVENT@TIME")]
    pub fault: Vec<ScheduledEvent>,
    /// Print what it is told and each change of its state, with its time and the motor's speed
    #[arg(long)]
    pub log: bool,
}

fn address(text: &str) -> Result<String, String> {
    match text.strip_prefix("tcp:").and_then(|address| address.rsplit_once(':')) {
        Some((_, port)) if port.parse::<u16>().is_ok() => Ok(text.into()),
        _ => Err("the address is to be tcp:HOST:PORT".into()),
    }
}

/// A number from a range; `of` says what it counts.
fn within(text: &str, range: RangeInclusive<f64>, of: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("a number from {} to {} is wanted, {of}", range.start(), range.end()))
}

fn eccentricity(text: &str) -> Result<f64, String> {
    within(text, 0.0..=2.0, "millimetres")
}

fn unevenness(text: &str) -> Result<f64, String> {
    within(text, 0.0..=5.0, "times as uneven as cheap magnets are")
}

/// Halls in line, or in one place, are no two.
fn apart(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if (20.0..=160.0).contains(&degrees.abs()) => Ok(degrees),
        _ => Err("20 to 160 electrical degrees are wanted, or as many in the other direction".into()),
    }
}

fn coil_field(text: &str) -> Result<f64, String> {
    within(text, 0.0..=1.0, "of the magnets' field")
}

/// Milliseconds that a request is worth.
const WORTH: u32 = 20;
/// At most, while it is not answered: more than the drive takes for any.
const LONGEST: u32 = 300;
/// Pieces on their way to a tool that may not read them.
const OUT: usize = 256;
/// Pieces on their way from a tool that asks faster than the drive answers: it has to wait.
const IN: usize = 16;
/// Bytes that the drive leaves untaken, at most, before it hears no more.
const BACKLOG: usize = 1024;

/// From the line.
enum Event {
    /// A tool has come; what is written here reaches it.
    Came(SyncSender<Vec<u8>>),
    /// It has sent something.
    Bytes(Vec<u8>),
    /// A person does something to the drive, with the words for it.
    Typed(Kind, String),
}

/// Simulates a drive until the process is ended. Events on the standard input happen at once: `turn 2` turns its shaft
/// by hand, by two turns in two seconds.
///
/// # Errors
/// What is wrong with the options.
pub fn main(options: &Options, out: Out) -> Result<()> {
    let flash = match &options.flash {
        Some(path) => Flash::in_file(path)?,
        None => Flash::blank(),
    };
    let rings = options.encoder.map(|pairs| Encoder::new(pairs.0, options.eccentricity, options.seed));
    let motor = options.motor.as_ref().and_then(|name| MOTORS.iter().find(|motor| motor.name == name));
    let (settings, plant) = match motor {
        None => (defaults(), PlantParameters::imperfect(options.seed)),
        Some(motor) => (of_motor(motor), motor.plant(options.seed)),
    };
    let plant = match options.two_halls {
        Some(apart_deg) => plant.with_two_halls(apart_deg),
        None => plant,
    };
    let mut plant = options.load.on(uneven(plant, options.uneven, options.seed));
    if options.coil_field != 0.0 {
        let rated_a = motor.map_or(Control::default().max_current_a, |motor| motor.limit_a);
        plant = with_windings(plant, options.coil_field, rated_a.into(), options.seed);
    }
    let mut simulator = Simulator::with_rings(settings, &plant, rings, options.seed, flash, options.fault.clone())?;
    let (events, line) = sync_channel(IN);
    listen_to_keyboard(events.clone());
    let name = open(options, events)?;
    // Before its port, which scripts look for.
    for line in about(options) {
        say!(out, "{line}")?;
    }
    say!(out, "The simulated drive is at {name}")?;
    out.value(&json!({ "port": name }))?;
    let tool = Tool { log: options.log.then_some(Log { out, mode: Mode::Unarmed }), ..Tool::default() };
    match options.speed {
        Pace::Real => real(&mut simulator, tool, &line),
        Pace::Fast => fast(&mut simulator, tool, &line),
    }
    Ok(())
}

/// What is unusual about the drive.
fn about(options: &Options) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(motor) = &options.motor {
        lines.push(format!("Its motor is {motor:?}, of which it knows the pole pairs alone."));
    }
    if options.uneven > 0.0 {
        lines.push(format!("The magnets are uneven, {} times as those of a cheap motor.", options.uneven));
    }
    if let Some(apart_deg) = options.two_halls {
        lines.push(format!(
            "It has two Halls, {apart_deg}° apart (electrical): `hallctl settings set halls 2` tells it so."
        ));
    }
    if let Some(Pairs([reference, vernier])) = options.encoder {
        let mm = options.eccentricity;
        lines
            .push(format!("On its shaft are two rings of {reference} and {vernier} pole pairs, {mm} mm off its axis."));
    }
    lines
}

#[cfg(unix)]
fn open(options: &Options, events: SyncSender<Event>) -> Result<String> {
    if options.pty { terminal::open(events) } else { listen(&options.listen, events) }
}

#[cfg(not(unix))]
fn open(options: &Options, events: SyncSender<Event>) -> Result<String> {
    listen(&options.listen, events)
}

/// Tells what the drive is told and does.
struct Log {
    out: Out,
    mode: Mode,
}

impl Log {
    /// What does not change the drive is not told.
    fn asked(&self, simulator: &Simulator, ask: &Ask<'_>) {
        if ask.controls() || matches!(ask, Ask::Disarm) {
            self.tell(simulator, &format!("{ask:?}"));
        }
    }

    fn is(&mut self, simulator: &Simulator) {
        let mode = simulator.drive().mode();
        if mode != self.mode {
            self.mode = mode;
            self.tell(simulator, crate::words::mode_word(mode));
        }
    }

    fn tell(&self, simulator: &Simulator, what: &str) {
        let (at_s, speed_rad_s) = (simulator.now_ms() as f64 / 1000.0, simulator.plant.truth().speed_rad_s);
        // A screen that is gone is no reason to end.
        let _ = say!(self.out, "{at_s:.3} s  {speed_rad_s:.1} rad/s  {what}");
        let _ = self.out.value(&json!({ "at_s": at_s, "speed_rad_s": speed_rad_s, "what": what }));
    }
}

/// The end of a line at the drive.
#[derive(Default)]
struct Tool {
    out: Option<SyncSender<Vec<u8>>>,
    requests: Decoder,
    /// The same of register clients.
    lines: line::Decoder,
    answers: Decoder,
    /// Whether a request has no answer yet.
    waits: bool,
    log: Option<Log>,
}

impl Tool {
    /// A byte to the drive. If it ends a frame, time passes: until it is answered, if it is a request.
    fn ask(&mut self, simulator: &mut Simulator, byte: u8) {
        if !self.hear(simulator, byte) {
            return;
        }
        for passed in 0..LONGEST {
            if passed < WORTH || self.waits {
                self.step(simulator);
            }
        }
    }

    /// A byte to the drive: true if it ends a frame or a line.
    fn hear(&mut self, simulator: &mut Simulator, byte: u8) -> bool {
        simulator.write(&[byte]);
        if self.lines.push(byte).is_some() {
            return true;
        }
        let Some(frame) = self.requests.push::<Request<'_>>(byte) else { return false };
        self.waits = frame.is_ok();
        if let (Some(log), Ok(Request { ask, .. })) = (&self.log, &frame) {
            log.asked(simulator, ask);
        }
        true
    }

    /// A millisecond.
    fn step(&mut self, simulator: &mut Simulator) {
        simulator.step();
        if let Some(log) = &mut self.log {
            log.is(simulator);
        }
        let bytes = simulator.read();
        for &byte in &bytes {
            if let Some(Ok(Reply { answer, .. })) = self.answers.push::<Reply<'_>>(byte) {
                self.waits &= matches!(answer, Answer::Telemetry(_));
            }
        }
        if let Some(tool) = self.out.as_ref().filter(|_| !bytes.is_empty()) {
            // A tool that does not read loses frames, and the drive goes on.
            let _ = tool.try_send(bytes);
        }
    }
}

/// What a person has typed happens; how many milliseconds it takes.
fn happen(simulator: &mut Simulator, kind: Kind, text: &str) -> u32 {
    if let Err(error) = simulator.happen(kind) {
        crate::tell!("{text}: {error}");
        return 0;
    }
    match kind {
        Kind::Turn(turns) => {
            println!("The shaft is turned by {turns} turns.");
            (1000.0 * turns.abs()) as u32
        }
        _ => {
            println!("{text}: done");
            0
        }
    }
}

fn real(simulator: &mut Simulator, mut tool: Tool, line: &Receiver<Event>) {
    let mut next = Instant::now();
    loop {
        while simulator.backlog() < BACKLOG {
            match line.try_recv() {
                Ok(Event::Came(out)) => tool.out = Some(out),
                Ok(Event::Bytes(bytes)) => bytes.iter().for_each(|&byte| _ = tool.hear(simulator, byte)),
                Ok(Event::Typed(kind, text)) => _ = happen(simulator, kind, &text),
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return,
            }
        }
        tool.step(simulator);
        // A machine that is too slow makes the drive's time slower, not jerky.
        next = (next + Duration::from_millis(1)).max(Instant::now() - Duration::from_millis(20));
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
}

/// What the drive does depends on what comes, in which order, and on nothing else: neither on when, nor on how it is
/// cut in pieces.
fn fast(simulator: &mut Simulator, mut tool: Tool, line: &Receiver<Event>) {
    while let Ok(event) = line.recv() {
        match event {
            Event::Came(out) => tool.out = Some(out),
            Event::Bytes(bytes) => bytes.into_iter().for_each(|byte| tool.ask(simulator, byte)),
            Event::Typed(kind, text) => {
                (0..happen(simulator, kind, &text)).for_each(|_| tool.step(simulator));
            }
        }
    }
}

/// What a person types, line by line from the standard input.
fn listen_to_keyboard(events: SyncSender<Event>) {
    thread::spawn(move || {
        // A line that is no text is a wrong one, and not the last.
        for line in stdin().lock().split(b'\n').map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line).into_owned();
            let kind = script::event(&line).map_err(anyhow::Error::msg).and_then(|event| Kind::of(&event));
            match kind {
                Ok(kind) => {
                    if events.send(Event::Typed(kind, line)).is_err() {
                        return;
                    }
                }
                Err(error) => {
                    crate::tell!("{line:?}: {error}; `turn 2` turns the shaft by hand, `mend` ends what was broken")
                }
            }
        }
    });
}

fn listen(address: &str, events: SyncSender<Event>) -> Result<String> {
    let address = address.strip_prefix("tcp:").context("the address is to be tcp:HOST:PORT")?;
    let listener = TcpListener::bind(address).with_context(|| format!("cannot listen at {address}"))?;
    let name = format!("tcp:{}", listener.local_addr().context("the socket")?);
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            if serve(stream, &events).is_none() {
                return;
            }
        }
    });
    Ok(name)
}

/// One tool after the other; `None` when the drive is gone.
fn serve(stream: TcpStream, events: &SyncSender<Event>) -> Option<()> {
    let _ = stream.set_nodelay(true);
    let Ok(out) = stream.try_clone() else { return Some(()) };
    events.send(Event::Came(pour(out))).ok()?;
    pump(stream, events)
}

/// Writes in a thread of its own, for a tool may not read.
fn pour(mut out: impl Write + Send + 'static) -> SyncSender<Vec<u8>> {
    let (sender, receiver) = sync_channel::<Vec<u8>>(OUT);
    thread::spawn(move || {
        while let Ok(bytes) = receiver.recv() {
            if out.write_all(&bytes).is_err() {
                return;
            }
        }
    });
    sender
}

/// Reads until the tool is gone; `None` when the drive is.
fn pump(mut from: impl Read, events: &SyncSender<Event>) -> Option<()> {
    let mut bytes = [0; 256];
    while let Ok(length @ 1..) = from.read(&mut bytes) {
        events.send(Event::Bytes(bytes[..length].to_vec())).ok()?;
    }
    Some(())
}
