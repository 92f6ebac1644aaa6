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
//! was asked for. `d stop` puts an end to all lines that wait.

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

use crate::tunnel::Tunnel;
use answer::Answer;
use core::fmt::Write;
use lines::{LINE, Lines, Next, Note};
use piece::Stage;
use source::Channel;

/// Most bytes of a refusal.
const SENTENCE: usize = 200;

/// The state of the channel.
#[derive(Debug)]
pub struct Diagnostic {
    lines: Lines,
    answer: Answer,
    stage: Stage,
    /// The refusal that the answer is.
    sentence: heapless::String<SENTENCE>,
    channels: [Rate; Channel::ALL.len()],
    /// The channel that was sent last by itself.
    last: usize,
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
            lines: Lines::new(),
            answer: Answer::None,
            stage: Stage::new(),
            sentence: heapless::String::new(),
            channels: [NEVER; Channel::ALL.len()],
            last: 0,
        }
    }

    /// The channel at a drive, for a server.
    pub const fn at<'a, H: Host>(&'a mut self, host: &'a mut H) -> At<'a, H> {
        At { channel: self, host }
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
        self.proceed(host);
    }

    /// Takes bytes from the client.
    pub fn receive<H: Host>(&mut self, host: &mut H, bytes: &[u8]) {
        for byte in bytes {
            if self.lines.push(*byte) {
                self.end_line(host);
                self.lines.begin();
                self.proceed(host);
            }
        }
    }

    /// Writes what is to go to the client, and returns how many bytes; 0 where there is nothing.
    pub fn transmit<H: Host>(&mut self, host: &mut H, buffer: &mut [u8]) -> usize {
        let mut length = 0;
        while let Some(rest) = buffer.get_mut(length..).filter(|rest| !rest.is_empty()) {
            if self.stage.is_empty() && !self.produce(host) {
                break;
            }
            length += self.stage.take(rest);
        }
        length
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
                    () => motion::carry_out(host, motion).err().unwrap_or(Note::Done),
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

    /// Writes the next piece of what is to go out; false where there is none.
    fn produce<H: Host>(&mut self, host: &mut H) -> bool {
        loop {
            self.proceed(host);
            let Self { answer, stage, sentence, channels, .. } = self;
            match answer {
                Answer::Awaited => return false,
                Answer::None => break,
                _ => {}
            }
            *answer = answer.piece(host, stage, sentence, |channel| channels[channel as usize].as_text);
            if !self.stage.is_empty() {
                return true;
            }
        }
        self.send_due(host)
    }

    /// Sends the channel that is due, in turns.
    fn send_due<H: Host>(&mut self, host: &H) -> bool {
        let count = Channel::ALL.len();
        let Some(due) = (1..=count).map(|ahead| (self.last + ahead) % count).find(|one| self.channels[*one].is_due)
        else {
            return false;
        };
        self.last = due;
        self.channels[due].is_due = false;
        let as_text = self.channels[due].as_text;
        self.stage.fill(|piece| answer::emit(Channel::ALL[due], as_text, host, piece));
        true
    }
}

/// The channel at a drive.
pub struct At<'a, H> {
    channel: &'a mut Diagnostic,
    host: &'a mut H,
}

impl<H: Host> Tunnel for At<'_, H> {
    fn receive(&mut self, bytes: &[u8]) {
        self.channel.receive(self.host, bytes);
    }

    fn transmit(&mut self, buffer: &mut [u8]) -> usize {
        self.channel.transmit(self.host, buffer)
    }
}
