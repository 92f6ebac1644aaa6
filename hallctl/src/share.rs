//! One owner of the port: a process that is started when the first tool wants it, and ends when the last one has gone.
//!
//! Tools attach to it over a Unix socket named after the port. It reads and writes the line, and the [hub](crate::hub)
//! decides what goes to whom. A lock in the same folder sees to it that there is only one.

use crate::hub::{Frames, Hub, To, Tool, is_stop};
use crate::link::{self, Line};
use anyhow::{Context, Result, ensure};
use std::collections::BTreeMap;
use std::fs::{self, DirBuilder, File, TryLockError};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// The hidden command that is the process.
pub const COMMAND: &str = "share";
/// What it says when tools may attach.
const READY: &str = "ready";
/// How long it stays when the last tool has gone.
const LINGER: Duration = Duration::from_secs(2);
/// Pieces on their way to a tool that may not read them; what is more is lost.
const OUT: usize = 1024;
/// Requests of a tool on their way at the same time, so that each has its turn.
const IN_FLIGHT: u32 = 4;
/// How long the motor of a tool that has gone is braked before the bridge is switched off.
const BRAKING: Duration = Duration::from_millis(60);
/// Longest wait for one of them to be answered: a line may lose a byte.
const ANSWER: Duration = Duration::from_millis(200);
/// Attempts to reach it: one may just be ending.
const ATTEMPTS: u32 = 40;
/// Between them.
const PAUSE: Duration = Duration::from_millis(50);

/// The files of a port's process.
struct Place {
    socket: PathBuf,
    lock: PathBuf,
}

impl Place {
    fn of(port: &str) -> Result<Self> {
        let folder = folder()?;
        // However it is called, a device is the same.
        let device = fs::canonicalize(port).unwrap_or_else(|_| port.into());
        let mut hasher = DefaultHasher::new();
        device.hash(&mut hasher);
        let name = format!("{:016x}", hasher.finish());
        Ok(Self { socket: folder.join(&name).with_extension("socket"), lock: folder.join(name).with_extension("lock") })
    }
}

/// The folder in which the tools of this user find each other, and nobody else's; it is made where there is none.
///
/// # Errors
/// It cannot be made, or is another's.
pub fn folder() -> Result<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|path| path.is_dir());
    let folder = match runtime {
        Some(runtime) => runtime.join("hallctl"),
        None => std::env::temp_dir().join(format!("hallctl-{user}")),
    };
    match DirBuilder::new().mode(0o700).create(&folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => {
            return Err(error)
                .with_context(|| format!("cannot make the folder {}, for tools to share a port", folder.display()));
        }
        _ => {}
    }
    let found = fs::symlink_metadata(&folder).with_context(|| folder.display().to_string())?;
    ensure!(
        found.is_dir() && found.uid() == user && found.mode() & 0o077 == 0,
        "{} must be this user's folder, and nobody else's",
        folder.display()
    );
    Ok(folder)
}

/// A line to the drive beside those of other tools; starts the port's owner, where there is none.
///
/// # Errors
/// That the port cannot be opened, in the system's words.
pub fn attach(port: &str) -> io::Result<Line> {
    let place = Place::of(port).map_err(io::Error::other)?;
    for attempt in 0..ATTEMPTS {
        match UnixStream::connect(&place.socket) {
            Ok(stream) => return Line::local(stream),
            Err(_) if attempt == 0 => start(port)?,
            Err(_) => {
                thread::sleep(PAUSE);
                start(port)?;
            }
        }
    }
    Err(io::Error::other("the process that owns the port does not answer"))
}

/// Starts the port's owner and waits until it is ready, or says why not.
fn start(port: &str) -> io::Result<()> {
    let mut process = Command::new(std::env::current_exe()?);
    process.args(["--port", port, COMMAND]).current_dir("/").process_group(0);
    let mut process = process.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
    let mut line = String::new();
    if let Some(out) = process.stdout.take() {
        BufReader::new(out).read_line(&mut line)?;
    }
    match line.trim().split_once(' ') {
        None if line.trim() == READY => Ok(()),
        Some((code, why)) => Err(code.parse().map_or_else(|_| io::Error::other(why), io::Error::from_raw_os_error)),
        None => Err(io::Error::other("the process that is to own the port does not start")),
    }
}

/// From threads that read.
enum Event {
    Came(UnixStream),
    Asked(Tool, Vec<u8>),
    Gone(Tool),
    Heard(Vec<u8>),
    Lost,
}

/// Owns a port until no tool needs it any more.
///
/// # Errors
/// None that a tool was not told.
pub fn main(port: &str) -> Result<()> {
    let place = Place::of(port)?;
    let lock = File::create(&place.lock).context("the lock")?;
    match lock.try_lock() {
        Err(TryLockError::WouldBlock) => {
            // Another one was faster.
            println!("{READY}");
            return Ok(());
        }
        locked => locked.context("the lock")?,
    }
    let line = match link::open(port) {
        Ok(line) => line,
        Err(error) => {
            println!("{} {error}", error.raw_os_error().map_or("?".into(), |code| code.to_string()));
            return Ok(());
        }
    };
    let _ = fs::remove_file(&place.socket);
    let listener = UnixListener::bind(&place.socket).context("the socket")?;
    println!("{READY}");
    serve(listener, line);
    remove(&place.socket);
    Ok(())
}

/// No tool finds it any more; those that have come meanwhile try again.
fn remove(socket: &Path) {
    let _ = fs::remove_file(socket);
}

fn serve(listener: UnixListener, line: Line) {
    let (events, inbox) = channel();
    let Line { mut reader, writer } = line;
    let heard = events.clone();
    thread::spawn(move || {
        read(&mut reader, |bytes| heard.send(Event::Heard(bytes.to_vec())).is_ok());
        let _ = heard.send(Event::Lost);
    });
    let came = events.clone();
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            if came.send(Event::Came(stream)).is_err() {
                return;
            }
        }
    });
    Switchboard { hub: Hub::new(), tools: BTreeMap::new(), writer, events, braked: None }.run(&inbox);
}

/// A tool's end of the hub.
struct End {
    out: SyncSender<Vec<u8>>,
    flow: Arc<Flow>,
}

/// Lets a tool have a few requests on their way, and no more.
#[derive(Default)]
struct Flow {
    waiting: Mutex<u32>,
    answered: Condvar,
}

impl Flow {
    fn wait(&self) {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let late = self.answered.wait_timeout_while(waiting, ANSWER, |waiting| *waiting >= IN_FLIGHT);
        let (mut waiting, _) = late.unwrap_or_else(PoisonError::into_inner);
        *waiting = (*waiting + 1).min(IN_FLIGHT);
    }

    fn answered(&self) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        *waiting = waiting.saturating_sub(1);
        self.answered.notify_one();
    }
}

struct Switchboard {
    hub: Hub,
    tools: BTreeMap<Tool, End>,
    writer: Box<dyn Write + Send>,
    events: Sender<Event>,
    /// When a motor that is being braked is to be switched off.
    braked: Option<Instant>,
}

impl Switchboard {
    /// Until the drive is lost, or nobody has been there for a while.
    fn run(&mut self, inbox: &Receiver<Event>) {
        let mut used = Instant::now();
        while !self.hub.is_empty() || used.elapsed() < LINGER {
            let wait = self.braked.map_or(LINGER, |at| at.saturating_duration_since(Instant::now()));
            let out = match inbox.recv_timeout(wait) {
                Ok(Event::Came(stream)) => self.came(stream).into_iter().collect(),
                Ok(Event::Asked(tool, frame)) => self.hub.ask(tool, frame),
                Ok(Event::Gone(tool)) => {
                    self.tools.remove(&tool);
                    used = Instant::now();
                    self.hub.detach(tool)
                }
                Ok(Event::Heard(bytes)) => self.hub.hear(&bytes),
                Ok(Event::Lost) | Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => Vec::new(),
            };
            let over = self.braked.take_if(|at| *at <= Instant::now()).map(|_| self.hub.braked());
            if !out.into_iter().chain(over.into_iter().flatten()).all(|to| self.send(to)) {
                return;
            }
        }
    }

    fn came(&mut self, stream: UnixStream) -> Option<To> {
        let reader = stream.try_clone().ok()?;
        let (tool, strange) = self.hub.attach();
        let (out, queue) = sync_channel(OUT);
        let flow = Arc::new(Flow::default());
        self.tools.insert(tool, End { out, flow: Arc::clone(&flow) });
        thread::spawn(move || pour(stream, &queue));
        let events = self.events.clone();
        thread::spawn(move || listen(tool, reader, &flow, &events));
        strange
    }

    /// False when the drive is lost.
    fn send(&mut self, to: To) -> bool {
        match to {
            To::Drive(frame) => return self.writer.write_all(&frame).and_then(|()| self.writer.flush()).is_ok(),
            To::Later => self.braked = Some(Instant::now() + BRAKING),
            To::Answered(tool, frame) => {
                if let Some(end) = self.tools.get(&tool) {
                    end.flow.answered();
                    let _ = end.out.try_send(frame);
                }
            }
            To::Told(tool, frame) => {
                if let Some(end) = self.tools.get(&tool) {
                    let _ = end.out.try_send(frame);
                }
            }
        }
        true
    }
}

/// Frames of a tool.
fn listen(tool: Tool, mut reader: UnixStream, flow: &Flow, events: &Sender<Event>) {
    let (mut frames, mut stops) = (Frames::default(), false);
    read(&mut reader, |bytes| {
        bytes.iter().filter_map(|&byte| frames.push(byte)).all(|frame| {
            // A request to disarm waits for no other but its like.
            if !is_stop(&frame) || std::mem::replace(&mut stops, true) {
                flow.wait();
                stops = is_stop(&frame);
            }
            events.send(Event::Asked(tool, frame)).is_ok()
        })
    });
    let _ = events.send(Event::Gone(tool));
}

/// Reads until the end, or until `take` wants no more.
fn read(from: &mut dyn Read, mut take: impl FnMut(&[u8]) -> bool) {
    let mut bytes = [0; 512];
    loop {
        match from.read(&mut bytes) {
            Ok(0) => return,
            Ok(length) if !take(&bytes[..length]) => return,
            Ok(_) => {}
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(_) => return,
        }
    }
}

/// Writes in a thread of its own, for a tool may not read.
fn pour(mut out: UnixStream, queue: &Receiver<Vec<u8>>) {
    while let Ok(bytes) = queue.recv() {
        if out.write_all(&bytes).is_err() {
            return;
        }
    }
    let _ = out.shutdown(std::net::Shutdown::Both);
}
