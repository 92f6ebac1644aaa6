//! Which ADC codes a healthy sensor can deliver: a code outside this range is an [`Implausible`], never an angle.

use crate::hall::Channel;
use core::fmt;

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
            Self::Inconsistent => write!(f, "the Halls contradict each other"),
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
        let low = crate::float::ceil(offset - PLAUSIBLE * amplitude).max(1.0);
        let high = crate::float::floor(offset + PLAUSIBLE * amplitude).min(rail - 1.0);
        // False for not-a-numbers, too.
        (amplitude > 0.0 && offset.is_finite() && low <= high)
            .then_some(Self { low: low as u32, span: (high - low) as u32 })
    }

    /// The smallest window that holds three others.
    pub fn around(windows: &[Self; 3]) -> Self {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_code_at_an_end_of_the_range_is_a_healthy_sensors() {
        // However large the amplitude.
        let window = Window::new(2048.0, 3000.0, 12).unwrap();
        assert_eq!(window.bounds(), (1, 4094));
        assert!(!window.contains(0) && window.contains(1) && window.contains(4094) && !window.contains(4095));
    }
}
