//! A conversation with a drive: one request, one answer; telemetry in between.

use crate::error::{Error, Result};
use crate::interrupt;
use crate::link::{self, Line};
use crate::words;
use anyhow::Context;
use hallservo::drive;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo_protocol::{
    Answer, Ask, Decoder, Error as Frame, FRAME, Incident, Refusal, Reply, Request, Setting, Status, Telemetry, encode,
};
use std::collections::VecDeque;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::ErrorKind;
use std::time::{Duration, Instant};

/// From look to look of a drive whose time is that on the wall, at most: also the sign of life of this tool.
const EVERY: Duration = Duration::from_millis(50);

/// The same where what is waited for takes no longer than a few of them.
pub const SHORT: Duration = Duration::from_millis(5);

/// For so long, what the drive said of who controls it is sure: nobody stops and arms it in less, for the check at arming
/// takes as long.
const SURE: Duration = Duration::from_millis(200);

/// How often a request goes out, at most, while nothing comes back: a line may lose a byte.
const ATTEMPTS: u32 = 4;

/// Whether asked twice is no more than asked once, though the answer to the first was lost. What begins something, or
/// ends it, is not.
const fn may_repeat(ask: &Ask<'_>) -> bool {
    !matches!(
        ask,
        Ask::Arm
            | Ask::Clear
            | Ask::Calibrate
            | Ask::Identify
            | Ask::LearnCogging
            | Ask::Save
            | Ask::Measure { begins: true, .. }
            | Ask::Swing
    )
}

/// Who answers.
#[derive(Clone, Debug, Default)]
pub struct Identity {
    /// The board.
    pub board: String,
    /// Version of its firmware.
    pub firmware: String,
    /// Serial number of its chip, 24 hexadecimal digits.
    pub serial: String,
    /// Number of settings.
    pub settings: u16,
    /// Control periods a second.
    pub step_hz: f64,
}

/// A drive at the other end of a line.
pub struct Client {
    line: Line,
    port: String,
    patience: Duration,
    decoder: Decoder,
    /// Who this is to the drive.
    number: u32,
    /// Whether what is begun goes on without this tool.
    unattended: bool,
    /// Whether it may control the drive.
    controls: bool,
    /// When it asked for what showed that the drive is controlled by it; none where that showed the opposite.
    in_control: Option<Instant>,
    /// Whether the drive has refused the latest request since it had stopped for want of commands.
    barred: bool,
    /// Whether a signal ends a wait.
    interruptible: bool,
    id: u16,
    /// The request of the telemetry that is wanted.
    stream: u16,
    identity: Identity,
    telemetry: VecDeque<Telemetry>,
    garbage: bool,
}

impl Client {
    /// Opens a port and asks who is there; `patience` is the longest wait for an answer.
    ///
    /// # Errors
    /// No port, no answer, or another version of the protocol.
    pub fn connect(port: &str, patience: Duration) -> Result<Self> {
        let line = link::open(port).map_err(|source| Error::Port { port: port.into(), source })?;
        Self::over(line, port, patience)
    }

    /// The same over a line that is open already.
    ///
    /// # Errors
    /// No answer, or another version of the protocol.
    pub fn over(line: Line, port: &str, patience: Duration) -> Result<Self> {
        let mut client = Self {
            line,
            port: port.into(),
            patience,
            decoder: Decoder::new(),
            // Seeded anew for each process.
            number: (RandomState::new().build_hasher().finish() as u32).max(1),
            unattended: false,
            controls: false,
            in_control: None,
            barred: false,
            interruptible: true,
            stream: 0,
            // Another tool's answers may still be on their way; they have other numbers, as far as chance allows.
            id: std::process::id() as u16,
            identity: Identity::default(),
            telemetry: VecDeque::new(),
            garbage: false,
        };
        client.identity = client.ask(Ask::Hello, |answer| match answer {
            Answer::Hello(hello) => Ok(Identity {
                board: hello.board.into(),
                firmware: hello.firmware.into(),
                serial: hello.serial.iter().rev().map(|word| format!("{word:08X}")).collect(),
                settings: hello.settings,
                step_hz: hello.step_hz.into(),
            }),
            other => unexpected(&other),
        })?;
        // Another tool may have left without a word.
        client.order(Ask::Telemetry(0.0))?;
        Ok(client)
    }

    /// Takes note of a fault.
    ///
    /// # Errors
    /// As [`Client::ask`], or that there is none.
    pub fn clear(&mut self) -> Result<()> {
        match self.order(Ask::Clear) {
            Err(Error::Refused(_)) if !matches!(self.status()?.mode, Mode::Faulted(_)) => {
                Err(Error::Refused("there is no fault to clear".into()))
            }
            result => result,
        }
    }

    /// Whether it has asked for anything that only the tool that controls may.
    pub const fn controls(&self) -> bool {
        self.controls
    }

    /// After a signal: what is asked from now on is answered, though it has come.
    pub const fn carry_on(&mut self) {
        self.interruptible = false;
    }

    /// That a signal has come is an error, once.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn check(&self) -> Result<()> {
        if self.interruptible && interrupt::came() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// What is begun from now on goes on though this tool ends.
    pub const fn unattended(&mut self, unattended: bool) {
        self.unattended = unattended;
    }

    /// Whether a tool that controls the drive is this one.
    pub const fn is_me(&self, client: u32) -> bool {
        client == self.number
    }

    /// Where.
    pub fn port(&self) -> &str {
        &self.port
    }

    /// Who answers.
    pub const fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Asks, again where nothing comes back and that does no harm, and hands the answer to `understand`. A refusal is
    /// an error with its reason in words.
    ///
    /// # Errors
    /// No answer, another version, a refusal, or what `understand` makes of it.
    pub fn ask<R>(&mut self, ask: Ask<'_>, understand: impl FnOnce(Answer<'_>) -> Result<R>) -> Result<R> {
        // One more for what may come behind it.
        self.id = self.id.wrapping_add(2);
        let mut frame = [0; FRAME];
        let request = Request { id: self.id, client: self.number, unattended: self.unattended, ask };
        let length = encode(&request, &mut frame).context("the request is too long")?;
        // A drive that does not know what is asked leaves it unanswered, but not what comes behind.
        let (mut behind, behind_id) = ([0; FRAME], self.id.wrapping_sub(1));
        let lacks = words::lacks(&ask);
        let behind_length = if lacks.is_some() {
            let hello = Request { id: behind_id, ask: Ask::Hello, ..request };
            encode(&hello, &mut behind).context("the request is too long")?
        } else {
            0
        };
        self.controls |= ask.controls();
        if matches!(ask, Ask::Telemetry(hz) if hz > 0.0) {
            self.stream = self.id;
        }
        self.barred = false;
        let (asked, mut attempts, mut passed_over, mut byte) = (Instant::now(), 0, 0, [0]);
        while asked.elapsed() < self.patience {
            self.check()?;
            // What came while this process was suspended is read before anything is asked again.
            let nothing = attempts > 0 && !self.read(&mut byte)?;
            let late = passed_over > 0 || asked.elapsed() > self.patience * attempts / ATTEMPTS;
            let again = nothing && may_repeat(&ask) && late && attempts < ATTEMPTS;
            if attempts == 0 || again {
                self.write(&[&frame[..length], &behind[..behind_length]])?;
                attempts += 1;
                continue;
            }
            if nothing {
                continue;
            }
            match self.decoder.push::<Reply<'_>>(byte[0]) {
                None => {}
                Some(Ok(Reply { id, answer: Answer::Telemetry(telemetry) })) => self.keep(id, telemetry),
                Some(Ok(Reply { id, answer })) if id == self.id => {
                    return match answer {
                        Answer::Refused(Refusal::Demand(bad)) => Err(Error::Refused(words::demand(&ask, bad))),
                        Answer::Refused(refusal) => {
                            self.barred = refusal == Refusal::Drive(drive::Refusal::Fault(Fault::CommandTimeout));
                            Err(Error::Refused(words::refusal(&refusal)))
                        }
                        answer => {
                            if ask.controls() {
                                self.in_control = Some(asked);
                            }
                            understand(answer)
                        }
                    };
                }
                Some(Ok(Reply { id, .. })) if id == behind_id => {
                    passed_over += 1;
                    // Once, a byte may have been lost.
                    if let Some(lacks) = lacks.filter(|_| passed_over > 1) {
                        return Err(Error::Refused(lacks.into()));
                    }
                }
                Some(Ok(_)) => {}
                Some(Err(Frame::Version { found })) => return Err(Error::Version { found }),
                Some(Err(_)) => self.garbage = true,
            }
        }
        Err(Error::Silent { port: self.port.clone(), garbage: self.garbage })
    }

    fn lost(&self, source: std::io::Error) -> Error {
        Error::Lost { port: self.port.clone(), source }
    }

    fn write(&mut self, parts: &[&[u8]]) -> Result<()> {
        let writer = &mut self.line.writer;
        let written = parts.iter().try_for_each(|part| writer.write_all(part)).and_then(|()| writer.flush());
        written.map_err(|error| self.lost(error))
    }

    /// One byte, if one came before the time was up.
    fn read(&mut self, byte: &mut [u8; 1]) -> Result<bool> {
        match self.line.reader.read(byte) {
            Ok(0) => Err(self.lost(std::io::Error::new(ErrorKind::UnexpectedEof, "it was closed"))),
            Ok(_) => Ok(true),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(false),
            Err(error) if error.kind() == ErrorKind::Interrupted => Ok(false),
            Err(error) => Err(self.lost(error)),
        }
    }

    /// Asks for what is answered by `Done`. A drive that has stopped its motor while this tool asked for nothing is taken
    /// up again.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn order(&mut self, ask: Ask<'_>) -> Result<()> {
        let ordered = self.order_on(ask);
        if !self.barred {
            return ordered;
        }
        self.order_on(Ask::Release)?;
        self.order_on(ask)
    }

    /// The same where it goes on.
    fn order_on(&mut self, ask: Ask<'_>) -> Result<()> {
        self.ask(ask, |answer| match answer {
            Answer::Done => Ok(()),
            other => unexpected(&other),
        })
    }

    /// Whether it has been heard so lately that this tool controls the drive that it still does.
    fn is_sure(&self) -> bool {
        self.in_control.is_some_and(|since| since.elapsed() <= SURE)
    }

    /// Whether nobody has stopped or controlled the drive since this tool commanded it.
    ///
    /// # Errors
    /// Somebody has; no answer.
    pub fn still_controls(&mut self) -> Result<()> {
        if !self.is_sure() {
            self.status()?;
        }
        self.in_control.map(drop).ok_or_else(|| Error::Failed(words::TAKEN.into()))
    }

    /// Commands again what is to go on: a tool that was suspended does not turn a motor that somebody else has armed
    /// meanwhile, nor one that has come to rest because nothing came, as where computer or link stood still.
    ///
    /// # Errors
    /// As [`Self::still_controls`] and [`Self::ask`].
    pub fn repeat(&mut self, ask: Ask<'_>) -> Result<()> {
        self.still_controls()?;
        let ordered = self.order_on(ask);
        if self.barred { Err(Error::Failed(words::TAKEN.into())) } else { ordered }
    }

    /// Arms, and waits until the drive has checked wires, amplifiers and direction.
    ///
    /// # Errors
    /// Refused, or the check has found a fault, which is named.
    pub fn arm(&mut self) -> Result<()> {
        self.order(Ask::Arm)?;
        let mut look = (Instant::now(), 0);
        loop {
            let status = self.status()?;
            if let Mode::Faulted(fault) = status.mode {
                return Err(Error::Failed(words::switched_off(fault)));
            }
            if !status.limits.contains(Limits::CHECKING) {
                return Ok(());
            }
            // So short that a drive which is commanded next has its time.
            self.pause(&mut look, &status, SHORT)?;
        }
    }

    /// Ends the telemetry; frames that came before the answer are kept.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn end_telemetry(&mut self) -> Result<()> {
        self.order(Ask::Telemetry(0.0))
    }

    /// Gives up the control, if it was ever asked for, so that the next tool does not have to wait.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn release(&mut self) -> Result<()> {
        if self.controls { self.order(Ask::Release) } else { Ok(()) }
    }

    /// How the drive is.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn status(&mut self) -> Result<Status> {
        let asked = Instant::now();
        let status = self.ask(Ask::Status, |answer| match answer {
            Answer::Status(status) => Ok(status),
            other => unexpected(&other),
        })?;
        if self.is_me(status.client) {
            self.in_control = Some(asked);
        } else if !self.is_sure() {
            self.in_control = None;
        }
        Ok(status)
    }

    /// What went wrong since power-up: how often in all, and the latest that are kept, the last first.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn incidents(&mut self) -> Result<(u32, Vec<Incident>)> {
        let (mut total, mut incidents) = (0, Vec::new());
        for number in 0..self.status()?.incidents {
            let history = self.ask(Ask::History(number), |answer| match answer {
                Answer::History(history) => Ok(history),
                other => unexpected(&other),
            })?;
            total = history.total;
            let Some(incident) = history.entry else { break };
            incidents.push(incident);
        }
        Ok((total, incidents))
    }

    /// Asks for a setting, and hands it to `understand`.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn setting<R>(&mut self, ask: Ask<'_>, understand: impl FnOnce(&Setting<'_>) -> R) -> Result<R> {
        self.ask(ask, |answer| match answer {
            Answer::Setting(setting) => Ok(understand(&setting)),
            other => unexpected(&other),
        })
    }

    /// Waits between two looks at the drive, collecting telemetry; not for a simulated drive that is ahead of the wall.
    /// `before` is the look before, `status` the one now; there are four looks at least in the time for which a command
    /// holds.
    ///
    /// # Errors
    /// The connection broke.
    pub fn rest(&mut self, before: &mut (Instant, u64), status: &Status) -> Result<()> {
        self.pause(before, status, EVERY)
    }

    /// The same for another time on the wall at most.
    ///
    /// # Errors
    /// The connection broke.
    pub fn pause(&mut self, before: &mut (Instant, u64), status: &Status, most: Duration) -> Result<()> {
        let (wall, drive_ms) = *before;
        let passed = Duration::from_millis(status.uptime_ms.saturating_sub(drive_ms));
        if passed < 2 * wall.elapsed() || passed.is_zero() {
            self.listen(
                Duration::try_from_secs_f32(status.command_timeout_s / 4.0).map_or(most, |time| time.min(most)),
            )?;
        }
        *before = (Instant::now(), status.uptime_ms);
        Ok(())
    }

    /// Waits for so much of the drive's time, collecting telemetry.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub fn wait_ms(&mut self, ms: u64) -> Result<()> {
        let began_ms = self.status()?.uptime_ms;
        let mut look = (Instant::now(), began_ms);
        loop {
            let status = self.status()?;
            if status.uptime_ms >= began_ms + ms {
                return Ok(());
            }
            self.pause(&mut look, &status, SHORT)?;
        }
    }

    /// Collects telemetry for a time on the wall.
    ///
    /// # Errors
    /// The connection broke, or a signal has come.
    pub fn listen(&mut self, time: Duration) -> Result<()> {
        let (began, mut byte) = (Instant::now(), [0]);
        while began.elapsed() < time {
            self.check()?;
            if self.read(&mut byte)?
                && let Some(Ok(Reply { id, answer: Answer::Telemetry(telemetry) })) = self.decoder.push(byte[0])
            {
                self.keep(id, telemetry);
            }
        }
        Ok(())
    }

    /// Keeps a frame, unless it was asked for before the last request for telemetry.
    fn keep(&mut self, id: u16, telemetry: Telemetry) {
        if id == self.stream {
            self.telemetry.push_back(telemetry);
        }
    }

    /// Telemetry that came with the answers so far.
    pub fn telemetry(&mut self) -> Option<Telemetry> {
        self.telemetry.pop_front()
    }
}

/// A drive that answers something else.
///
/// # Errors
/// Always.
pub fn unexpected<T>(answer: &Answer<'_>) -> Result<T> {
    Err(Error::Other(anyhow::anyhow!("the drive answered something else: {answer:?}")))
}
