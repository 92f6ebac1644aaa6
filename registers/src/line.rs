//! Frames as lines of text, as an fdcanusb adapter takes and gives them, with the check sum that a serial line needs.
//!
//! ```text
//! > can send 8001 01000a1100 *9D
//! < OK *BD
//! < rcv 100 21000a *53
//! ```
//! A request that has a check sum makes all further ones need one. What the drive writes always has one.
//!
//! The line may carry another protocol, in frames between two zeros: within such a frame nothing is text. It is known
//! by a byte that no text has, which has to be in its first two; and it is over after [`FOREIGN`] bytes at most.

use crate::frame::Bytes;
use crate::server::{Reply, Request};
use core::fmt;
use crc::{Algorithm, Crc, NoTable};
use heapless::String;

/// The CRC-8 of the lines.
const CRC: Crc<u8, NoTable> = Crc::<u8, NoTable>::new(&Algorithm {
    width: 8,
    poly: 0x97,
    init: 0,
    refin: false,
    refout: false,
    xorout: 0,
    check: 0,
    residue: 0,
});

/// Most bytes of a line to the drive: words, identifier, 64 bytes, flags, check sum.
const ROOM: usize = 192;
/// Most bytes of a line from the drive.
pub const LINE: usize = 160;
/// Most bytes of a frame of the other protocol, zeros not counted.
pub const FOREIGN: u16 = 256;

/// A line from the drive.
pub type Line = String<LINE>;

/// Why a line is no request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// It has no check sum, and has to have one.
    NoChecksum,
    /// The check sum is wrong.
    Checksum,
    /// It is longer than any.
    TooLong,
    /// It is none that is known here.
    Unknown,
    /// Its numbers are none, or too many.
    Malformed,
}

impl Error {
    const fn text(self) -> &'static str {
        match self {
            Self::NoChecksum => "checksum missing",
            Self::Checksum => "checksum mismatch",
            Self::TooLong => "line too long",
            Self::Unknown => "unknown command",
            Self::Malformed => "malformed frame",
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text())
    }
}

/// What the bytes since the last zero are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Segment {
    /// Lines of text.
    Text,
    /// So many bytes after a zero, of which none says what they are.
    Open(u16),
    /// So many bytes after a zero: a frame of the other protocol.
    Foreign(u16),
}

/// Finds requests in a stream of bytes.
#[derive(Clone, Debug)]
pub struct Decoder {
    line: heapless::Vec<u8, ROOM>,
    /// Whether the line has more than there is room for, or a byte that no text has: it is no line.
    spoilt: bool,
    long: bool,
    segment: Segment,
    /// Whether each line has to have a check sum.
    demands: bool,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self { line: heapless::Vec::new(), spoilt: false, long: false, segment: Segment::Text, demands: false }
    }

    /// Takes a byte. At the end of a line there is its request, or why it is none; an empty line is nothing.
    pub fn push(&mut self, byte: u8) -> Option<Result<Request, Error>> {
        self.follow(byte);
        if matches!(self.segment, Segment::Foreign(_)) || byte == 0 {
            self.line.clear();
            (self.spoilt, self.long) = (false, false);
            return None;
        }
        match byte {
            b'\r' | b'\n' => self.end(),
            b' '..=b'~' | b'\t' => {
                self.long |= self.line.push(byte).is_err();
                None
            }
            _ => {
                self.spoilt = true;
                None
            }
        }
    }

    /// What the byte says about whose bytes these are.
    fn follow(&mut self, byte: u8) {
        let printable = matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n');
        self.segment = match self.segment {
            _ if byte == 0 => Segment::Open(0),
            Segment::Text => Segment::Text,
            Segment::Open(FOREIGN) => Segment::Text,
            Segment::Foreign(FOREIGN) => {
                // What is left of the line is none.
                self.spoilt = true;
                Segment::Text
            }
            Segment::Open(count) if printable => Segment::Open(count + 1),
            Segment::Open(count) | Segment::Foreign(count) => Segment::Foreign(count + 1),
        };
    }

    fn end(&mut self) -> Option<Result<Request, Error>> {
        let Self { line, spoilt, long, demands, .. } = self;
        let request = match (core::mem::take(spoilt), core::mem::take(long)) {
            (true, _) => None,
            (false, true) => Some(Err(Error::TooLong)),
            (false, false) if line.iter().all(u8::is_ascii_whitespace) => None,
            (false, false) => Some(request(line, demands)),
        };
        line.clear();
        request
    }
}

fn request(line: &[u8], demands: &mut bool) -> Result<Request, Error> {
    let line = checked(line, demands)?;
    // A frame without bytes is an empty word.
    let mut words = line.split(|letter| *letter == b' ');
    if (words.next(), words.next()) != (Some(b"can"), Some(b"send")) {
        return Err(Error::Unknown);
    }
    let identifier = words.next().and_then(identifier).ok_or(Error::Malformed)?;
    let bytes = bytes(words.next().unwrap_or_default()).ok_or(Error::Malformed)?;
    // Flags say how the frame would be on a bus, and there is none.
    if words.any(|word| !word.iter().all(|letter| b"bBfFeErR".contains(letter))) {
        return Err(Error::Malformed);
    }
    Ok(Request { identifier, bytes })
}

/// The line without its check sum, which every line has to have after the first that has one.
fn checked<'a>(line: &'a [u8], demands: &mut bool) -> Result<&'a [u8], Error> {
    let line = line.trim_ascii_end();
    let Some((content, [b'*', high, low])) = line.split_last_chunk::<3>() else {
        return if *demands { Err(Error::NoChecksum) } else { Ok(line) };
    };
    let sum = digit(*high).zip(digit(*low)).map(|(high, low)| high << 4 | low);
    if sum != Some(CRC.checksum(content)) {
        return Err(Error::Checksum);
    }
    *demands = true;
    Ok(content)
}

fn digit(letter: u8) -> Option<u8> {
    char::from(letter).to_digit(16).map(|digit| digit as u8)
}

fn identifier(word: &[u8]) -> Option<u32> {
    if !(1..=8).contains(&word.len()) {
        return None;
    }
    let value = word.iter().try_fold(0, |value, letter| Some(value << 4 | u32::from(digit(*letter)?)))?;
    // Of CAN, 29 bits.
    (value < 1 << 29).then_some(value)
}

fn bytes(word: &[u8]) -> Option<Bytes> {
    if !word.len().is_multiple_of(2) {
        return None;
    }
    let mut bytes = Bytes::new();
    for pair in word.chunks_exact(2) {
        let [high, low] = pair else { return None };
        bytes.push(digit(*high)? << 4 | digit(*low)?).ok()?;
    }
    Some(bytes)
}

/// The line that says that a request has been taken.
pub fn ok() -> Line {
    finished("OK", "", &[])
}

/// The line that says why a line was none.
pub fn error(error: Error) -> Line {
    finished("ERR ", error.text(), &[])
}

/// The line of a reply.
pub fn reply(reply: &Reply) -> Line {
    let mut identifier = String::<9>::new();
    let digits = (32 - reply.identifier.leading_zeros()).div_ceil(4).max(1);
    for place in (0..digits).rev() {
        let _ = identifier.push(letter((reply.identifier >> (4 * place)) as u8, b'a'));
    }
    let _ = identifier.push(' ');
    finished("rcv ", &identifier, &reply.bytes)
}

/// A digit, those from ten on counted from a letter. The formatting of the language would be a kilobyte of code on a chip.
const fn letter(digit: u8, ten: u8) -> char {
    let digit = digit & 15;
    (if digit < 10 { b'0' + digit } else { ten - 10 + digit }) as char
}

/// Two words and bytes, with check sum and end. Every line has room, which a test shows.
fn finished(first: &str, second: &str, bytes: &[u8]) -> Line {
    let mut line = Line::new();
    let mut push = |letter| _ = line.push(letter);
    first.chars().chain(second.chars()).for_each(&mut push);
    bytes.iter().flat_map(|byte| [letter(byte >> 4, b'a'), letter(*byte, b'a')]).for_each(&mut push);
    push(' ');
    let sum = CRC.checksum(line.as_bytes());
    for letter in ['*', letter(sum >> 4, b'A'), letter(sum, b'A'), '\n'] {
        let _ = line.push(letter);
    }
    line
}
