//! From an ADC's results to a [`Sample`], where they are not the same.

use crate::board::{Sample, TemperatureCode};
use core::num::NonZeroU32;

/// An ADC of a resolution.
pub struct Adc<const BITS: u32>;

impl<const BITS: u32> Adc<BITS> {
    /// Largest code.
    pub const FULL_SCALE: u16 = ((1_u32 << BITS) - 1) as u16;
    /// Code of a current of zero in a sample.
    pub const MIDDLE: u16 = 1 << (BITS - 1);

    /// A current of a sample from an amplifier of a lower shunt: a current into the motor comes up through the shunt,
    /// so the code falls, from the one that the amplifier shows without a current, `zero`.
    #[inline(always)]
    pub const fn low_side_current(code: u16, zero: u16) -> u16 {
        Self::clamp(Self::MIDDLE as i32 + zero as i32 - code as i32)
    }

    /// A current of a sample from an amplifier whose code rises with a current into the motor.
    #[inline(always)]
    pub const fn in_line_current(code: u16, zero: u16) -> u16 {
        Self::clamp(Self::MIDDLE as i32 + code as i32 - zero as i32)
    }

    /// A temperature of a sample from an NTC to the reference with a pull-down: the higher, the warmer.
    #[inline(always)]
    pub const fn ntc_to_reference(code: u16) -> TemperatureCode {
        TemperatureCode::new(Self::FULL_SCALE.saturating_sub(code))
    }

    /// What the drive is shown when the hardware's break input has switched the bridge off: a current that no sample
    /// caught, so the largest. A drive with current control that is running fails with
    /// [`Fault::OverCurrent`](crate::fault::Fault::OverCurrent). One without looks at no currents: there a task sends
    /// [`Command::Trip`](crate::drive::Command::Trip).
    #[inline(always)]
    pub const fn show_tripped(sample: &mut Sample) {
        sample.currents = [Self::FULL_SCALE; 3];
    }

    #[inline(always)]
    const fn clamp(code: i32) -> u16 {
        if code < 0 {
            0
        } else if code > Self::FULL_SCALE as i32 {
            Self::FULL_SCALE
        } else {
            code as u16
        }
    }
}

/// Brings a channel that is held a little earlier than the others up to their instant, along its slope since the last
/// period: for ADCs that convert one after the other.
///
/// What is left of the skew is its square: ½·ω²·t·(T + t) of the amplitude for a sine of ω, t early in a period of T.
#[derive(Clone, Copy, Debug)]
pub struct SkewCompensation<const BITS: u32> {
    /// Code of the last period.
    last: u16,
    /// t/T in 2⁻¹⁶.
    share: i32,
}

impl<const BITS: u32> SkewCompensation<BITS> {
    /// Held `early` ticks before the others, in a PWM period of `period` ticks.
    pub const fn new(early: u32, period: NonZeroU32) -> Self {
        Self { last: Adc::<BITS>::MIDDLE, share: ((early << 16) / period.get()) as i32 }
    }

    /// The code that the channel would have had later. One at an end of the range stays there, so a lost sensor shows.
    #[inline(always)]
    pub const fn at_once(&mut self, code: u16) -> u16 {
        let slope = code as i32 - self.last as i32;
        self.last = code;
        if code == 0 || code >= Adc::<BITS>::FULL_SCALE {
            return code;
        }
        Adc::<BITS>::clamp(code as i32 + ((slope * self.share + (1 << 15)) >> 16))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Thermistor;

    #[test]
    fn currents_are_positive_into_the_motor() {
        let current = Adc::<12>::low_side_current;
        assert_eq!(current(2122, 2122), 2048);
        assert_eq!(current(2122 - 100, 2122), 2148);
        assert_eq!(current(4095, 2122), 75);
        // A little more than the range remains the end of the range.
        assert_eq!((current(0, 2553), current(4095, 2000)), (4095, 0));
        assert_eq!(Adc::<12>::in_line_current(2100, 2000), 2148);
    }

    #[test]
    fn a_thermistor_to_the_reference() {
        // 10 kΩ to 3.3 V, 4.7 kΩ to ground at 25 °C: 4095 · 4.7 / 14.7 = 1309; a sample has 10 kΩ to ground.
        let library = Thermistor { pull_up_ohm: 4700.0, ..Thermistor::ntc_10k(80.0, 100.0) };
        let code = Adc::<12>::ntc_to_reference(1309).code().unwrap();
        assert!((f32::from(code) * 16.0 - library.code(25.0)).abs() < 16.0);
    }

    #[test]
    fn an_early_channel_catches_up() {
        // 100 ticks early in 4250, 1 kHz electrical at 40 kHz PWM.
        let (early, period, amplitude) = (100.0, 4250.0, 1500.0);
        let omega = core::f64::consts::TAU * 1000.0 / 170e6;
        let wave = |tick: f64| 2048.0 + amplitude * libm::sin(omega * tick);
        let mut channel = SkewCompensation::<12>::new(100, NonZeroU32::new(4250).unwrap());
        channel.at_once(libm::round(wave(-period - early)) as u16);
        let (mut worst, mut without) = (0_f64, 0_f64);
        for n in 0..1000 {
            let at = period * f64::from(n);
            let code = libm::round(wave(at - early));
            let corrected = channel.at_once(code as u16);
            worst = worst.max((f64::from(corrected) - wave(at)).abs());
            without = without.max((code - wave(at)).abs());
        }
        let left = amplitude * omega * omega * early * (period + early) / 2.0;
        assert!(without > 5.0 && worst < left + 1.1, "{worst} of {without}, {left} expected");
    }

    #[test]
    fn a_channel_at_a_rail_stays_there() {
        let mut channel = SkewCompensation::<12>::new(100, NonZeroU32::new(8500).unwrap());
        for code in [2000, 4095, 4095, 0, 0, 4095] {
            let at_once = channel.at_once(code);
            assert!(code == 2000 || at_once == code);
        }
    }
}
