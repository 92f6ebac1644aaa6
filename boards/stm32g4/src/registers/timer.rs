//! TIM1: centre-aligned PWM with complementary outputs, dead time and break (RM0440, chapter 28; register descriptions
//! in section 28.6).
//!
//! PWM mode 2: a leg's upper transistor conducts while the counter is at or above its compare register. In the valley,
//! counter zero, all lower transistors conduct and their shunts carry the phase currents.

use super::{bit, field};
use core::num::NonZeroU32;

/// The level at which an input of a gate driver switches its transistor on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Active {
    /// High.
    High,
    /// Low: the input is inverted.
    Low,
}

/// Inputs of the gate drivers, all three legs alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gates {
    /// Of the upper transistors, on CH1 to CH3.
    pub upper: Active,
    /// Of the lower ones, on CH1N to CH3N.
    pub lower: Active,
}

/// What switches the bridge off without code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// The pin TIM1_BKIN, when low.
    PinLow,
    /// Comparators, when high: bit n−1 is COMPn, 1 to 7.
    Comparators(u8),
}

/// Auto-reload value for a centre-aligned frequency, rounded: the counter takes 2·ARR ticks a period (RM0440,
/// center-aligned mode).
///
/// # Panics
/// At compile time, when it does not fit 16 bits.
pub const fn auto_reload(timer_hz: u32, pwm_hz: u32) -> u16 {
    let ticks = (timer_hz + pwm_hz) / (2 * pwm_hz);
    assert!(ticks > 0 && ticks < 65_536, "no such PWM frequency");
    ticks as u16
}

/// Ticks of a time, rounded up.
pub const fn ticks(timer_hz: u32, nanoseconds: u32) -> u32 {
    (timer_hz as u64 * nanoseconds as u64).div_ceil(1_000_000_000) as u32
}

/// Field DTG of TIM1_BDTR for a dead time of at least `ticks`, 1 to 1008, of t_DTS (RM0440, 28.6.20). Longer by less
/// than one of its steps: by 0 up to 127 ticks, at most 1 up to 254, 7 up to 504 and 15 up to 1008.
pub const fn dead_time_field(ticks: u16) -> Option<u8> {
    Some(match ticks {
        1..=127 => ticks as u8,
        128..=254 => 0x80 | (ticks.div_ceil(2) - 64) as u8,
        255..=504 => 0xC0 | (ticks.div_ceil(8) - 32) as u8,
        505..=1008 => 0xE0 | (ticks.div_ceil(16) - 32) as u8,
        _ => return None,
    })
}

/// Ticks that a field DTG makes (RM0440, 28.6.20).
pub const fn dead_time_ticks(field: u8) -> u16 {
    let field = field as u16;
    match field >> 5 {
        0..=3 => field,
        4 | 5 => (64 + (field & 0x3F)) * 2,
        6 => (32 + (field & 0x1F)) * 8,
        _ => (32 + (field & 0x1F)) * 16,
    }
}

/// Ticks of a whole PWM period, of which half has so many counts.
pub const fn whole(period: u16) -> NonZeroU32 {
    NonZeroU32::MIN.saturating_add((2 * period as u32).saturating_sub(1))
}

/// CR1: centre-aligned, auto-reload preloaded, t_DTS one tick; not counting yet (TIM1_CR1).
pub const CR1: u32 = field(0b01, 5, 2) | bit(true, 7);
/// CR1 that counts.
pub const CR1_COUNTING: u32 = CR1 | 1;

/// RCR: one update a period. Written before the counter starts, it is that of the underflow, the valley (RM0440,
/// repetition counter).
pub const RCR: u32 = 1;

/// TIM1_EGR, UG: takes the preloaded values up.
pub const EGR_UPDATE: u32 = 1;
/// TIM1_EGR, COMG: takes the preloaded states of the legs up.
pub const EGR_COMMUTATE: u32 = 1 << 5;

/// TIM1_BDTR, MOE: main output enable.
pub const MOE: u32 = 1 << 15;
/// SYSCFG_CFGR2: breaks that the chip raises by itself: CLL, the core has locked up; SPL, a parity error of the SRAM;
/// ECCL, a double error of the flash.
pub const SYSTEM_BREAKS: u32 = bit(true, 0) | bit(true, 1) | bit(true, 3);

/// TIM1_SR, BIF: a break has come.
pub const BIF: u32 = 1 << 7;

/// TIM1_CR2: legs preloaded (CCPC), TRGO2 from OC4REF (MMS2 = 0111), and the idle levels at which both transistors of
/// each leg are off.
pub const fn cr2(gates: Gates) -> u32 {
    let mut value = 1 | field(0b0111, 20, 4);
    let mut leg = 0;
    while leg < 3 {
        value |= bit(is_low(gates.upper), 8 + 2 * leg) | bit(is_low(gates.lower), 9 + 2 * leg);
        leg += 1;
    }
    value
}

/// TIM1_CCMR1, CCMR2 and CCER for the legs that switch, bit n is leg n.
///
/// A leg that is to be open keeps its outputs driven, at the level at which the transistors are off: its reference is
/// forced inactive and the complementary output disabled, which OSSR turns into its inactive level (RM0440, table
/// "Output control bits for complementary OCx and OCxN channels with break feature"). Were both disabled, the pins
/// would float, and the inputs of the drivers with them.
pub const fn legs(gates: Gates, switching: u8) -> Legs {
    const PWM_2: u32 = 0b0111;
    const PWM_1: u32 = 0b0110;
    const INACTIVE: u32 = 0b0100;
    let mut value = Legs { ccmr1: 0, ccmr2: mode(PWM_1, 1), ccer: 0 };
    let mut leg = 0;
    while leg < 3 {
        let switches = switching >> leg & 1 != 0;
        let how = mode(if switches { PWM_2 } else { INACTIVE }, leg & 1) | bit(true, 3 + 8 * (leg & 1));
        if leg < 2 {
            value.ccmr1 |= how;
        } else {
            value.ccmr2 |= how;
        }
        let polarity = bit(is_low(gates.upper), 1) | bit(is_low(gates.lower), 3);
        value.ccer |= (1 | bit(switches, 2) | polarity) << (4 * leg);
        leg += 1;
    }
    value
}

/// See [`legs`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Legs {
    /// Modes of CH1 and CH2, compare values preloaded.
    pub ccmr1: u32,
    /// Modes of CH3 and CH4. CH4 has no pin: its reference rises where the counter passes CCR4 on its way down.
    pub ccmr2: u32,
    /// Which outputs are enabled, and their polarities.
    pub ccer: u32,
}

/// Field OCxM, of four bits in two places, of the lower or the upper channel of a CCMR.
const fn mode(mode: u32, upper: u32) -> u32 {
    (field(mode & 7, 4, 3) | field(mode >> 3, 16, 1)) << (8 * upper)
}

/// TIM1_BDTR: off, idle levels driven while off (OSSI) and while on (OSSR), break enabled and filtered, nothing
/// automatic. The lock at level 2 freezes all of this with polarities and idle levels until the next reset; MOE stays
/// writable.
pub const fn bdtr(dead_time: u8, source: Break, filter: u8) -> u32 {
    dead_time as u32
        | field(2, 8, 2)
        | bit(true, 10)
        | bit(true, 11)
        | bit(true, 12)
        | bit(matches!(source, Break::Comparators(_)), 13)
        | field(filter as u32, 16, 4)
}

/// TIM1_AF1: which sources are the break. Each is taken as it is: active low with BKP = 0, active high with BKP = 1.
pub const fn af1(source: Break) -> u32 {
    match source {
        Break::PinLow => 1,
        Break::Comparators(which) => field(which as u32, 1, 7),
    }
}

/// Ticks that a break must last for each field BKF of TIM1_BDTR, for t_DTS of one tick.
const FILTERS: [u16; 16] = [0, 2, 4, 8, 12, 16, 24, 32, 48, 64, 80, 96, 128, 160, 192, 256];

/// The strongest filter that lets a break of `ticks` through.
pub const fn break_filter(ticks: u32) -> u8 {
    let mut filter = 0;
    while filter < 15 && FILTERS[filter + 1] as u32 <= ticks {
        filter += 1;
    }
    filter as u8
}

const fn is_low(active: Active) -> bool {
    matches!(active, Active::Low)
}

#[cfg(test)]
mod tests {
    use super::*;

    const L6398: Gates = Gates { upper: Active::High, lower: Active::Low };
    const L6387: Gates = Gates { upper: Active::High, lower: Active::High };

    #[test]
    fn dead_time_is_never_shorter_and_hardly_longer() {
        for ticks in 1..=1008 {
            let field = dead_time_field(ticks).unwrap();
            let made = dead_time_ticks(field);
            let step = match ticks {
                1..=127 => 1,
                128..=254 => 2,
                255..=504 => 8,
                _ => 16,
            };
            assert!(made >= ticks && made < ticks + step, "{ticks}: {made}");
        }
        assert_eq!((dead_time_field(0), dead_time_field(1009)), (None, None));
    }

    #[test]
    fn dead_time_as_in_the_manuals_example() {
        // RM0440, 28.6.20: with t_DTS = 125 ns, 0 to 15875 ns by 125, 16 to 31750 ns by 250, 32 to 63 µs by 1 µs, 64 to
        // 126 µs by 2.
        for (field, nanoseconds) in [
            (0, 0),
            (127, 15_875),
            (0x80, 16_000),
            (0xBF, 31_750),
            (0xC0, 32_000),
            (0xDF, 63_000),
            (0xE0, 64_000),
            (0xFF, 126_000),
        ] {
            assert_eq!(u32::from(dead_time_ticks(field)) * 125, nanoseconds);
        }
        // 800 ns at 170 MHz are 136 ticks: 10 000100.
        assert_eq!(dead_time_field(136), Some(0x84));
        assert_eq!(dead_time_field(137), Some(0x85));
    }

    #[test]
    fn frequency() {
        assert_eq!(auto_reload(170_000_000, 20_000), 4250);
        assert_eq!(auto_reload(170_000_000, 40_000), 2125);
        for pwm in [8_000, 20_000, 40_000, 100_000] {
            let library = hallservo::pwm::period_counts(170e6, pwm as f32).unwrap();
            assert_eq!(auto_reload(170_000_000, pwm), library);
        }
    }

    #[test]
    fn ticks_round_up() {
        assert_eq!(ticks(170_000_000, 800), 136);
        assert_eq!(ticks(170_000_000, 801), 137);
        assert_eq!(ticks(170_000_000, 0), 0);
    }

    #[test]
    fn control_registers() {
        // TIM1_CR1: CMS = 01 in bits 6:5, ARPE bit 7, CEN bit 0.
        assert_eq!((CR1, CR1_COUNTING), (0xA0, 0xA1));
        // TIM1_CR2: CCPC bit 0, MMS2 = 0111 in bits 23:20. L6387: all idle levels low.
        assert_eq!(cr2(L6387), 0x0070_0001);
        // L6398: OIS1N, OIS2N, OIS3N, bits 9, 11, 13: lower inputs idle high, which is off.
        assert_eq!(cr2(L6398), 0x0070_2A01);
    }

    #[test]
    fn all_legs_switching() {
        // OC1M = 0111 in bits 6:4 and 16 = 0, OC1PE bit 3, the same for OC2 eight bits higher; OC4M = 0110 without
        // preload.
        let off = legs(L6387, 7);
        assert_eq!((off.ccmr1, off.ccmr2), (0x7878, 0x6078));
        // TIM1_CCER: CC1E, CC1NE bits 0 and 2; CC1P, CC1NP bits 1 and 3.
        assert_eq!(off.ccer, 0x555);
        assert_eq!(legs(L6398, 7), Legs { ccer: 0xDDD, ..off });
    }

    #[test]
    fn an_open_leg_is_driven_off() {
        // Leg 1: OC2M = 0100, CC2NE = 0 with CC2E = 1 and polarities as ever.
        assert_eq!(legs(L6398, 0b101), Legs { ccmr1: 0x4878, ccmr2: 0x6078, ccer: 0xD9D });
        assert_eq!(legs(L6387, 0b011), Legs { ccmr1: 0x7878, ccmr2: 0x6048, ccer: 0x155 });
        assert_eq!(legs(L6398, 0b110), Legs { ccmr1: 0x7848, ccmr2: 0x6078, ccer: 0xDD9 });
    }

    /// The levels of both outputs of a leg by the table of the output control bits, from nothing but register values.
    fn pins(leg: u32, cr2: u32, legs: Legs, on: bool, reference: bool) -> (bool, bool) {
        let of = |register: u32, at: u32| register >> at & 1 != 0;
        let ccer = legs.ccer >> (4 * leg);
        let ccmr = if leg < 2 { legs.ccmr1 >> (8 * leg) } else { legs.ccmr2 };
        // OSSI: while off, the idle levels are driven.
        if !on {
            return (of(cr2, 8 + 2 * leg), of(cr2, 9 + 2 * leg));
        }
        let reference = if ccmr >> 4 & 7 == 4 { false } else { reference };
        let upper = reference ^ of(ccer, 1);
        // OSSR: a disabled complementary output is driven to its inactive level.
        let lower = if of(ccer, 2) { !reference ^ of(ccer, 3) } else { of(ccer, 3) };
        (upper, lower)
    }

    #[test]
    fn transistors_are_off_when_they_should_be_and_never_both_on() {
        for gates in [L6387, L6398] {
            let conducts = |(upper, lower): (bool, bool)| {
                (upper == (gates.upper == Active::High), lower == (gates.lower == Active::High))
            };
            for switching in 0..8 {
                for leg in 0..3 {
                    for reference in [false, true] {
                        let at = |on| conducts(pins(leg, cr2(gates), legs(gates, switching), on, reference));
                        assert_eq!(at(false), (false, false), "off");
                        let switches = switching >> leg & 1 != 0;
                        let expected = if switches { (reference, !reference) } else { (false, false) };
                        assert_eq!(at(true), expected, "{gates:?} {switching} {leg} {reference}");
                    }
                }
            }
        }
    }

    #[test]
    fn break_and_dead_time() {
        // TIM1_BDTR: DTG 7:0, LOCK = 10 in 9:8, OSSI 10, OSSR 11, BKE 12, BKP 13, MOE 15 = 0, BKF 19:16.
        assert_eq!(bdtr(0x84, Break::PinLow, 9), 0x0009_1E84);
        assert_eq!(bdtr(0x84, Break::Comparators(0b1011), 15), 0x000F_3E84);
        assert_eq!(bdtr(0xFF, Break::Comparators(1), 15) & MOE, 0);
        // TIM1_AF1: BKINE bit 0, BKCMP1E bit 1, BKCMP2E bit 2, BKCMP4E bit 4; all polarities 0.
        assert_eq!(SYSTEM_BREAKS, 0xB);
        assert_eq!(af1(Break::PinLow), 0x001);
        assert_eq!(af1(Break::Comparators(0b1011)), 0x016);
    }

    #[test]
    fn break_filters() {
        // BKF = 1001 samples at f_DTS/8 and wants 8 alike; 1111 at f_DTS/32.
        assert_eq!(break_filter(64), 9);
        assert_eq!(break_filter(79), 9);
        assert_eq!(break_filter(256), 15);
        assert_eq!(break_filter(100_000), 15);
        assert_eq!(break_filter(1), 0);
    }
}
