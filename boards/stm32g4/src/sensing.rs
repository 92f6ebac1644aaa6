//! From an ADC's results to a sample, where they are not the same.

use core::num::NonZeroU32;

/// Largest code of an ADC of 12 bits.
pub const FULL_SCALE: u16 = 4095;

/// The middle of its range.
const MIDDLE: i32 = 2048;

/// A current in the library's sense, positive into the motor and zero in the middle, from an amplifier of a lower shunt: current
/// into the motor comes up through the shunt, so the code falls, from the one that the amplifier shows without a current.
#[inline(always)]
pub const fn current(code: u16, zero: u16) -> u16 {
    clamp(MIDDLE + zero as i32 - code as i32)
}

/// A temperature as the library expects it, from an NTC that pulls up: higher is colder.
#[inline(always)]
pub const fn pulled_up(code: u16) -> u16 {
    FULL_SCALE.saturating_sub(code)
}

/// The reading of a thermistor that is not there: as cold as can be, so that it holds nothing back.
pub const NO_THERMISTOR: u16 = FULL_SCALE;

/// Brings a channel that is held a little earlier than the others up to their instant, along its slope since the last period.
///
/// What is left of the skew is its square: ½·ω²·t·(T + t) of the amplitude for a sine of ω, t early in a period of T.
#[derive(Clone, Copy, Debug)]
pub struct Early {
    last: u16,
    /// t/T in 2⁻¹⁶.
    share: i32,
}

impl Early {
    /// Held `early` ticks before the others, in a period of `period` ticks.
    pub const fn new(early: u32, period: u32) -> Self {
        Self { last: MIDDLE as u16, share: ((early << 16) / period) as i32 }
    }

    /// The code that the channel would have had later. One at the end of the range stays there, so a lost sensor shows.
    #[inline(always)]
    pub const fn at_once(&mut self, code: u16) -> u16 {
        let slope = code as i32 - self.last as i32;
        self.last = code;
        if code == 0 || code >= FULL_SCALE {
            return code;
        }
        clamp(code as i32 + ((slope * self.share + (1 << 15)) >> 16))
    }
}

#[inline(always)]
const fn clamp(code: i32) -> u16 {
    if code < 0 {
        0
    } else if code > FULL_SCALE as i32 {
        FULL_SCALE
    } else {
        code as u16
    }
}

/// Counts the periods that passed without an interrupt.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    period: NonZeroU32,
    last: Option<u32>,
}

impl Cadence {
    /// For a period of so many cycles of the core.
    pub const fn new(period: NonZeroU32) -> Self {
        Self { period, last: None }
    }

    /// Periods lost before this interrupt, at a count of cycles; the first one has lost none. Half a period late is still in time.
    #[inline(always)]
    pub fn lost(&mut self, now: u32) -> u8 {
        let Some(before) = self.last.replace(now) else { return 0 };
        let half = self.period.get() / 2;
        let late = now.wrapping_sub(before).saturating_sub(half);
        // As a rule no division is needed.
        if late < self.period.get() { 0 } else { (late / self.period).min(255) as u8 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn currents_are_positive_into_the_motor() {
        assert_eq!(current(2122, 2122), 2048);
        assert_eq!(current(2122 - 100, 2122), 2148);
        assert_eq!(current(4095, 2122), 75);
        // A little more than the range remains the end of the range.
        assert_eq!((current(0, 2553), current(4095, 2000)), (4095, 0));
    }

    #[test]
    fn thermistor_pulling_up() {
        // 10 kΩ to 3.3 V, 4.7 kΩ to ground at 25 °C: 4095 · 4.7 / 14.7 = 1309; the library expects 10 kΩ to ground.
        let library = hallservo::settings::Thermistor {
            pull_up_ohm: 4700.0,
            ..hallservo::settings::Thermistor::ntc_10k(80.0, 100.0)
        };
        assert!((f32::from(pulled_up(1309)) * 16.0 - library.code(25.0)).abs() < 16.0);
        assert!(f32::from(NO_THERMISTOR) * 16.0 > library.code(-39.0));
    }

    #[test]
    fn an_early_channel_catches_up() {
        // 100 ticks early in 4250, 1 kHz electrical at 40 kHz PWM.
        let (early, period, amplitude) = (100.0, 4250.0, 1500.0);
        let omega = core::f64::consts::TAU * 1000.0 / 170e6;
        let wave = |tick: f64| 2048.0 + amplitude * (omega * tick).sin();
        let mut channel = Early::new(100, 4250);
        channel.at_once(wave(-period - early).round() as u16);
        let (mut worst, mut without) = (0_f64, 0_f64);
        for n in 0..1000 {
            let at = period * f64::from(n);
            let code = wave(at - early).round();
            let corrected = channel.at_once(code as u16);
            worst = worst.max((f64::from(corrected) - wave(at)).abs());
            without = without.max((code - wave(at)).abs());
        }
        let left = amplitude * omega * omega * early * (period + early) / 2.0;
        assert!(without > 5.0 && worst < left + 1.1, "{worst} of {without}, {left} expected");
    }

    #[test]
    fn a_channel_at_a_rail_stays_there() {
        let mut channel = Early::new(100, 8500);
        for code in [2000, 4095, 4095, 0, 0, 4095] {
            let at_once = channel.at_once(code);
            assert!(code == 2000 || at_once == code);
        }
    }

    #[test]
    fn lost_periods() {
        let mut cadence = Cadence::new(NonZeroU32::new(1000).unwrap());
        let mut now = u32::MAX - 2500;
        assert_eq!(cadence.lost(now), 0);
        for (elapsed, lost) in [(1000, 0), (1400, 0), (600, 0), (2000, 1), (2400, 1), (3000, 2), (1, 0), (700_000, 255)]
        {
            now = now.wrapping_add(elapsed);
            assert_eq!(cadence.lost(now), lost, "{elapsed}");
        }
    }
}
