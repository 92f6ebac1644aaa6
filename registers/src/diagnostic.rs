//! The diagnostic channel of moteus clients: lines of text in, text and binary data out, through a [`Tunnel`].
//!
//! What `moteus_tool` and `tview` need of it: the settings as a configuration, telemetry with its schema, and commands
//! that a person types. Made from the public documentation of the protocol (repository `mjbots/moteus`:
//! `docs/protocol/diagnostic.md`) and of its format of telemetry (`mjbots/mjlib`: `mjlib/telemetry/README.md`).
//!
//! ```text
//! d stop|pos|zero|within|dq|brake|nearest|exact|req-reindex|recapture
//! conf enumerate|list|get|set|write|load|default|schema|data
//! tel list|schema|get|fmt|text|rate|stop
//! ```
//!
//! A line is answered by what it asks for, then by `OK`; or by `ERR` and why not. Answers come in the order of the
//! lines, piece by piece as the client takes them, whatever their length; nothing is kept but one piece. What begins
//! with `d` does not wait for its turn: it is obeyed when it comes or not at all, so that no motion begins long after it
//! was asked for. `d stop` puts an end to all lines that wait. A motion lasts as long as the client reads, unless it says
//! how long (`t`) or something else is commanded, by whomever.

mod answer;
mod command;
mod host;
mod lines;
mod motion;
mod piece;
mod record;
mod source;
mod value;

pub use host::{Change, Host, Kind, Setting};
pub use record::{Build, Halls};

use crate::axis::Command;
use crate::{FRAME, Tunnel};
use answer::Answer;
use core::fmt::Write;
use lines::{LINE, Lines, Next, Note};
use piece::Stage;
use source::Channel;

/// How long a client may not read until its motion is not renewed any more: one with a window is often at work.
const SILENCE_MS: u16 = 1000;
/// From one renewal to the next: well within the drive's time-out.
const RENEWAL_MS: u8 = 20;
/// Most bytes of a refusal.
const SENTENCE: usize = 200;

/// The state of the channel.
#[derive(Debug)]
pub struct Diagnostic {
    /// Bytes of the last frame.
    received: heapless::Vec<u8, FRAME>,
    lines: Lines,
    answer: Answer,
    stage: Stage,
    /// The refusal that the answer is.
    sentence: heapless::String<SENTENCE>,
    channels: [Rate; Channel::ALL.len()],
    /// The channel that was sent last by itself.
    last: usize,
    /// Whether the client has read since.
    is_read: bool,
    /// Since it last read, ms.
    silent_ms: u16,
    /// The motion that lasts as long as it reads.
    motion: Option<Command>,
    /// Until it is renewed, ms.
    renew_ms: u8,
}

/// How often a channel is sent by itself.
#[derive(Clone, Copy, Debug, Default)]
struct Rate {
    /// From one time to the next, ms; 0 for never.
    period_ms: u16,
    /// Until then, ms.
    left_ms: u16,
    is_due: bool,
    as_text: bool,
}

impl Default for Diagnostic {
    fn default() -> Self {
        Self::new()
    }
}

impl Diagnostic {
    /// Nobody has asked for anything.
    pub const fn new() -> Self {
        const NEVER: Rate = Rate { period_ms: 0, left_ms: 0, is_due: false, as_text: false };
        Self {
            received: heapless::Vec::new(),
            lines: Lines::new(),
            answer: Answer::None,
            stage: Stage::new(),
            sentence: heapless::String::new(),
            channels: [NEVER; Channel::ALL.len()],
            last: 0,
            is_read: false,
            silent_ms: 0,
            motion: None,
            renew_ms: 0,
        }
    }

    /// Once a millisecond.
    pub fn tick<H: Host>(&mut self, host: &mut H) {
        for channel in &mut self.channels {
            channel.left_ms = channel.left_ms.saturating_sub(1);
            if channel.period_ms > 0 && channel.left_ms == 0 {
                channel.left_ms = channel.period_ms;
                channel.is_due = true;
            }
        }
        self.silent_ms = self.silent_ms.saturating_add(1);
        self.renew(host);
        self.serve(host);
    }

    /// After every frame: carries out what it brought, and prepares what the next one asks for.
    pub fn serve<H: Host>(&mut self, host: &mut H) {
        for byte in core::mem::take(&mut self.received) {
            if self.lines.push(byte) {
                self.end_line(host);
                self.lines.begin();
                self.proceed(host);
            }
        }
        if self.stage.is_empty() {
            self.produce(host);
        }
    }

    /// A person types a motion once: it lasts as long as the client is there, unless it has a time of its own.
    fn renew<H: Host>(&mut self, host: &mut H) {
        self.renew_ms = self.renew_ms.saturating_sub(1);
        if let Some(motion) = self.motion.filter(|_| self.renew_ms == 0) {
            self.renew_ms = RENEWAL_MS;
            if self.silent_ms > SILENCE_MS || !host.renew(&motion) {
                self.motion = None;
            }
        }
    }

    /// What moves the motor, or stops it, is carried out now or never.
    fn end_line<H: Host>(&mut self, host: &mut H) {
        let (line, is_waiting) = (self.lines.line(), self.lines.is_waiting() || self.answer == Answer::Awaited);
        let note = match line.map(|line| line.strip_prefix("d ")) {
            None => Note::Garbled,
            Some(None) => return self.lines.keep(),
            Some(Some(motion)) => {
                let stops = motion.trim() == "stop";
                let note = match () {
                    () if is_waiting && !stops => Note::Late,
                    () => motion::carry_out(host, motion, &mut self.motion).err().unwrap_or(Note::Done),
                };
                if stops {
                    self.lines.stop();
                }
                note
            }
        };
        self.lines.note(note);
    }

    /// Carries out the lines that wait, as far as nothing stands against it.
    fn proceed<H: Host>(&mut self, host: &mut H) {
        if self.answer == Answer::Awaited
            && let Some(outcome) = host.outcome()
        {
            self.answer = match outcome {
                Ok(()) => Answer::DONE,
                Err(refusal) => self.refuse(format_args!("{refusal}")),
            };
        }
        if self.answer != Answer::None {
            return;
        }
        let mut place = heapless::Vec::<u8, LINE>::new();
        self.answer = match self.lines.next(&mut place) {
            None => return,
            Some(Next::Line(line)) => self.carry_out(host, line),
            Some(Next::Note(note)) => Answer::Word(note.text()),
        };
    }

    fn refuse(&mut self, why: core::fmt::Arguments<'_>) -> Answer {
        self.sentence.clear();
        // What has no room is left out.
        let _ = self.sentence.write_fmt(why);
        Answer::Refused
    }

    /// Writes the next piece of what is to go out, if there is one.
    fn produce<H: Host>(&mut self, host: &mut H) {
        loop {
            self.proceed(host);
            let Self { answer, stage, sentence, channels, .. } = self;
            match answer {
                Answer::Awaited => return,
                Answer::None => return self.send_due(host),
                _ => {}
            }
            *answer = answer.piece(host, stage, sentence, |channel| channels[channel as usize].as_text);
            if !self.stage.is_empty() {
                return;
            }
        }
    }

    /// Sends the channel that is due, in turns, to a client that reads.
    fn send_due<H: Host>(&mut self, host: &H) {
        let count = Channel::ALL.len();
        let due = (1..=count).map(|ahead| (self.last + ahead) % count).find(|one| self.channels[*one].is_due);
        let Some(due) = due.filter(|_| self.is_read) else { return };
        (self.last, self.is_read) = (due, false);
        self.channels[due].is_due = false;
        let as_text = self.channels[due].as_text;
        self.stage.fill(|piece| answer::emit(Channel::ALL[due], as_text, host, piece));
    }
}

impl Tunnel for Diagnostic {
    fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if self.received.push(*byte).is_err() {
                self.lines.spoil();
            }
        }
    }

    fn transmit(&mut self, buffer: &mut [u8]) -> usize {
        (self.is_read, self.silent_ms) = (true, 0);
        self.stage.take(buffer)
    }
}
