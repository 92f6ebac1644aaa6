//! Lines on their way in.

use heapless::{Deque, Vec};

/// Most bytes of a line.
pub(super) const LINE: usize = 127;
/// Bytes of lines that may wait for the answers to those before.
const ROOM: usize = 256;

/// What is to be answered next.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Next<'a> {
    /// A line to carry out.
    Line(&'a str),
    /// A line that was refused, or is carried out already.
    Note(Note),
}

/// What has become of a line before its turn came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Note {
    /// Carried out when it came.
    Done,
    /// It moves the motor, and other lines waited when it came.
    Late,
    /// It was too long, or had other bytes than ASCII has.
    Garbled,
    /// A stop came after it.
    Stopped,
    /// Too many lines waited.
    Crowded,
    /// No such command.
    Unknown,
    /// A value is missing.
    Missing,
    /// Something that should be a number is none.
    Number,
    /// No such option.
    Option,
    /// Known to clients, and not to this drive.
    Unsupported,
    /// The drive does not.
    Refused,
}

impl Note {
    /// In the queue, each is a byte that no line has.
    const ALL: [Self; 11] = [
        Self::Done,
        Self::Late,
        Self::Garbled,
        Self::Stopped,
        Self::Crowded,
        Self::Unknown,
        Self::Missing,
        Self::Number,
        Self::Option,
        Self::Unsupported,
        Self::Refused,
    ];

    const fn byte(self) -> u8 {
        // A line feed ends a line.
        match self as u8 + 1 {
            b'\n' => b'\r',
            byte => byte,
        }
    }

    fn of(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|note| note.byte() == byte)
    }

    /// The answer.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Done => "OK",
            Self::Late => "ERR not obeyed: it came while other lines waited",
            Self::Garbled => "ERR the line is longer than 127 bytes, or no ASCII",
            Self::Stopped => "ERR not carried out: a stop came after it",
            Self::Crowded => "ERR not carried out: too many lines waited",
            Self::Unknown => "ERR unknown command",
            Self::Missing => "ERR a value is missing",
            Self::Number => "ERR not a number",
            Self::Option => "ERR unknown option",
            Self::Unsupported => "ERR this drive does not have it",
            Self::Refused => "ERR refused: the drive cannot now, or another tool controls it",
        }
    }
}

/// The line that comes, and those that wait.
#[derive(Debug, Default)]
pub(super) struct Lines {
    line: Vec<u8, LINE>,
    garbled: bool,
    waiting: Deque<u8, ROOM>,
    /// Lines that found no room, after all that wait.
    crowded: u16,
}

impl Lines {
    pub const fn new() -> Self {
        Self { line: Vec::new(), garbled: false, waiting: Deque::new(), crowded: 0 }
    }

    /// Takes a byte; true where a line ends that is not empty.
    pub fn push(&mut self, byte: u8) -> bool {
        match byte {
            b'\r' | b'\n' => return self.garbled || !self.line.is_empty(),
            b' ' | b'\t' if self.line.is_empty() => {}
            b' '..=b'~' => self.garbled |= self.line.push(byte).is_err(),
            b'\t' => self.garbled |= self.line.push(b' ').is_err(),
            _ => self.garbled = true,
        }
        false
    }

    /// Bytes of the line were lost.
    pub const fn spoil(&mut self) {
        self.garbled = true;
    }

    /// The line that has ended; `None` for one that cannot be understood.
    pub fn line(&self) -> Option<&str> {
        let text = core::str::from_utf8(&self.line).unwrap_or_default().trim();
        (!self.garbled).then_some(text)
    }

    /// Begins another one.
    pub fn begin(&mut self) {
        self.line.clear();
        self.garbled = false;
    }

    /// The line that has ended waits for its turn.
    pub fn keep(&mut self) {
        if self.crowded > 0 || self.waiting.len() + self.line.len() >= ROOM {
            self.crowded = self.crowded.saturating_add(1);
            return;
        }
        for byte in &self.line {
            // It has room.
            let _ = self.waiting.push_back(*byte);
        }
        let _ = self.waiting.push_back(b'\n');
    }

    /// The line that has ended is answered by a note, when its turn comes.
    pub fn note(&mut self, note: Note) {
        if self.crowded > 0 || self.waiting.push_back(note.byte()).is_err() {
            self.crowded = self.crowded.saturating_add(1);
        }
    }

    /// A stop has come: no line that waits is carried out.
    pub fn stop(&mut self) {
        for _ in 0..self.waiting.len() {
            match self.waiting.pop_front() {
                Some(b'\n') => _ = self.waiting.push_back(Note::Stopped.byte()),
                // Part of a line.
                Some(b' '..) => {}
                Some(note) => _ = self.waiting.push_back(note),
                None => {}
            }
        }
    }

    /// Whether a line waits to be carried out.
    pub fn is_waiting(&self) -> bool {
        self.waiting.iter().any(|byte| *byte == b'\n')
    }

    /// What is to be answered next; a line is put into `place`.
    pub fn next<'a>(&mut self, place: &'a mut Vec<u8, LINE>) -> Option<Next<'a>> {
        place.clear();
        while let Some(byte) = self.waiting.pop_front() {
            match byte {
                b'\n' => return Some(Next::Line(core::str::from_utf8(place).unwrap_or_default().trim())),
                // No line that waits is longer than the place.
                b' '.. => _ = place.push(byte),
                note => return Note::of(note).map(Next::Note),
            }
        }
        self.crowded = self.crowded.checked_sub(1)?;
        Some(Next::Note(Note::Crowded))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds a text, every line of which waits.
    fn keep(lines: &mut Lines, text: &str) {
        for byte in text.bytes() {
            if lines.push(byte) {
                lines.keep();
                lines.begin();
            }
        }
    }

    #[test]
    fn lines_wait_in_their_order_and_a_stop_answers_those_before() {
        let mut lines = Lines::new();
        keep(&mut lines, "one\r\n\r\n  two \nthree\n");
        let mut place = Vec::new();
        assert_eq!(lines.next(&mut place), Some(Next::Line("one")));
        lines.note(Note::Late);
        lines.stop();
        lines.note(Note::Done);
        for note in [Note::Stopped, Note::Stopped, Note::Late, Note::Done] {
            assert_eq!(lines.next(&mut place), Some(Next::Note(note)));
        }
        assert!(lines.next(&mut place).is_none());
    }

    #[test]
    fn every_note_is_known_by_its_byte() {
        for note in Note::ALL {
            assert_eq!(Note::of(note.byte()), Some(note));
            assert!(note.byte() < b' ' && note.byte() != b'\n');
        }
    }

    #[test]
    fn what_has_no_room_is_counted_and_answered_in_its_place() {
        let mut lines = Lines::new();
        // Eleven of 23 bytes fit; what comes after one that does not is not let in before it.
        keep(&mut lines, &"conf get servo.max_cur\n".repeat(13));
        lines.note(Note::Done);
        let mut place = Vec::new();
        for _ in 0..11 {
            assert_eq!(lines.next(&mut place), Some(Next::Line("conf get servo.max_cur")));
        }
        for _ in 0..3 {
            assert_eq!(lines.next(&mut place), Some(Next::Note(Note::Crowded)));
        }
        assert!(lines.next(&mut place).is_none());
    }

    #[test]
    fn a_line_that_is_too_long_or_no_ascii_is_known() {
        let mut lines = Lines::new();
        for (text, understood) in [("x".repeat(127), true), ("x".repeat(128), false), ("d stöp".into(), false)] {
            text.bytes().for_each(|byte| assert!(!lines.push(byte)));
            assert!(lines.push(b'\n'));
            assert_eq!(lines.line().is_some(), understood, "{text}");
            lines.begin();
            assert!(!lines.push(b'\n'));
        }
    }
}
