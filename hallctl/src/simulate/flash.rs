//! A flash with double words and blocks of 2 KiB, as in an STM32G4; kept in a file, if there is one, through any power
//! cut.

use anyhow::{Context, Result, ensure};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use hallservo_app::storage::BLOCKS;
use std::cell::RefCell;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::rc::Rc;

const BLOCK: usize = 2048;
const SIZE: usize = BLOCK * BLOCKS as usize;

/// The flash. A clone is the same flash.
#[derive(Clone, Debug)]
pub struct Flash(Rc<RefCell<Cells>>);

#[derive(Debug)]
struct Cells {
    bytes: Vec<u8>,
    file: Option<File>,
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
    pub fn of(bytes: Vec<u8>) -> Self {
        Self(Rc::new(RefCell::new(Cells { bytes, file: None })))
    }

    /// What it holds.
    pub fn bytes(&self) -> Vec<u8> {
        self.0.borrow().bytes.clone()
    }

    /// In a file; a new one is blank.
    ///
    /// # Errors
    /// The file cannot be opened, or has another size.
    pub fn in_file(path: &Path) -> Result<Self> {
        let name = || format!("the flash in {}", path.display());
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).with_context(name)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).with_context(name)?;
        if bytes.is_empty() {
            bytes.resize(SIZE, 0xff);
            file.write_all(&bytes).with_context(name)?;
        }
        ensure!(bytes.len() == SIZE, "{} has {} bytes, not {SIZE}", name(), bytes.len());
        Ok(Self(Rc::new(RefCell::new(Cells { bytes, file: Some(file) }))))
    }
}

impl Cells {
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
        cells.bytes.get_mut(from..to).ok_or(Broken)?.fill(0xff);
        cells.keep(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Broken> {
        let (from, to) = (offset as usize, offset as usize + bytes.len());
        let mut cells = self.0.borrow_mut();
        for (cell, byte) in cells.bytes.get_mut(from..to).ok_or(Broken)?.iter_mut().zip(bytes) {
            // A bit is cleared by writing, and set by erasing only.
            *cell &= byte;
        }
        cells.keep(from, to)
    }
}
