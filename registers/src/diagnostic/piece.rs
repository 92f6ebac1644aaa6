//! A part of an answer, on its way out.

use core::fmt;

/// Most bytes of a part: the longest is `servo_stats` as text.
const ROOM: usize = 1024;
/// Most bytes of a name in a schema, one byte for its length.
const LONGEST_NAME: usize = 127;

/// What has been written, until it is taken: in any number of goes.
#[derive(Debug)]
pub(super) struct Stage {
    bytes: [u8; ROOM],
    length: usize,
    taken: usize,
}

impl Stage {
    pub const fn new() -> Self {
        Self { bytes: [0; ROOM], length: 0, taken: 0 }
    }

    /// Puts something else in the place of what has been taken, and returns how many bytes.
    pub fn fill(&mut self, write: impl FnOnce(&mut Piece<'_>)) -> usize {
        let mut piece = Piece::new(&mut self.bytes);
        write(&mut piece);
        self.length = piece.length;
        self.taken = 0;
        self.length
    }

    /// Makes it so many bytes long, by leaving out or adding zeros.
    pub fn resize(&mut self, length: usize) {
        let length = length.min(ROOM);
        for byte in self.bytes.iter_mut().take(length).skip(self.length) {
            *byte = 0;
        }
        self.length = length;
    }

    pub const fn is_empty(&self) -> bool {
        self.taken >= self.length
    }

    /// Moves bytes to `buffer`, and returns how many.
    pub fn take(&mut self, buffer: &mut [u8]) -> usize {
        let rest = self.bytes.get(self.taken..self.length).unwrap_or_default();
        let length = rest.len().min(buffer.len());
        for (to, from) in buffer.iter_mut().zip(rest) {
            *to = *from;
        }
        self.taken += length;
        length
    }
}

/// Writes into memory. What has no room is left out.
pub(super) struct Piece<'a> {
    bytes: &'a mut [u8],
    length: usize,
}

impl<'a> Piece<'a> {
    pub const fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, length: 0 }
    }

    /// What has been written.
    pub fn written(self) -> &'a [u8] {
        let Self { bytes, length } = self;
        bytes.get(..length).unwrap_or_default()
    }

    // One copy of it, for the sake of the flash.
    #[inline(never)]
    pub fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let Some(place) = self.bytes.get_mut(self.length) else { return };
            *place = *byte;
            self.length += 1;
        }
    }

    /// Text with its length before it.
    #[inline(never)]
    pub fn short_text(&mut self, text: &str) {
        let bytes = text.as_bytes();
        let bytes = bytes.get(..LONGEST_NAME).unwrap_or(bytes);
        self.bytes(&[bytes.len() as u8]);
        self.bytes(bytes);
    }

    #[inline(never)]
    pub fn text(&mut self, parts: &[&str]) {
        parts.iter().for_each(|part| self.bytes(part.as_bytes()));
    }
}

/// In one line of ASCII, whatever it says: clients take other bytes for binary data.
impl fmt::Write for Piece<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            self.bytes(&[if matches!(character, ' '..='~') { character as u8 } else { b'?' }]);
        }
        Ok(())
    }
}
