//! The sub-frames of a frame, and the numbers in them.

use crate::FRAME;
use heapless::Vec;

/// The bytes of a frame.
pub type Bytes = Vec<u8, FRAME>;

/// How a number is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One byte.
    Int8,
    /// Two bytes.
    Int16,
    /// Four bytes.
    Int32,
    /// IEEE 754, four bytes.
    Float,
}

impl Format {
    const fn of(kind: u8) -> Self {
        match (kind >> 2) & 3 {
            0 => Self::Int8,
            1 => Self::Int16,
            2 => Self::Int32,
            _ => Self::Float,
        }
    }

    const fn bits(self) -> u8 {
        (self as u8) << 2
    }

    /// Bytes of a number.
    pub const fn size(self) -> usize {
        match self {
            Self::Int8 => 1,
            Self::Int16 => 2,
            Self::Int32 | Self::Float => 4,
        }
    }
}

/// A number as it is in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// An integer of any of the three sizes, and which.
    Integer(i32, Format),
    /// A float.
    Float(f32),
}

/// What a frame consists of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SubFrame<'a> {
    /// Registers are to be written.
    Write(Values<'a>),
    /// Registers are to be read.
    Read {
        /// How they are to be written into the reply.
        format: Format,
        /// The first.
        first: u32,
        /// How many.
        count: u32,
    },
    /// Bytes to a channel of the drive.
    ToDrive {
        /// The channel.
        channel: u32,
        /// What is sent.
        bytes: &'a [u8],
    },
    /// Bytes of a channel are asked for.
    Poll {
        /// The channel.
        channel: u32,
        /// Most bytes that the answer may have.
        most: u32,
    },
    /// The same with a number, which says what has arrived already.
    PollAfter {
        /// The channel.
        channel: u32,
        /// The packet that has arrived last.
        packet: u8,
        /// Most bytes that the answer may have.
        most: u32,
    },
}

/// Values of successive registers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Values<'a> {
    format: Format,
    first: u32,
    bytes: &'a [u8],
}

impl Values<'_> {
    /// Registers and their values.
    pub fn iter(&self) -> impl Iterator<Item = (u32, Number)> + '_ {
        let Self { format, first, bytes } = *self;
        let registers = (0..).map(move |place| first.saturating_add(place));
        registers.zip(bytes.chunks_exact(format.size()).map(move |bytes| number(format, bytes)))
    }
}

fn number(format: Format, bytes: &[u8]) -> Number {
    match (format, bytes) {
        (Format::Int8, &[a]) => Number::Integer(i8::from_le_bytes([a]).into(), format),
        (Format::Int16, &[a, b]) => Number::Integer(i16::from_le_bytes([a, b]).into(), format),
        (Format::Int32, &[a, b, c, d]) => Number::Integer(i32::from_le_bytes([a, b, c, d]), format),
        (Format::Float, &[a, b, c, d]) => Number::Float(f32::from_le_bytes([a, b, c, d])),
        // A chunk has the size of the format.
        _ => Number::Float(f32::NAN),
    }
}

/// A frame that ends within a sub-frame, or has one that no client sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed;

/// Reads the sub-frames of a frame one after the other; after the first that is malformed nothing comes any more.
#[derive(Clone, Debug)]
pub struct SubFrames<'a>(&'a [u8]);

impl<'a> SubFrames<'a> {
    /// Of a frame.
    pub const fn of(frame: &'a [u8]) -> Self {
        Self(frame)
    }

    fn byte(&mut self) -> Option<u8> {
        let (byte, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*byte)
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    /// Seven bits a byte, the lowest first; at most 32 bits.
    fn varuint(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..32).step_by(7) {
            let byte = self.byte()?;
            let part = u32::from(byte & 0x7f);
            if shift == 28 && byte > 0x0f {
                return None;
            }
            value |= part << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn count(&mut self, kind: u8) -> Option<u32> {
        match kind & 3 {
            0 => self.varuint(),
            count => Some(count.into()),
        }
    }

    fn write(&mut self, kind: u8) -> Option<SubFrame<'a>> {
        let format = Format::of(kind);
        let count = self.count(kind)?;
        let first = self.varuint()?;
        let size = usize::try_from(count).ok()?.checked_mul(format.size())?;
        Some(SubFrame::Write(Values { format, first, bytes: self.take(size)? }))
    }

    fn read(&mut self, kind: u8) -> Option<SubFrame<'a>> {
        let (format, count) = (Format::of(kind), self.count(kind)?);
        Some(SubFrame::Read { format, count, first: self.varuint()? })
    }

    fn stream(&mut self) -> Option<SubFrame<'a>> {
        let channel = self.varuint()?;
        let length = self.varuint()?.try_into().ok()?;
        Some(SubFrame::ToDrive { channel, bytes: self.take(length)? })
    }

    fn sub_frame(&mut self, kind: u8) -> Option<SubFrame<'a>> {
        match kind {
            0x00..=0x0f => self.write(kind),
            0x10..=0x1f => self.read(kind),
            0x40 => self.stream(),
            0x42 => Some(SubFrame::Poll { channel: self.varuint()?, most: self.varuint()? }),
            0x44 => Some(SubFrame::PollAfter { channel: self.varuint()?, packet: self.byte()?, most: self.varuint()? }),
            _ => None,
        }
    }
}

impl<'a> Iterator for SubFrames<'a> {
    type Item = Result<SubFrame<'a>, Malformed>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let kind = self.byte()?;
            if kind == NOP {
                continue;
            }
            let sub_frame = self.sub_frame(kind);
            if sub_frame.is_none() {
                self.0 = &[];
            }
            return Some(sub_frame.ok_or(Malformed));
        }
    }
}

/// Padding.
pub const NOP: u8 = 0x50;
const REPLY: u8 = 0x20;
const WRITE_ERROR: u8 = 0x30;
const READ_ERROR: u8 = 0x31;
const FROM_DRIVE: u8 = 0x41;
const NUMBERED_FROM_DRIVE: u8 = 0x43;

/// Bytes that a data field of CAN-FD has for so many.
pub const fn padded(length: usize) -> usize {
    match length {
        0..=8 => length,
        9..=24 => length.next_multiple_of(4),
        25..=32 => 32,
        33..=48 => 48,
        _ => FRAME,
    }
}

fn push_varuint(mut value: u32, bytes: &mut Bytes) -> Option<()> {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80).ok()?;
        value >>= 7;
    }
    bytes.push(value as u8).ok()
}

/// Begins the reply with so many registers; `None` where there is no room.
pub(crate) fn push_reply(format: Format, first: u32, count: u8, bytes: &mut Bytes) -> Option<()> {
    let kind = REPLY | format.bits();
    if count < 4 {
        bytes.push(kind | count).ok()?;
    } else {
        bytes.extend_from_slice(&[kind, count]).ok()?;
    }
    push_varuint(first, bytes)
}

/// Adds the number of a reply.
pub(crate) fn push_number(number: Number, bytes: &mut Bytes) -> Option<()> {
    match number {
        Number::Integer(value, format) => bytes.extend_from_slice(value.to_le_bytes().get(..format.size())?),
        Number::Float(value) => bytes.extend_from_slice(&value.to_le_bytes()),
    }
    .ok()
}

/// What is wrong with a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Fault {
    /// There is no such register here.
    Unknown = 1,
    /// It is not to be read or written, or not in this format.
    Access = 2,
    /// The value is refused, or the command as a whole, or not now.
    Refused = 3,
}

/// Adds an error that concerns a register.
pub(crate) fn push_error(writes: bool, register: u32, fault: Fault, bytes: &mut Bytes) -> Option<()> {
    bytes.push(if writes { WRITE_ERROR } else { READ_ERROR }).ok()?;
    push_varuint(register, bytes)?;
    bytes.push(fault as u8).ok()
}

/// Adds bytes of a channel, with the number of the packet where it has one. `fill` is handed the room that there is.
pub(crate) fn push_channel(
    channel: u32,
    packet: Option<u8>,
    most: usize,
    bytes: &mut Bytes,
    fill: impl FnOnce(&mut [u8]) -> usize,
) -> Option<()> {
    bytes.push(if packet.is_some() { NUMBERED_FROM_DRIVE } else { FROM_DRIVE }).ok()?;
    push_varuint(channel, bytes)?;
    if let Some(packet) = packet {
        bytes.push(packet).ok()?;
    }
    let length = bytes.len();
    // The length of what follows is one byte: a frame has 64.
    bytes.push(0).ok()?;
    let most = most.min(FRAME - bytes.len());
    bytes.resize(length + 1 + most, 0).ok()?;
    let filled = fill(bytes.get_mut(length + 1..)?).min(most);
    bytes.truncate(length + 1 + filled);
    *bytes.get_mut(length)? = filled as u8;
    Some(())
}
