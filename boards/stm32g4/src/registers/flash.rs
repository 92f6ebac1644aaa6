//! The embedded flash (RM0440, chapters "Embedded flash memory for category 2 devices" and "… category 3 devices").

/// Bytes of a page; of two banks, where there are two.
pub const PAGE: u32 = 2048;
/// Bytes that are programmed at once.
pub const DOUBLE_WORD: u32 = 8;

/// FLASH_KEYR: what unlocks FLASH_CR, in this order.
pub const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// FLASH_CR.PG: stores to the array program it.
pub const PROGRAM: u32 = 1;

/// FLASH_CR: starts to erase a page of 512 KiB, of which a bank has 128, or of less in one bank.
pub const fn erase(page: u32) -> u32 {
    let (per, start) = (1 << 1, 1 << 16);
    per | super::field(page % 128, 3, 7) | super::bit(page >= 128, 11) | start
}

/// FLASH_SR: everything that may have gone wrong. Cleared by writing it.
pub const ERRORS: u32 = 0xC3FA;

#[cfg(test)]
mod tests {
    use super::*;

    /// FLASH_CR: PER is bit 1, PNB bits 3 to 9, BKER bit 11, STRT bit 16.
    #[test]
    fn a_page_is_erased_in_its_bank() {
        assert_eq!(erase(0), 0x1_0002);
        assert_eq!(erase(62), 0x1_0002 | 62 << 3);
        assert_eq!(erase(127), 0x1_0002 | 127 << 3);
        assert_eq!(erase(128), 0x1_0002 | 1 << 11);
        assert_eq!(erase(250), 0x1_0002 | 122 << 3 | 1 << 11);
    }

    /// FLASH_SR: OPERR, PROGERR to FASTERR, RDERR and OPTVERR.
    #[test]
    fn every_error_is_looked_at() {
        assert_eq!(ERRORS, [1, 3, 4, 5, 6, 7, 8, 9, 14, 15].iter().map(|bit| 1 << bit).sum::<u32>());
    }
}
