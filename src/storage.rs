//! Records in flash that survive a power cut at any moment: each in two copies, with version, number and CRC.
//!
//! Two erasable blocks of a NOR flash hold all kinds of records, each in a slot of its own: the sensors' [calibration],
//! the [cogging] table, the [settings]. Saving one erases the block that does not hold the newest record, copies the
//! other kinds' there, writes the new one last, of that its first word last, and reads it back; until that word is
//! complete the other block counts. So a cut leaves the record before or the new one, and all others. Loading takes the
//! newest record of its slot whose CRC is right. If there is none, it says whether nothing was ever completely saved, or
//! what the flash holds is corrupt or of another version, and whoever asks has to calibrate: nothing is made up.
//!
//! A store is cheap to make when it is needed, so the kinds can share a flash that is lent to each in turn:
//!
//! ```
//! # use embedded_storage::nor_flash::NorFlash;
//! use hallservo::control::cogging::Table;
//! use hallservo::storage::{self, Error, Store, calibration, cogging, settings};
//!
//! /// A slot has room for the longest.
//! type Records<F> = Store<F, { storage::size(cogging::LENGTH) }>;
//!
//! # fn save<F: NorFlash>(flash: &mut F, table: &Table) -> Result<(), Error<F::Error>> {
//! let mut calibrations = Records::new(&mut *flash, 0, 0, calibration::VERSION)?;
//! calibrations.load(&mut [0; calibration::LENGTH])?;
//! let mut tables = Records::new(&mut *flash, 0, 1, cogging::VERSION)?;
//! tables.save(&cogging::encode(table, 8.25))?;
//! let mut saved = Records::new(&mut *flash, 0, 2, settings::VERSION)?;
//! # saved.load(&mut [0; settings::LONGEST])?; Ok(()) }
//! ```

pub mod calibration;
pub mod cogging;
pub mod map;
pub mod settings;
pub mod vernier;

use crate::crc::crc32_of;
use core::fmt;
use embedded_storage::nor_flash::NorFlash;

/// "HSRV".
const MAGIC: u32 = 0x5652_5348;
const HEADER: usize = 16;
/// Bytes of the header that are written last: magic number, version and length.
const MARK: usize = 8;

/// Bytes of flash, and of stack, for records of up to `longest` bytes, header included: the `SIZE` of a [`Store`].
pub const fn size(longest: usize) -> usize {
    (HEADER + longest).next_multiple_of(32)
}

/// Why a record cannot be loaded or saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// Nothing was ever saved, or the power went during the very first time: nothing is lost.
    Blank,
    /// There is something, but in no block a whole record: a worn flash, or another program's data.
    Corrupt,
    /// There is a whole record, of another version of the firmware.
    Version {
        /// The version found.
        found: u16,
    },
    /// Longer than [`Store::LONGEST`] or than what the caller has room for.
    TooLong,
    /// The place is no two blocks of this flash, or its words are larger than 32 bytes.
    Place,
    /// The flash did not keep what was written.
    NotKept,
    /// The flash failed.
    Flash(E),
}

impl<E: fmt::Debug> fmt::Display for Error<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Blank => write!(f, "nothing is stored: calibrate"),
            Self::Corrupt => write!(f, "the stored record is corrupt: calibrate"),
            Self::Version { found } => write!(f, "the stored record is of version {found}: calibrate"),
            Self::TooLong => write!(f, "the record is too long"),
            Self::Place => write!(f, "there are no two blocks at this place of the flash"),
            Self::NotKept => write!(f, "the flash did not keep what was written"),
            Self::Flash(error) => write!(f, "the flash failed: {error:?}"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for Error<E> {}

/// What a slot of a block holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    /// Erased, or begun to be written.
    Blank,
    Corrupt,
    Whole {
        version: u16,
        number: u32,
        length: usize,
    },
}

/// A slot in two blocks of a flash, for records that take up to `SIZE` bytes, as [`size`] tells.
#[derive(Debug)]
pub struct Store<F, const SIZE: usize> {
    flash: F,
    start: u32,
    slot: usize,
    version: u16,
}

impl<F: NorFlash, const SIZE: usize> Store<F, SIZE> {
    /// Most bytes that a record may have.
    pub const LONGEST: usize = {
        assert!(SIZE > HEADER && SIZE - HEADER <= u16::MAX as usize, "SIZE is not one of `size`");
        SIZE - HEADER
    };
    const SLOTS: usize = F::ERASE_SIZE / SIZE;

    /// A slot, from 0 on, in two successive erasable blocks from `start` on, for records of a version. All slots of
    /// these blocks have one `SIZE`. Let no two kinds have the same version, and a record at the wrong place is told
    /// from the right one.
    ///
    /// # Errors
    /// [`Error::Place`].
    pub fn new(flash: F, start: u32, slot: usize, version: u16) -> Result<Self, Error<F::Error>> {
        let block = F::ERASE_SIZE as u64;
        let fits = u64::from(start) + 2 * block <= flash.capacity() as u64 && slot < F::ERASE_SIZE / SIZE;
        let sizes = SIZE.is_multiple_of(F::WRITE_SIZE) && SIZE.is_multiple_of(F::READ_SIZE);
        if fits && sizes && u64::from(start).is_multiple_of(block) {
            Ok(Self { flash, start, slot, version })
        } else {
            Err(Error::Place)
        }
    }

    /// Copies the newest record to `record` and tells its length.
    ///
    /// # Errors
    /// [`Error::Blank`], [`Error::Corrupt`] or [`Error::Version`] ask for a calibration.
    pub fn load(&mut self, record: &mut [u8]) -> Result<usize, Error<F::Error>> {
        let mut buffer = [0; SIZE];
        let stored = self.load_into(&mut buffer)?;
        record.get_mut(..stored.len()).ok_or(Error::TooLong)?.copy_from_slice(stored);
        Ok(stored.len())
    }

    /// The newest record, in the only memory that this takes.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn load_into<'a>(&mut self, buffer: &'a mut [u8; SIZE]) -> Result<&'a [u8], Error<F::Error>> {
        let blocks = [self.read(0, self.slot, buffer), self.read(1, self.slot, buffer)];
        let Some((newest, Block::Whole { version, length, .. })) = newest(&blocks) else {
            let blank = blocks == [Block::Blank; 2];
            return Err(if blank { Error::Blank } else { Error::Corrupt });
        };
        if version != self.version {
            return Err(Error::Version { found: version });
        }
        // Once more, for the buffer holds the second; it may fail only now.
        if self.read(newest, self.slot, buffer) != blocks[newest] {
            return Err(Error::Corrupt);
        }
        buffer.get(HEADER..HEADER + length).ok_or(Error::TooLong)
    }

    /// Saves a record. When it returns, the record is in the flash; when the power goes before, that or the last one
    /// is.
    ///
    /// # Errors
    /// [`Error::TooLong`], [`Error::NotKept`] and [`Error::Flash`]; the last record is still there.
    pub fn save(&mut self, record: &[u8]) -> Result<(), Error<F::Error>> {
        if record.len() > Self::LONGEST {
            return Err(Error::TooLong);
        }
        let mut buffer = [0; SIZE];
        let (last, number) = self.last(&mut buffer);
        let number = number.wrapping_add(1);
        let block = 1 - last;
        let start = self.start + (block * F::ERASE_SIZE) as u32;
        self.flash.erase(start, start + F::ERASE_SIZE as u32).map_err(Error::Flash)?;
        let own = self.slot;
        for slot in (0..Self::SLOTS).filter(|slot| *slot != own) {
            if let whole @ Block::Whole { length, .. } = self.read(last, slot, &mut buffer) {
                self.write(block, slot, &mut buffer, length, whole)?;
            }
        }
        buffer.fill(0xff);
        buffer[0..4].copy_from_slice(&MAGIC.to_le_bytes());
        buffer[4..6].copy_from_slice(&self.version.to_le_bytes());
        buffer[6..8].copy_from_slice(&(record.len() as u16).to_le_bytes());
        buffer[8..12].copy_from_slice(&number.to_le_bytes());
        buffer[HEADER..HEADER + record.len()].copy_from_slice(record);
        let crc = checksum(&buffer, record.len());
        buffer[12..16].copy_from_slice(&crc.to_le_bytes());
        let written = Block::Whole { version: self.version, number, length: record.len() };
        self.write(block, self.slot, &mut buffer, record.len(), written)
    }

    /// Gives the flash back.
    pub fn free(self) -> F {
        self.flash
    }

    /// The block with the newest record of all, and that one's number. Only a block that has been written to its end
    /// has a number of its own: a cut one has copies, fewer than are whole in the other.
    fn last(&mut self, buffer: &mut [u8; SIZE]) -> (usize, u32) {
        let [first, second] = [0, 1].map(|block| {
            let mut latest: Option<(u32, usize)> = None;
            for slot in 0..Self::SLOTS {
                if let Block::Whole { number, .. } = self.read(block, slot, buffer) {
                    let (last, count) = latest.unwrap_or((number, 0));
                    latest = Some((if is_later(number, last) { number } else { last }, count + 1));
                }
            }
            latest
        });
        match (first, second) {
            (Some((a, some)), Some((b, others))) if is_later(b, a) || (a == b && others > some) => (1, b),
            (Some((number, _)), _) => (0, number),
            (None, Some((number, _))) => (1, number),
            (None, None) => (1, 0),
        }
    }

    fn place(&self, block: usize, slot: usize) -> u32 {
        self.start + (block * F::ERASE_SIZE + slot * SIZE) as u32
    }

    /// A record with its header, its mark last, and reads it back.
    fn write(
        &mut self,
        block: usize,
        slot: usize,
        buffer: &mut [u8; SIZE],
        length: usize,
        written: Block,
    ) -> Result<(), Error<F::Error>> {
        let place = self.place(block, slot);
        let end = (HEADER + length).next_multiple_of(F::WRITE_SIZE);
        let first = MARK.next_multiple_of(F::WRITE_SIZE);
        self.flash.write(place + first as u32, &buffer[first..end]).map_err(Error::Flash)?;
        self.flash.write(place, &buffer[..first]).map_err(Error::Flash)?;
        if self.read(block, slot, buffer) == written { Ok(()) } else { Err(Error::NotKept) }
    }

    /// What a slot holds. One that cannot be read, as after a cut in the middle of a word, is corrupt.
    fn read(&mut self, block: usize, slot: usize, buffer: &mut [u8; SIZE]) -> Block {
        if self.flash.read(self.place(block, slot), buffer).is_err() {
            return Block::Corrupt;
        }
        let word = |at: usize| u32::from_le_bytes([buffer[at], buffer[at + 1], buffer[at + 2], buffer[at + 3]]);
        let length = (word(4) >> 16) as usize;
        if word(0) == MAGIC && length <= Self::LONGEST && word(12) == checksum(buffer, length) {
            Block::Whole { version: word(4) as u16, number: word(8), length }
        } else if word(0) & MAGIC == MAGIC && (word(0) & !MAGIC).count_ones() > 1 {
            // The first word comes last, and writing clears bits: here, some are not yet clear. A single one may have
            // flipped.
            Block::Blank
        } else {
            Block::Corrupt
        }
    }
}

/// Over all but the CRC itself.
fn checksum(buffer: &[u8], length: usize) -> u32 {
    crc32_of([&buffer[..12], &buffer[HEADER..HEADER + length]])
}

/// Numbers wrap.
fn is_later(number: u32, than: u32) -> bool {
    number.wrapping_sub(than) as i32 > 0
}

/// The newest whole block.
fn newest(blocks: &[Block; 2]) -> Option<(usize, Block)> {
    let choice = match *blocks {
        [Block::Whole { number: first, .. }, Block::Whole { number: second, .. }] => {
            usize::from(is_later(second, first))
        }
        [Block::Whole { .. }, _] => 0,
        [_, Block::Whole { .. }] => 1,
        _ => return None,
    };
    Some((choice, blocks[choice]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_is_the_one_after_the_other_even_where_the_number_wraps() {
        let whole = |number| Block::Whole { version: 1, number, length: 4 };
        for (older, newer) in [(1, 2), (u32::MAX - 1, u32::MAX), (u32::MAX, 0), (u32::MAX, 1)] {
            assert_eq!(newest(&[whole(older), whole(newer)]), Some((1, whole(newer))));
            assert_eq!(newest(&[whole(newer), whole(older)]), Some((0, whole(newer))));
        }
        assert_eq!(newest(&[Block::Corrupt, whole(7)]), Some((1, whole(7))));
        assert_eq!(newest(&[Block::Corrupt, Block::Blank]), None);
    }
}
