//! From a message to a frame, and from a stream of bytes to messages.

use crate::fields::{self, Bytes, write};
use crate::{FRAME, MESSAGE, VERSION};
use core::fmt;
use hallservo::crc::crc32;
use serde::{Deserialize, Serialize};

/// Where a frame has the byte of COBS, behind the zero, and what is encoded: version, message, CRC.
const CODE: usize = 1;
const INSIDE: usize = CODE + 1;
/// Most bytes between the zeros.
const OUTSIDE: usize = FRAME - 2;
const _: () = assert!(OUTSIDE < 255, "distances of COBS are one byte");

/// Why bytes are no message, or a message is no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// More than a frame may have.
    TooLong,
    /// Not COBS, or too short.
    Garbled,
    /// The CRC is wrong.
    Checksum,
    /// Whole, but of another version of this protocol.
    Version {
        /// What the other side speaks.
        found: u8,
    },
    /// Whole and of this version, but no message.
    Meaningless,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong => write!(f, "longer than a frame may be ({FRAME} bytes)"),
            Self::Garbled => write!(f, "not a frame"),
            Self::Checksum => write!(f, "a frame with a wrong checksum"),
            Self::Version { found } => {
                write!(f, "the other side speaks version {found} of the protocol, this one version {VERSION}")
            }
            Self::Meaningless => write!(f, "a frame that holds no message"),
        }
    }
}

impl core::error::Error for Error {}

/// Writes the frame of a message and returns its length.
///
/// # Errors
/// [`Error::TooLong`] for a message of more than [`MESSAGE`] bytes.
pub fn encode<T: Serialize>(message: &T, frame: &mut [u8; FRAME]) -> Result<usize, Error> {
    let mut frame = Bytes::new(frame);
    frame.push_all(&[0, 0, VERSION]);
    let can = write(message, &mut frame);
    if !can || frame.length() > INSIDE + 1 + MESSAGE {
        return Err(Error::TooLong);
    }
    let checksum = crc32(frame.written(INSIDE));
    frame.push_word(checksum);
    stuff(frame.written(CODE));
    frame.push(0);
    Ok(frame.length())
}

/// COBS of what is shorter than 254 bytes, behind a zero: every zero becomes the distance to the next one, the last to the
/// end.
fn stuff(bytes: &mut [u8]) {
    let mut distance = 1;
    for byte in bytes.iter_mut().rev() {
        if *byte == 0 {
            *byte = core::mem::take(&mut distance);
        }
        distance += 1;
    }
}

/// What [`stuff`] made a frame of; none where a distance leads beyond the end.
fn unstuff(frame: &mut [u8]) -> Option<&[u8]> {
    let mut next = 0;
    for (place, byte) in frame.iter_mut().enumerate() {
        if place == next {
            next += usize::from(core::mem::take(byte));
        }
    }
    if next == frame.len() { frame.get(1..) } else { None }
}

/// Finds frames in a stream of bytes. Whatever comes, it never holds more than a frame, and is in step again after the
/// next zero.
pub type Decoder = FrameDecoder<OUTSIDE>;

/// The same for frames of up to `ROOM` bytes, as they are between two zeros; longer ones are [`Error::TooLong`].
#[derive(Clone, Debug)]
pub struct FrameDecoder<const ROOM: usize> {
    frame: [u8; ROOM],
    /// Bytes since the last zero, of which there may be more than the frame holds.
    length: usize,
}

impl<const ROOM: usize> Default for FrameDecoder<ROOM> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const ROOM: usize> FrameDecoder<ROOM> {
    /// Between two frames.
    pub const fn new() -> Self {
        const { assert!(ROOM <= OUTSIDE) };
        Self { frame: [0; ROOM], length: 0 }
    }

    /// Takes a byte. At the end of a frame there is its message, or why it is none; the message may borrow from the
    /// decoder.
    pub fn push<'a, T: Deserialize<'a>>(&'a mut self, byte: u8) -> Option<Result<T, Error>> {
        if byte != 0 {
            if let Some(place) = self.frame.get_mut(self.length) {
                *place = byte;
            }
            self.length = (self.length + 1).min(ROOM + 1);
            return None;
        }
        match core::mem::take(&mut self.length) {
            0 => None,
            length => Some(match self.frame.get_mut(..length) {
                Some(frame) => decode(frame),
                None => Err(Error::TooLong),
            }),
        }
    }
}

// Shared by the decoders of all sizes.
#[inline(never)]
fn decode<'a, T: Deserialize<'a>>(frame: &'a mut [u8]) -> Result<T, Error> {
    let (inside, checksum) = unstuff(frame).and_then(<[u8]>::split_last_chunk).ok_or(Error::Garbled)?;
    if crc32(inside) != u32::from_le_bytes(*checksum) {
        return Err(Error::Checksum);
    }
    match inside.split_first().ok_or(Error::Garbled)? {
        (&VERSION, message) => fields::read(message).ok_or(Error::Meaningless),
        (&found, _) => Err(Error::Version { found }),
    }
}
