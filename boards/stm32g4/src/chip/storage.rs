//! The flash as the place for records.
//!
//! A power cut amid a write or an erase leaves double words that the flash's error correction cannot make good. Reading
//! one gives anything, and a non-maskable interrupt (RM0440, "Error code correction (ECC)"). Of a record the CRC tells,
//! so while one is read that interrupt is none: otherwise a board would never start again after such a cut.

use crate::chip::watchdog;
use core::sync::atomic::{AtomicBool, Ordering};
use embassy_stm32::flash::{Blocking, Error, Flash};
use embassy_stm32::pac::FLASH;
use embassy_stm32::peripherals;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

static READING: AtomicBool = AtomicBool::new(false);

/// FLASH_ECCR, ECCD and ECCD2: two errors in a double word, in one half or the other of the bus.
const DETECTED: u32 = 1 << 31 | 1 << 29;

/// Whether a non-maskable interrupt comes from a record that is read. Takes it back then.
pub(crate) fn is_torn_record() -> bool {
    let errors = FLASH.eccr().read();
    let torn = READING.load(Ordering::Relaxed) && errors.0 & DETECTED != 0;
    if torn {
        // Flags are cleared by writing them.
        FLASH.eccr().write_value(errors);
    }
    torn
}

/// The flash.
pub(crate) struct Storage(Flash<'static, Blocking>);

impl Storage {
    /// To be called once.
    pub fn new() -> Self {
        // SAFETY: nothing else writes to the flash.
        Self(Flash::new_blocking(unsafe { peripherals::FLASH::steal() }))
    }
}

impl ErrorType for Storage {
    type Error = Error;
}

impl ReadNorFlash for Storage {
    const READ_SIZE: usize = <Flash<'static, Blocking> as ReadNorFlash>::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        // The barriers of this order keep the reads between the stores, for compiler and core.
        READING.store(true, Ordering::SeqCst);
        let done = self.0.blocking_read(offset, bytes);
        READING.store(false, Ordering::SeqCst);
        done
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Storage {
    const WRITE_SIZE: usize = <Flash<'static, Blocking> as NorFlash>::WRITE_SIZE;
    const ERASE_SIZE: usize = <Flash<'static, Blocking> as NorFlash>::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        watchdog::stalled(|| self.0.blocking_erase(from, to)).unwrap_or(Err(Error::Protected))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        watchdog::stalled(|| self.0.blocking_write(offset, bytes)).unwrap_or(Err(Error::Protected))
    }
}
