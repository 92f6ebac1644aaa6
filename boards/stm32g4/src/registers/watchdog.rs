//! The independent watchdog (RM0440, chapter "Independent watchdog").

/// Clock of the watchdog, LSI, in hertz: 31.04 to 32.96 kHz by the data sheets.
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
}
