//! Clocks and the core's voltage: 170 MHz from the internal oscillator (RM0440, chapters 3, 6 and 7).
//!
//! The internal 16 MHz oscillator, because nothing here needs better than its 1 %: the serial link tolerates 2 %,
//! speeds are as wrong as the clock. Crystals differ from one version of a board to the next, and a drive should not
//! stop because one did not start.

use super::{bit, field};

/// HCLK, and the clock of TIM1, in hertz.
pub const HCLK_HZ: u32 = 170_000_000;
/// PCLK1, the clock of the serial ports. Timers of that bus run at twice that.
pub const PCLK1_HZ: u32 = HCLK_HZ / 2;

/// HSI16 in hertz.
pub const HSI_HZ: u32 = 16_000_000;
/// Division of HSI16 before the PLL: 4 MHz, within 2.66 to 16.
pub const PLL_M: u32 = 4;
/// Multiplication: 340 MHz, within 96 to 344.
pub const PLL_N: u32 = 85;
/// Division after it, to the system clock.
pub const PLL_R: u32 = 2;

/// RCC_PLLCFGR: source HSI16, output R enabled.
pub const PLLCFGR: u32 =
    field(0b10, 0, 2) | field(PLL_M - 1, 4, 4) | field(PLL_N, 8, 7) | bit(true, 24) | field(PLL_R / 2 - 1, 25, 2);

/// RCC_CFGR, its dividers: AHB by 1 (HPRE = 0), APB1 by 2 (PPRE1 = 100), APB2 by 1.
pub const DIVIDERS: u32 = field(0b100, 8, 3);
/// RCC_CFGR, the fields of the above.
pub const DIVIDERS_MASK: u32 = field(0xF, 4, 4) | field(0b111, 8, 3) | field(0b111, 11, 3);

/// PWR_CR5, R1MODE: cleared, range 1 is boosted, without which more than 150 MHz are out of specification. Bit 8; reset
/// value 1. The field of that name in stm32-metapac 21.0.0 is bit 0.
pub const R1MODE: u32 = 1 << 8;

/// Wait states of the flash in range 1, boosted or not (RM0440, table "Number of wait states according to CPU clock
/// (HCLK) frequency"). `None` above 170 and 150 MHz.
pub const fn wait_states(hclk_hz: u32, boosted: bool) -> Option<u32> {
    const BOOSTED: [u32; 5] = [34, 68, 102, 136, 170];
    const NORMAL: [u32; 5] = [30, 60, 90, 120, 150];
    let limits = if boosted { BOOSTED } else { NORMAL };
    let mut states = 0;
    while states < 5 {
        if hclk_hz <= limits[states] * 1_000_000 {
            return Some(states as u32);
        }
        states += 1;
    }
    None
}

/// Prescaler register of a timer for its counts a second, which must divide its clock.
pub const fn prescaler(timer_hz: u32, counts_hz: u32) -> u16 {
    assert!(timer_hz.is_multiple_of(counts_hz), "the clock is no multiple");
    (timer_hz / counts_hz - 1) as u16
}

/// BRR of a serial port that oversamples sixteen times, rounded, and how far off its rate is, in parts per 10 000.
pub const fn baud(clock_hz: u32, rate: u32) -> (u16, i32) {
    let divider = (clock_hz + rate / 2) / rate;
    (divider as u16, (clock_hz as i64 * 10_000 / (divider as i64 * rate as i64)) as i32 - 10_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pll_makes_170_mhz() {
        assert_eq!(HSI_HZ / PLL_M * PLL_N / PLL_R, HCLK_HZ);
        // PLLSRC = 10 (HSI16), PLLM = 0011 (4), PLLN = 85, PLLREN bit 24, PLLR = 00 (2).
        assert_eq!(PLLCFGR, 0x0100_5532);
    }

    #[test]
    fn boost_is_bit_8() {
        // PWR_CR5: reset value 0x0000 0100, R1MODE the only bit.
        assert_eq!(R1MODE, 0x100);
    }

    #[test]
    fn dividers() {
        assert_eq!((DIVIDERS, DIVIDERS_MASK), (0x400, 0x3FF0));
    }

    #[test]
    fn flash_waits_as_the_table_says() {
        let cases = [
            (170, true, Some(4)),
            (136, true, Some(3)),
            (85, true, Some(2)),
            (85, false, Some(2)),
            (16, false, Some(0)),
            (150, false, Some(4)),
            (170, false, None),
            (171, true, None),
        ];
        for (mhz, boosted, states) in cases {
            assert_eq!(wait_states(mhz * 1_000_000, boosted), states, "{mhz} {boosted}");
        }
    }

    #[test]
    fn serial_rate() {
        // 85 MHz / 460800 = 184.46.
        assert_eq!(baud(PCLK1_HZ, 460_800), (184, 25));
        assert_eq!(baud(HCLK_HZ, 460_800), (369, -3));
    }

    #[test]
    fn a_microsecond_a_tick() {
        assert_eq!(prescaler(HCLK_HZ, 1_000_000), 169);
    }
}
