//! The simulated drive at the end of a line: TCP on loopback, or a pseudo-terminal.

use super::Simulator;
use super::fault::{Kind, Planned};
use super::flash::Flash;
use anyhow::{Context, Result};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TryRecvError, channel, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// How the drive's time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Pace {
    /// As on the wall
    Real,
    /// Each request is worth 20 ms, which pass as fast as this machine computes; nobody asks, no time passes
    Fast,
}

/// What to simulate, and where.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Listen here; port 0 takes a free one
    #[arg(long, value_name = "tcp:HOST:PORT", default_value = "tcp:127.0.0.1:0")]
    pub listen: String,
    /// Be a pseudo-terminal instead
    #[arg(long)]
    pub pty: bool,
    /// Seed of the motor, its sensors and the noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How time passes
    #[arg(long, value_enum, default_value_t = Pace::Real)]
    pub speed: Pace,
    /// Keep the flash in this file; without, it is forgotten in the end
    #[arg(long, value_name = "FILE")]
    pub flash: Option<PathBuf>,
    /// Something happens after so long in the state running: hall-open@40s, hall-2-stuck@5s, bus-60V@1s, load-0.05Nm@1s, hot@1s,
    /// late@1s; typed, it happens at once
    #[arg(long, value_name = "EVENT@TIME")]
    pub fault: Vec<String>,
}

/// Milliseconds that a request is worth.
const WORTH: u32 = 20;
/// Without a request for so long on the wall, a waiting tool gets its 20 ms all the same.
const IDLE: Duration = Duration::from_millis(50);
/// So often.
const IDLE_TURNS: u32 = 40;
/// Pieces on their way to a tool that may not read them.
const OUT: usize = 256;

/// From the line.
enum Event {
    /// A tool has come; what is written here reaches it.
    Came(SyncSender<Vec<u8>>),
    /// It has sent something.
    Bytes(Vec<u8>),
    /// A person does something to the drive, with the words for it.
    Typed(Kind, String),
}

/// Simulates a drive until the process is ended. Events on the standard input happen at once: `turn 2` turns its shaft by hand, by two
/// turns in two seconds.
///
/// # Errors
/// What is wrong with the options.
pub fn main(options: &Options) -> Result<()> {
    let planned = options.fault.iter().map(|text| text.parse()).collect::<Result<Vec<Planned>>>()?;
    let flash = match &options.flash {
        Some(path) => Flash::in_file(path)?,
        None => Flash::blank(),
    };
    let mut simulator = Simulator::new(options.seed, flash, planned)?;
    let (events, line) = channel();
    listen_to_keyboard(events.clone());
    let name = if options.pty { terminal(events)? } else { listen(&options.listen, events)? };
    println!("The simulated drive is at {name}");
    std::io::stdout().flush().context("the terminal")?;
    match options.speed {
        Pace::Real => real(&mut simulator, &line),
        Pace::Fast => fast(&mut simulator, &line),
    }
    Ok(())
}

/// The end of a line at the drive.
#[derive(Default)]
struct Tool(Option<SyncSender<Vec<u8>>>);

impl Tool {
    /// Takes up what came; how many milliseconds it is worth. A frame has two zeros.
    fn take(&mut self, simulator: &mut Simulator, event: Event) -> u32 {
        match event {
            Event::Came(tool) => self.0 = Some(tool),
            Event::Bytes(bytes) => {
                simulator.write(&bytes);
                return bytes.iter().filter(|&&byte| byte == 0).count() as u32 * WORTH / 2;
            }
            Event::Typed(kind, text) => {
                if let Err(error) = simulator.happen(kind) {
                    eprintln!("{text}: {error}");
                    return 0;
                }
                if let Kind::Turn(turns) = kind {
                    println!("The shaft is turned by {turns} turns.");
                    return (1000.0 * turns.abs()) as u32;
                }
                println!("{text}: done");
            }
        }
        0
    }

    /// A millisecond.
    fn step(&self, simulator: &mut Simulator) {
        simulator.step();
        let bytes = simulator.read();
        if let Some(tool) = self.0.as_ref().filter(|_| !bytes.is_empty()) {
            // A tool that does not read loses frames, and the drive goes on.
            let _ = tool.try_send(bytes);
        }
    }
}

fn real(simulator: &mut Simulator, line: &Receiver<Event>) {
    let mut tool = Tool::default();
    let mut next = Instant::now();
    loop {
        loop {
            match line.try_recv() {
                Ok(event) => _ = tool.take(simulator, event),
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

fn fast(simulator: &mut Simulator, line: &Receiver<Event>) {
    let mut tool = Tool::default();
    let mut idle = IDLE_TURNS;
    loop {
        let worth = match if idle < IDLE_TURNS { line.recv_timeout(IDLE) } else { line.recv().map_err(Into::into) } {
            Ok(event) => {
                idle = 0;
                tool.take(simulator, event)
            }
            Err(RecvTimeoutError::Timeout) => {
                idle += 1;
                WORTH
            }
            Err(RecvTimeoutError::Disconnected) => return,
        };
        for _ in 0..worth {
            tool.step(simulator);
        }
    }
}

/// What a person types, line by line from the standard input.
fn listen_to_keyboard(events: Sender<Event>) {
    thread::spawn(move || {
        for line in std::io::stdin().lines().map_while(Result::ok) {
            let kind = script::event(&line).map_err(anyhow::Error::msg).and_then(|event| Kind::of(&event));
            match kind {
                Ok(kind) => {
                    if events.send(Event::Typed(kind, line)).is_err() {
                        return;
                    }
                }
                Err(error) => eprintln!("{line:?}: {error}; `turn 2` turns the shaft by hand, by two turns"),
            }
        }
    });
}

fn listen(address: &str, events: Sender<Event>) -> Result<String> {
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
fn serve(stream: TcpStream, events: &Sender<Event>) -> Option<()> {
    let _ = stream.set_nodelay(true);
    let Ok(out) = stream.try_clone() else { return Some(()) };
    events.send(Event::Came(pour(out))).ok()?;
    pump(stream, events)
}

fn terminal(events: Sender<Event>) -> Result<String> {
    let control = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).context("cannot make a pseudo-terminal")?;
    grantpt(&control).context("the pseudo-terminal")?;
    unlockpt(&control).context("the pseudo-terminal")?;
    let name = ptsname(&control, Vec::new()).context("the pseudo-terminal")?;
    let name = name.into_string().context("the name of the pseudo-terminal")?;
    // Kept open, so that the line does not break between two tools; and raw, so that nothing is echoed.
    let tool_end = OpenOptions::new().read(true).write(true).open(&name).context("the pseudo-terminal")?;
    let mut attributes = tcgetattr(&tool_end).context("the pseudo-terminal")?;
    attributes.make_raw();
    tcsetattr(&tool_end, OptionalActions::Now, &attributes).context("the pseudo-terminal")?;
    let control = File::from(control);
    let out = control.try_clone().context("the pseudo-terminal")?;
    thread::spawn(move || {
        let _kept = tool_end;
        if events.send(Event::Came(pour(out))).is_ok() {
            let _ = pump(control, &events);
        }
    });
    Ok(name)
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
fn pump(mut from: impl Read, events: &Sender<Event>) -> Option<()> {
    let mut bytes = [0; 256];
    while let Ok(length @ 1..) = from.read(&mut bytes) {
        events.send(Event::Bytes(bytes[..length].to_vec())).ok()?;
    }
    Some(())
}
