//! The flash as the place for records.
//!
//! A power cut amid a write or an erase leaves double words that the flash's error correction cannot make good. Reading
//! one gives anything, and a non-maskable interrupt (RM0440, "Error code correction (ECC)"). Of a record the CRC tells,
//! so while one is read that interrupt is none: otherwise a board would never start again after such a cut.

use crate::chip::watchdog;
use crate::registers::flash::{DOUBLE_WORD, ERRORS, KEYS, PAGE, PROGRAM, erase};
use core::ptr;
use core::sync::atomic::{AtomicBool, Ordering, fence};
use embassy_stm32::flash::{FLASH_BASE, FLASH_SIZE};
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::regs::{Cr, Sr};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

/// One bank, or two of 128 pages.
const _: () = assert!(FLASH_SIZE == 128 << 10 || FLASH_SIZE == 512 << 10);
/// FLASH_OPTR.DBANK, where there may be two.
const DBANK: u32 = 1 << 22;

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

/// The flash. Who asks, a store of records, keeps to whole pages and double words of its place; of others FLASH_SR tells.
pub(crate) struct Storage(());

impl Storage {
    /// To be called once.
    pub fn new() -> Self {
        let is_split = FLASH_SIZE <= 128 << 10 || FLASH.optr().read().0 & DBANK != 0;
        assert!(is_split, "the option bytes make one bank of the flash's two");
        Self(())
    }
}

impl ErrorType for Storage {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Storage {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        // The barriers of this order keep the reads between the stores, for compiler and core.
        READING.store(true, Ordering::SeqCst);
        // SAFETY: a place in the flash, of which nothing has a reference.
        unsafe { ptr::copy_nonoverlapping(address(offset), bytes.as_mut_ptr(), bytes.len()) };
        READING.store(false, Ordering::SeqCst);
        Ok(())
    }

    fn capacity(&self) -> usize {
        FLASH_SIZE
    }
}

impl NorFlash for Storage {
    const WRITE_SIZE: usize = DOUBLE_WORD as usize;
    const ERASE_SIZE: usize = PAGE as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        (from / PAGE..to / PAGE).try_for_each(|page| change(erase(page), 0, &[]))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        change(PROGRAM, offset, bytes)
    }
}

fn address(offset: u32) -> *mut u8 {
    ptr::with_exposed_provenance_mut(FLASH_BASE + offset as usize)
}

/// Erases or programs, as FLASH_CR says.
#[inline(never)]
fn change(control: u32, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
    let done = watchdog::stalled(|| {
        // What the data cache has is of before; and while the array changes it may take up what is wrong.
        FLASH.acr().modify(|acr| acr.set_dcen(false));
        let done = carry_out(control, offset, bytes);
        FLASH.acr().modify(|acr| acr.set_dcrst(true));
        FLASH.acr().modify(|acr| acr.set_dcrst(false));
        FLASH.acr().modify(|acr| acr.set_dcen(true));
        done
    });
    if done == Some(true) { Ok(()) } else { Err(NorFlashErrorKind::Other) }
}

/// In the order of RM0440, "Main memory erase sequences" and "Main memory programming sequences". Whether it went well.
fn carry_out(control: u32, offset: u32, bytes: &[u8]) -> bool {
    while FLASH.sr().read().bsy() {}
    FLASH.sr().write_value(Sr(ERRORS));
    if FLASH.cr().read().lock() {
        KEYS.iter().for_each(|key| FLASH.keyr().write_value(*key));
    }
    FLASH.cr().write_value(Cr(control));
    for (place, word) in (offset..).step_by(4).zip(bytes.as_chunks().0) {
        // SAFETY: a word of the flash, of which nothing has a reference.
        unsafe { ptr::write_volatile(address(place).cast(), u32::from_le_bytes(*word)) };
        // The halves of a double word one after the other.
        fence(Ordering::SeqCst);
        while FLASH.sr().read().bsy() {}
    }
    while FLASH.sr().read().bsy() {}
    FLASH.cr().write_value(Cr(0));
    FLASH.cr().modify(|cr| cr.set_lock(true));
    FLASH.sr().read().0 & ERRORS == 0
}
