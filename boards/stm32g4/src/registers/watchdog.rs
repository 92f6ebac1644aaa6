//! The watchdogs (RM0440, chapters "Independent watchdog" and "System window watchdog").

/// Clock of the independent watchdog, LSI, in hertz: 31.04 to 32.96 kHz by the data sheets.
pub const LSI_HZ: u32 = 32_000;

/// IWDG_KR: starts it, for good.
pub const START: u32 = 0xCCCC;
/// IWDG_KR: gives access to PR and RLR.
pub const UNLOCK: u32 = 0x5555;
/// IWDG_KR: it starts over.
pub const FEED: u32 = 0xAAAA;

/// IWDG_PR and IWDG_RLR for a time of at least `milliseconds`, 1 to 32 768: the smallest prescaler that does.
pub const fn reload(milliseconds: u32) -> Option<(u32, u32)> {
    let mut prescaler = 0;
    while prescaler <= 6 {
        let counts = (milliseconds as u64 * LSI_HZ as u64).div_ceil(1000 * (4 << prescaler));
        if counts >= 1 && counts <= 4096 {
            return Some((prescaler, counts as u32 - 1));
        }
        prescaler += 1;
    }
    None
}

/// WWDG_CFR: the window is fully open, and a count is 4096 cycles of PCLK1.
pub const WINDOW_SHORT: u32 = 0x7F;
/// WWDG_CFR: a count is 128 times as long.
pub const WINDOW_LONG: u32 = 0x7F | 7 << 11;

/// WWDG_CR that starts or refreshes the window watchdog, which cannot be stopped: it resets the chip within so many
/// microseconds, and up to one count earlier, for its prescaler is not refreshed. `None` where that is not 2 to 64
/// counts.
pub const fn window(pclk_hz: u32, microseconds: u32) -> Option<u32> {
    let counts = (microseconds as u64 * pclk_hz as u64 / 4_096_000_000) as u32;
    // The count that is over is 0x3F.
    if counts >= 2 && counts <= 64 { Some(0x80 | (0x3F + counts)) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times() {
        // 32 kHz / 4: 512 ms are 4096 counts, the largest time of that prescaler.
        assert_eq!(reload(512), Some((0, 4095)));
        assert_eq!(reload(513), Some((1, 2051)));
        assert_eq!(reload(250), Some((0, 1999)));
        assert_eq!(reload(32_768), Some((6, 4095)));
        assert_eq!((reload(0), reload(32_769)), (None, None));
    }

    #[test]
    fn window_times() {
        // 85 MHz / 4096: 48.19 µs a count. 10 of them are 481.9 µs.
        assert_eq!(window(85_000_000, 500), Some(0x80 | 0x40 | 9));
        assert_eq!(window(85_000_000, 482), Some(0x80 | 0x40 | 9));
        assert_eq!(window(85_000_000, 481), Some(0x80 | 0x40 | 8));
        assert_eq!(window(85_000_000, 3090), Some(0xFF));
        assert_eq!((window(85_000_000, 96), window(85_000_000, 3140)), (None, None));
    }
}
