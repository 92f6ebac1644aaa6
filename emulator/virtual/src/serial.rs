//! The other end of the board's serial port: a TCP connection or a pseudo-terminal.

use crate::session::Session;
use anyhow::{Context, Result, bail};
use hallservo_protocol::{Answer, Decoder, Reply, Request};
use hallservo_registers::line;
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::OwnedFd;
use std::time::Duration;

/// The bit of an identifier of a line that asks for a reply.
pub(crate) const REPLY: u32 = 1 << 15;

/// Where tools connect to.
pub enum Port {
    /// One connection at a time.
    Tcp {
        /// Where it listens.
        listener: TcpListener,
        /// Who is connected.
        stream: Option<TcpStream>,
    },
    /// A pseudo-terminal.
    Pty {
        /// The side of the board.
        master: File,
        /// Keeps the terminal open while no tool has it.
        _slave: OwnedFd,
    },
}

impl Port {
    /// Opens `tcp:ADDRESS:PORT` or `pty`; returns it with what a tool has to connect to.
    ///
    /// # Errors
    /// A description that is none of these, an address that is taken, no pseudo-terminal.
    pub fn open(description: &str) -> Result<(Port, String)> {
        if description == "pty" {
            return pty();
        }
        let Some(address) = description.strip_prefix("tcp:") else {
            bail!("--serial takes tcp:ADDRESS:PORT or pty, not {description:?}");
        };
        let listener = TcpListener::bind(address).with_context(|| format!("cannot listen at {address}"))?;
        listener.set_nonblocking(true)?;
        let name = format!("tcp:{}", listener.local_addr()?);
        Ok((Port::Tcp { listener, stream: None }, name))
    }

    /// What has come from the tool since the last call.
    pub fn receive(&mut self) -> Vec<u8> {
        let mut buffer = [0; 512];
        match self {
            Port::Pty { master, .. } => match master.read(&mut buffer) {
                Ok(length) => buffer[..length].to_vec(),
                Err(_) => Vec::new(),
            },
            Port::Tcp { listener, stream } => {
                if let Ok((new, _)) = listener.accept() {
                    // Frames are small, and answers are waited for.
                    let ready = new.set_nonblocking(true).and_then(|()| new.set_nodelay(true));
                    *stream = ready.is_ok().then_some(new);
                }
                match stream.as_mut().map(|stream| stream.read(&mut buffer)) {
                    Some(Ok(length @ 1..)) => return buffer[..length].to_vec(),
                    Some(Err(error)) if error.kind() == ErrorKind::WouldBlock => {}
                    _ => *stream = None,
                }
                Vec::new()
            }
        }
    }

    /// Passes on what the board has sent, and returns how much of it found room.
    pub fn send(&mut self, bytes: &[u8]) -> usize {
        let written = match self {
            Port::Pty { master, .. } => master.write(bytes),
            Port::Tcp { stream, .. } => match stream.as_mut().map(|stream| stream.write(bytes)) {
                Some(Err(error)) if error.kind() != ErrorKind::WouldBlock => {
                    *stream = None;
                    Ok(bytes.len())
                }
                // As on a wire, it is lost where nobody listens.
                written => written.unwrap_or(Ok(bytes.len())),
            },
        };
        written.unwrap_or(0)
    }
}

/// Seconds of the board's time that a request is worth where the board waits for the tool.
const WORTH_S: f64 = 0.05;
/// … and at most, while it is not answered: more than any answer takes, and less than a command holds.
const LONGEST_S: f64 = 0.8;
/// The same of lines of text, from their answer on, as at a bus: their clients ask much, and wait 0.2 s on the wall …
const LINE_WORTH_S: f64 = 2e-3;
/// … and while they are not answered: what is not for this drive never is.
const LINE_LONGEST_S: f64 = 0.4;

/// The serial port while the board runs: how its time passes.
pub struct Line {
    port: Port,
    waits: bool,
    /// When a tool was heard last, and whether it has its answer.
    heard_s: f64,
    answered: bool,
    answers: Decoder,
    /// Until when the time passes that lines of text are worth, and lines that they are still to be answered by.
    text_until_s: f64,
    owed: usize,
    lines: line::Decoder,
    /// What has come from it, and whether there is a frame in it.
    received: Vec<u8>,
    whole: bool,
    requests: Decoder,
    unsent: Vec<u8>,
}

impl Line {
    /// Opens a port and says what a tool has to connect to. Who `waits` has no time of its own but the tool's: each
    /// request is worth 50 ms, or what its answer takes, as fast as can be; a line of text what its answer takes, and
    /// two milliseconds. Otherwise time is that on the wall, or slower.
    ///
    /// # Errors
    /// As [`Port::open`].
    pub fn open(description: &str, waits: bool) -> Result<Line> {
        let (port, name) = Port::open(description)?;
        println!("serial port: {name}");
        std::io::stdout().flush()?;
        Ok(Line {
            port,
            waits,
            heard_s: 0.0,
            answered: true,
            answers: Decoder::new(),
            text_until_s: 0.0,
            owed: 0,
            lines: line::Decoder::new(),
            received: Vec::new(),
            whole: false,
            requests: Decoder::new(),
            unsent: Vec::new(),
        })
    }

    /// Passes on what has come from the tool. As on a wire, it is lost before the firmware has set up its port; not
    /// where the board waits for the tool. There, it is heard as a whole frame and while time stands still, so that
    /// what the board does depends neither on when it comes nor on how it is cut in pieces.
    pub fn hear(&mut self, session: &mut Session) {
        if self.waits && self.is_busy(session.seconds()) {
            return;
        }
        let bytes = self.port.receive();
        self.whole |= bytes.iter().filter(|&&byte| self.requests.push::<Request>(byte).is_some()).count() > 0;
        self.received.extend(bytes);
        // A line of text is a request as well.
        let is_text = self.received.ends_with(b"\n") && !self.received.contains(&0);
        self.whole |= is_text;
        if self.received.is_empty() || self.waits && !self.whole {
            return;
        }
        let heard = session.receive(self.received.clone()).is_ok();
        if heard && is_text {
            self.owed = owed(&mut self.lines, &self.received);
            self.text_until_s = session.seconds() + LINE_LONGEST_S;
        } else {
            (self.heard_s, self.answered) = (session.seconds(), !heard);
        }
        if !heard && !self.waits {
            eprintln!("bytes at the serial port are lost: the firmware has not set it up");
        }
        if heard || !self.waits {
            self.received.clear();
            self.whole = false;
        }
    }

    /// Passes on what the board has sent until now. What a tool is too slow for is lost; not where the board waits.
    pub fn send(&mut self, bytes: &[u8], board_s: f64) {
        let ends = bytes.iter().filter(|byte| **byte == b'\n').count();
        if self.owed > 0 && ends >= self.owed {
            self.text_until_s = board_s + LINE_WORTH_S;
        }
        self.owed = self.owed.saturating_sub(ends);
        for &byte in bytes {
            if let Some(Ok(Reply { answer, .. })) = self.answers.push::<Reply>(byte) {
                self.answered |= !matches!(answer, Answer::Telemetry(_));
            }
        }
        self.unsent.extend(bytes);
        if !self.unsent.is_empty() {
            let sent = self.port.send(&self.unsent);
            self.unsent.drain(..if self.waits { sent } else { self.unsent.len() });
        }
    }

    /// Whether time may pass, that being so late on the board and on the wall.
    pub fn may_run(&self, board_s: f64, wall: Duration) -> bool {
        if self.waits { self.unsent.is_empty() && self.is_busy(board_s) } else { board_s < wall.as_secs_f64() }
    }

    /// Whether the time that the last request is worth passes.
    fn is_busy(&self, board_s: f64) -> bool {
        let worth_s = if self.answered { WORTH_S } else { LONGEST_S };
        board_s < (self.heard_s + worth_s).max(self.text_until_s)
    }
}

/// How many lines answer these: one each, and another one where a reply is asked for.
fn owed(decoder: &mut line::Decoder, bytes: &[u8]) -> usize {
    let requests = bytes.iter().filter_map(|byte| decoder.push(*byte));
    requests.map(|request| 1 + usize::from(request.is_ok_and(|request| request.identifier & REPLY != 0))).sum()
}

fn pty() -> Result<(Port, String)> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).context("no pseudo-terminal")?;
    grantpt(&master)?;
    unlockpt(&master)?;
    let name = ptsname(&master, Vec::new())?.into_string()?;
    let slave = rustix::fs::open(&*name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty())?;
    // Bytes as they are: no echo, no line ends.
    let mut attributes = tcgetattr(&slave)?;
    attributes.make_raw();
    tcsetattr(&slave, OptionalActions::Now, &attributes)?;
    rustix::fs::fcntl_setfl(&master, OFlags::NONBLOCK)?;
    Ok((Port::Pty { master: master.into(), _slave: slave }, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eventually(port: &mut Port) -> Vec<u8> {
        // Twenty seconds on a machine that is busy; it is there at once.
        for _ in 0..10_000 {
            let bytes = port.receive();
            if !bytes.is_empty() {
                return bytes;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Vec::new()
    }

    #[test]
    fn bytes_go_both_ways_over_tcp() {
        let (mut port, name) = Port::open("tcp:127.0.0.1:0").unwrap();
        let mut tool = TcpStream::connect(name.strip_prefix("tcp:").unwrap()).unwrap();
        tool.write_all(b"hello").unwrap();
        assert_eq!(eventually(&mut port), b"hello");
        port.send(&[0, 255, 10]);
        let mut answer = [0; 3];
        tool.read_exact(&mut answer).unwrap();
        assert_eq!(answer, [0, 255, 10]);
    }

    #[test]
    fn a_pseudo_terminal_passes_bytes_as_they_are() {
        let (mut port, name) = Port::open("pty").unwrap();
        let mut tool = File::options().read(true).write(true).open(name).unwrap();
        tool.write_all(&[13, 10, 3, 0, 255]).unwrap();
        assert_eq!(eventually(&mut port), [13, 10, 3, 0, 255]);
        port.send(&[0, 10, 17, 19]);
        let mut answer = [0; 4];
        tool.read_exact(&mut answer).unwrap();
        assert_eq!(answer, [0, 10, 17, 19]);
    }

    #[test]
    fn time_passes_as_on_the_wall_or_as_long_as_somebody_asks() {
        let line = |waits| Line { heard_s: 2.0, ..Line::open("tcp:127.0.0.1:0", waits).unwrap() };
        let [early, late] = [Duration::from_secs(1), Duration::from_secs(9)];
        assert!(!line(false).may_run(2.2, early) && line(false).may_run(2.2, late));
        for wall in [early, late] {
            assert!(line(true).may_run(2.04, wall) && !line(true).may_run(2.06, wall));
            let asked = Line { answered: false, ..line(true) };
            assert!(asked.may_run(2.2, wall) && !asked.may_run(2.9, wall));
            let behind = Line { unsent: vec![0], ..line(true) };
            assert!(!behind.may_run(2.04, wall), "the tool has to read first");
        }
    }

    #[test]
    fn lines_of_text_are_worth_their_answers() {
        let text = b"can send 8001 1100\n\ncan send 1 0100\nnothing\n";
        assert_eq!(owed(&mut line::Decoder::new(), text), 2 + 1 + 1);
        let mut line = Line { owed: 2, text_until_s: 1.4, ..Line::open("tcp:127.0.0.1:0", true).unwrap() };
        let wall = Duration::ZERO;
        line.send(b"OK *BD\nrcv 10", 1.001);
        assert!(line.may_run(1.39, wall), "not answered");
        line.send(b"0 21000a *53\n", 1.002);
        assert!(line.may_run(1.003, wall) && !line.may_run(1.0041, wall), "and two milliseconds more");
    }

    #[test]
    fn other_ports_are_refused() {
        let error = Port::open("com1").map(|_| ()).unwrap_err().to_string();
        assert_eq!(error, "--serial takes tcp:ADDRESS:PORT or pty, not \"com1\"");
    }
}
