//! From an ADC code to a signal of amplitude one: Simpkins and Todorov, eq. (2) and its inverse, eq. (3).
//!
//! The division by `β − α` happens once, when the [`Normalizer`] is made; a sample costs a range check and one
//! multiply-add. A code outside the sensor's plausible range is an [`Implausible`], never an angle.

use crate::hall::Channel;
use core::fmt;
use fixed::types::I4F28;

/// A normalised signal: ±1 at the calibrated minimum and maximum.
pub type Signal = I4F28;

/// Codes beyond this multiple of the amplitude from the offset cannot come from a healthy sensor: temperature,
/// harmonics and noise together stay below.
pub const PLAUSIBLE: f32 = 1.5;

/// Why the codes of a sample are not an angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Implausible {
    /// The code sits at the end of the ADC's range: shorted, open, or so close to the magnet that it saturates.
    AtRail(Channel),
    /// The code is farther from the offset than any angle explains.
    OutOfRange(Channel),
    /// All three are in range, but no angle explains them together: one is stuck, or they are swapped.
    Inconsistent,
    /// All three rest near their offsets: no magnet, or no supply.
    Weak,
    /// Together they are stronger than calibrated.
    Strong,
}

impl fmt::Display for Implausible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtRail(channel) => write!(f, "{channel} is at the end of the ADC's range"),
            Self::OutOfRange(channel) => write!(f, "{channel} is outside its calibrated range"),
            Self::Inconsistent => write!(f, "the three Halls contradict each other"),
            Self::Weak => write!(f, "the Halls see no magnet"),
            Self::Strong => write!(f, "the Halls see a stronger magnet than calibrated"),
        }
    }
}

impl core::error::Error for Implausible {}

/// The codes that a healthy sensor can deliver, one comparison to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    low: u32,
    span: u32,
}

impl Window {
    /// Every code, rails included: of a sensor that is not used.
    pub(crate) const fn all(adc_bits: u8) -> Self {
        Self { low: 0, span: (1 << adc_bits) - 1 }
    }

    /// No code is in it.
    pub const NOTHING: Self = Self { low: u32::MAX, span: 0 };

    /// The codes within [`PLAUSIBLE`] amplitudes of the offset and off the rails of the ADC. Not a number, or a
    /// window without a code in it, gives `None`.
    pub fn new(offset: f32, amplitude: f32, adc_bits: u8) -> Option<Self> {
        let rail = ((1_u32 << adc_bits) - 1) as f32;
        let low = libm::ceilf(offset - PLAUSIBLE * amplitude).max(1.0);
        let high = libm::floorf(offset + PLAUSIBLE * amplitude).min(rail - 1.0);
        // False for not-a-numbers, too.
        (amplitude > 0.0 && offset.is_finite() && low <= high)
            .then_some(Self { low: low as u32, span: (high - low) as u32 })
    }

    /// The smallest window that holds three others.
    pub fn around(windows: [Self; 3]) -> Self {
        let low = windows.iter().fold(u32::MAX, |low, window| low.min(window.low));
        let high = windows.iter().fold(0, |high, window| high.max(window.low.saturating_add(window.span)));
        Self { low, span: high.saturating_sub(low) }
    }

    /// Whether the code is in the window.
    #[inline(always)]
    pub const fn contains(self, code: u16) -> bool {
        (code as u32).wrapping_sub(self.low) <= self.span
    }

    /// Lowest and highest code in the window.
    pub const fn bounds(self) -> (u16, u16) {
        (self.low as u16, (self.low + self.span) as u16)
    }

    /// Why a code is not in the window of the sensor on `channel`.
    #[cold]
    pub const fn explain(channel: Channel, code: u16, adc_bits: u8) -> Implausible {
        if code == 0 || code as u32 >= (1 << adc_bits) - 1 {
            Implausible::AtRail(channel)
        } else {
            Implausible::OutOfRange(channel)
        }
    }
}

/// Normalises the codes of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Normalizer {
    window: Window,
    gain: i32,
    bias: i32,
    channel: Channel,
    adc_bits: u8,
}

impl Normalizer {
    /// For a sensor with minimum α and maximum β in ADC codes. `None` unless `α < β` are finite, within the range
    /// of the ADC and at least 8 codes apart.
    pub fn new(channel: Channel, minimum: f32, maximum: f32, adc_bits: u8) -> Option<Self> {
        let (offset, amplitude) = ((maximum + minimum) / 2.0, (maximum - minimum) / 2.0);
        if !(amplitude >= 4.0) || !(1..=16).contains(&adc_bits) {
            return None;
        }
        let window = Window::new(offset, amplitude, adc_bits)?;
        let gain = libm::round(f64::from(1_u32 << Signal::FRAC_NBITS) / f64::from(amplitude));
        // Gain times code may exceed 32 bits; the sum with the bias does not, inside the window, so it may wrap.
        let bias = -gain * f64::from(offset);
        Some(Self { window, gain: gain as i32, bias: (bias as i64) as i32, channel, adc_bits })
    }

    /// Eq. (2): −1 at α, +1 at β, to 2⁻¹³ at 16 bits and 2⁻¹⁷ at 12.
    ///
    /// # Errors
    /// [`Implausible::AtRail`] or [`Implausible::OutOfRange`].
    #[inline(always)]
    pub const fn normalize(&self, code: u16) -> Result<Signal, Implausible> {
        if self.window.contains(code) {
            Ok(Signal::from_bits((code as i32).wrapping_mul(self.gain).wrapping_add(self.bias)))
        } else {
            Err(Window::explain(self.channel, code, self.adc_bits))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalises_every_code_of_every_resolution() {
        for adc_bits in [8, 10, 12, 14, 16] {
            let mut worst = 0.0_f64;
            let full = f64::from((1_u32 << adc_bits) - 1);
            for (minimum, maximum) in [(0.1, 0.9), (0.3, 0.5), (0.02, 0.98), (0.6, 0.8)] {
                let (minimum, maximum) = (full * minimum, full * maximum);
                let sensor = Normalizer::new(Channel(1), minimum as f32, maximum as f32, adc_bits).unwrap();
                for code in 0..=(full as u16) {
                    let exact = 2.0 * (f64::from(code) - minimum) / (maximum - minimum) - 1.0;
                    let plausible = exact.abs() <= f64::from(PLAUSIBLE) && code > 0 && f64::from(code) < full;
                    match sensor.normalize(code) {
                        Ok(signal) => {
                            assert!(plausible, "{code}");
                            worst = worst.max((signal.to_num::<f64>() - exact).abs());
                        }
                        Err(why) => {
                            let at_rail = code == 0 || f64::from(code) == full;
                            assert!(!plausible, "{code}");
                            assert_eq!(why == Implausible::AtRail(Channel(1)), at_rail);
                        }
                    }
                }
            }
            let bound = if adc_bits > 12 { -13 } else { -17 };
            assert!(worst < 2.0_f64.powi(bound), "{adc_bits} bits: {worst:e}");
        }
    }

    #[test]
    fn refuses_what_cannot_be_a_sensor() {
        for (minimum, maximum, bits) in [
            (100.0, 100.0, 12),
            (200.0, 100.0, 12),
            (f32::NAN, 100.0, 12),
            (1.0, f32::INFINITY, 12),
            (5e3, 6e3, 12),
            (1e2, 2e2, 0),
            (1e2, 2e2, 17),
        ] {
            assert_eq!(Normalizer::new(Channel(0), minimum, maximum, bits), None, "{minimum} {maximum} {bits}");
        }
    }
}
