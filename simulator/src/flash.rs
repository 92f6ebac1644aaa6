//! A flash with double words and blocks of 2 KiB, as in an STM32G4; kept in a file, if there is one, through any power
//! cut.

use anyhow::{Context, Result, ensure};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use hallservo::crc::crc32;
use hallservo_app::storage::{BLOCKS, ENCODER_BLOCKS, MAP_BLOCKS};
use std::cell::RefCell;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::rc::Rc;

const BLOCK: usize = 2048;
const SIZE: usize = BLOCK * (BLOCKS + ENCODER_BLOCKS + MAP_BLOCKS) as usize;
/// Those of files from before there were encoders, and maps of the magnets.
const SMALLER: [usize; 2] = [BLOCK * BLOCKS as usize, BLOCK * (BLOCKS + ENCODER_BLOCKS) as usize];

/// The highest word of the serial number: no chip of ST's has it.
const SIMULATED: u32 = u32::from_be_bytes(*b"SIM\0");

/// The flash. A clone is the same flash.
#[derive(Clone, Debug)]
pub struct Flash(Rc<RefCell<Cells>>);

#[derive(Debug)]
struct Cells {
    bytes: Vec<u8>,
    file: Option<File>,
    /// Of the chip that it belongs to.
    serial: [u32; 3],
    /// Words and erases until the power goes.
    left: Option<u32>,
    /// What it held before each word and each erase, where somebody asks.
    states: Option<Vec<Vec<u8>>>,
}

/// The file cannot be written.
#[derive(Clone, Copy, Debug)]
pub struct Broken;

impl NorFlashError for Broken {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Flash {
    /// A blank one, forgotten with the process.
    pub fn blank() -> Self {
        Self::of(vec![0xff; SIZE])
    }

    /// With these contents.
    pub fn of(mut bytes: Vec<u8>) -> Self {
        if SMALLER.contains(&bytes.len()) {
            bytes.resize(SIZE, 0xff);
        }
        Self::new(bytes, None, 0)
    }

    fn new(bytes: Vec<u8>, file: Option<File>, number: u32) -> Self {
        let serial = [number, file.is_some().into(), SIMULATED];
        Self(Rc::new(RefCell::new(Cells { bytes, file, serial, left: None, states: None })))
    }

    /// Serial number of the chip that it belongs to: another one for each file.
    pub fn serial(&self) -> [u32; 3] {
        self.0.borrow().serial
    }

    /// The power goes after so many more words written or blocks erased: what is written later does not reach it.
    pub fn cut_after(&self, operations: u32) {
        self.0.borrow_mut().left = Some(operations);
    }

    /// From now on, what it holds before each word and each erase is noted: what a power cut at that moment would leave.
    pub fn note_states(&self) {
        self.0.borrow_mut().states = Some(Vec::new());
    }

    /// What was noted, the oldest first.
    pub fn states(&self) -> Vec<Vec<u8>> {
        self.0.borrow().states.clone().unwrap_or_default()
    }

    /// What it holds.
    pub fn bytes(&self) -> Vec<u8> {
        self.0.borrow().bytes.clone()
    }

    /// In a file; a new one is blank.
    ///
    /// # Errors
    /// The file cannot be opened, has another size, or is that of a simulated drive that still runs: each would write
    /// over what the other has saved.
    pub fn in_file(path: &Path) -> Result<Self> {
        let name = || format!("the flash in {}", path.display());
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).with_context(name)?;
        // A device may have no end.
        ensure!(file.metadata().with_context(name)?.is_file(), "{} is not a file", path.display());
        ensure!(
            !matches!(file.try_lock(), Err(TryLockError::WouldBlock)),
            "{} is in use by a simulated drive that still runs",
            name()
        );
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).with_context(name)?;
        if bytes.is_empty() || SMALLER.contains(&bytes.len()) {
            bytes.resize(SIZE, 0xff);
            file.rewind().with_context(name)?;
            file.write_all(&bytes).with_context(name)?;
        }
        ensure!(bytes.len() == SIZE, "{} has {} bytes, not {SIZE}", name(), bytes.len());
        let place = path.canonicalize().with_context(name)?;
        Ok(Self::new(bytes, Some(file), crc32(place.as_os_str().as_encoded_bytes())))
    }
}

impl Cells {
    /// Whether there is power for another operation.
    fn is_powered(&mut self) -> bool {
        if let Some(states) = &mut self.states {
            states.push(self.bytes.clone());
        }
        match &mut self.left {
            None => true,
            Some(0) => false,
            Some(left) => {
                *left -= 1;
                true
            }
        }
    }

    /// Writes through.
    fn keep(&mut self, from: usize, to: usize) -> Result<(), Broken> {
        let Some(file) = &mut self.file else { return Ok(()) };
        file.seek(SeekFrom::Start(from as u64)).and_then(|_| file.write_all(&self.bytes[from..to])).map_err(|_| Broken)
    }
}

impl ErrorType for Flash {
    type Error = Broken;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Broken> {
        let from = offset as usize;
        bytes.copy_from_slice(self.0.borrow().bytes.get(from..from + bytes.len()).ok_or(Broken)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = BLOCK;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Broken> {
        let (from, to) = (from as usize, to as usize);
        let mut cells = self.0.borrow_mut();
        let powered = cells.is_powered();
        let block = cells.bytes.get_mut(from..to).ok_or(Broken)?;
        if powered {
            block.fill(0xff);
        }
        cells.keep(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Broken> {
        let (from, to) = (offset as usize, offset as usize + bytes.len());
        let mut cells = self.0.borrow_mut();
        for (word, bytes) in (from..to).step_by(Self::WRITE_SIZE).zip(bytes.chunks(Self::WRITE_SIZE)) {
            let powered = cells.is_powered();
            let place = cells.bytes.get_mut(word..word + bytes.len()).ok_or(Broken)?;
            // A bit is cleared by writing, and set by erasing only.
            place.iter_mut().zip(bytes).filter(|_| powered).for_each(|(cell, byte)| *cell &= byte);
        }
        cells.keep(from, to)
    }
}
