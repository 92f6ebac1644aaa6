//! Erases a page, programs a double word, and programs it once more without erasing, which is to be reported.
#![no_std]
#![no_main]

use chip_firmwares::{done, full_speed};
use core::ptr::{read_volatile, write_volatile};
use cortex_m_rt::entry;
use stm32_metapac::FLASH;
use stm32_metapac::flash::regs::{Cr, Sr};

/// Page 63 on both chips, the smaller one's last.
const PAGE: *mut u32 = 0x0801_f800 as *mut u32;
const BUSY: u32 = 1 << 16;
const PROGERR: u32 = 1 << 3;

/// Programs a double word and returns the error flags.
fn program(word: [u32; 2]) -> u32 {
    FLASH.cr().write_value(Cr(1));
    for (place, half) in word.into_iter().enumerate() {
        // SAFETY: nothing of the image is in this page.
        unsafe { write_volatile(PAGE.add(place), half) };
    }
    while FLASH.sr().read().0 & BUSY != 0 {}
    FLASH.cr().write_value(Cr(0));
    FLASH.sr().read().0
}

fn content() -> [u32; 2] {
    // SAFETY: flash can be read.
    unsafe { [read_volatile(PAGE), read_volatile(PAGE.add(1))] }
}

#[entry]
fn main() -> ! {
    full_speed();
    assert!(FLASH.cr().read().lock());
    for key in [0x4567_0123, 0xcdef_89ab] {
        FLASH.keyr().write_value(key);
    }
    assert!(!FLASH.cr().read().lock());
    assert_eq!(program([1, 2]), 0);
    assert_eq!(content(), [1, 2]);
    // PER, PNB, STRT.
    FLASH.cr().write_value(Cr(1 << 1 | 63 << 3));
    FLASH.cr().write_value(Cr(1 << 1 | 63 << 3 | 1 << 16));
    while FLASH.sr().read().0 & BUSY != 0 {}
    assert_eq!(content(), [u32::MAX; 2]);
    assert_eq!(program([0x1234_5678, 0x9abc_def0]), 0);
    assert_eq!(program([3, 4]), PROGERR);
    FLASH.sr().write_value(Sr(PROGERR));
    assert_eq!(content(), [0x1234_5678, 0x9abc_def0]);
    FLASH.cr().write_value(Cr(1 << 31));
    assert!(FLASH.cr().read().lock());
    done()
}
