//! From a message to a frame, and from a stream of bytes to messages.

use crate::{FRAME, MESSAGE, VERSION};
use core::fmt;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use postcard::ser_flavors::Flavor;
use serde::{Deserialize, Serialize};

const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);
const CHECKSUM: usize = 4;
/// Version, message, CRC.
const INSIDE: usize = 1 + MESSAGE + CHECKSUM;
/// With the byte of COBS.
const OUTSIDE: usize = INSIDE + 1;

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
    let mut inside = [0; INSIDE];
    inside[0] = VERSION;
    let flavor = Counted { bytes: &mut inside[1..1 + MESSAGE], length: 0 };
    // Only counting can fail, and that is looked at once, here.
    let length = postcard::serialize_with_flavor(message, flavor).map_err(|_| Error::TooLong)? + 1;
    if length > 1 + MESSAGE {
        return Err(Error::TooLong);
    }
    let checksum = CRC.checksum(&inside[..length]).to_le_bytes();
    inside[length..length + CHECKSUM].copy_from_slice(&checksum);
    frame[0] = 0;
    // One byte longer than what it encodes, as that is shorter than 254 bytes.
    let encoded = cobs::encode(&inside[..length + CHECKSUM], &mut frame[1..]);
    frame[1 + encoded] = 0;
    Ok(encoded + 2)
}

/// Takes every byte, and counts those that have no room as well: no field has to look whether the one before was taken,
/// which would be a kilobyte of code on a chip.
struct Counted<'a> {
    bytes: &'a mut [u8],
    length: usize,
}

impl Counted<'_> {
    #[inline(never)]
    fn push_all(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        bytes.iter().try_for_each(|byte| self.try_push(*byte))
    }

    /// Most numbers have four bytes, and a register takes less code than an address: 176 bytes of a chip's flash.
    #[inline(never)]
    fn push_word(&mut self, word: u32) -> postcard::Result<()> {
        self.push_all(&word.to_le_bytes())
    }
}

impl Flavor for Counted<'_> {
    type Output = usize;

    #[inline(never)]
    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        if let Some(place) = self.bytes.get_mut(self.length) {
            *place = byte;
        }
        self.length += 1;
        Ok(())
    }

    #[inline(always)]
    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        match bytes.try_into() {
            Ok(word) => self.push_word(u32::from_le_bytes(word)),
            Err(_) => self.push_all(bytes),
        }
    }

    fn finalize(self) -> postcard::Result<usize> {
        Ok(self.length)
    }
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
            length => Some(self.frame.get_mut(..length).ok_or(Error::TooLong).and_then(decode)),
        }
    }
}

// Shared by the decoders of all sizes.
#[inline(never)]
fn decode<'a, T: Deserialize<'a>>(frame: &'a mut [u8]) -> Result<T, Error> {
    let length = cobs::decode_in_place(frame).map_err(|_| Error::Garbled)?;
    let (inside, checksum) = frame.get(..length).and_then(<[u8]>::split_last_chunk).ok_or(Error::Garbled)?;
    if CRC.checksum(inside) != u32::from_le_bytes(*checksum) {
        return Err(Error::Checksum);
    }
    match inside.split_first().ok_or(Error::Garbled)? {
        (&VERSION, message) => match postcard::take_from_bytes(message) {
            Ok((message, [])) => Ok(message),
            _ => Err(Error::Meaningless),
        },
        (&found, _) => Err(Error::Version { found }),
    }
}
