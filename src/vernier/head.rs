//! A head with sine and cosine outputs: its reading, and whether it can be believed.
//!
//! Offset and gain of the two outputs need not be exact: what they leave is an error that repeats with every pole
//! pair, which the linearity table takes out. The length of the vector tells what no angle can: that the magnet has
//! lost its field, that the head is too far away or too close, that a wire is off.

use crate::trig;
use core::fmt;

/// One output of a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Channel {
    /// Code without field.
    pub offset: u16,
    /// Amplitude in codes.
    pub amplitude: u16,
}

impl Channel {
    /// From the smallest and the largest code seen over at least one pole pair; `None` if there is no swing.
    pub const fn from_extremes(smallest: u16, largest: u16) -> Option<Self> {
        if largest <= smallest.saturating_add(1) {
            return None;
        }
        Some(Self { offset: smallest + (largest - smallest) / 2, amplitude: (largest - smallest) / 2 })
    }

    /// 2¹² over the amplitude, in 2⁻¹⁶.
    const fn gain(self) -> i32 {
        (1 << 28) / self.amplitude as i32
    }
}

/// Why a head's codes are not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum HeadFault {
    /// A code is at an end of the converter's range.
    Saturated,
    /// The vector is shorter than 0.7 of its calibrated length: field lost, head too far, wire off.
    Weak,
    /// The vector is longer than 1.4 times its calibrated length: head too close, reference voltage wrong.
    Strong,
}

impl fmt::Display for HeadFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Saturated => "a head's output is at the end of the converter's range",
            Self::Weak => "a head's amplitude is below 0.7 of what it was at calibration",
            Self::Strong => "a head's amplitude is above 1.4 times what it was at calibration",
        })
    }
}

impl core::error::Error for HeadFault {}

/// A head of two channels under a converter.
#[derive(Clone, Copy, Debug)]
pub struct Head {
    offsets: [i32; 2],
    gains: [i32; 2],
    full_scale: u16,
}

/// The calibrated length of the vector.
const UNIT: u32 = 1 << 12;

impl Head {
    /// A head of the given channels, converted to codes 0 to `full_scale`. `None` for a channel without amplitude or
    /// with one beyond the full scale.
    pub const fn new(sine: Channel, cosine: Channel, full_scale: u16) -> Option<Self> {
        if sine.amplitude == 0 || cosine.amplitude == 0 || sine.amplitude > full_scale || cosine.amplitude > full_scale
        {
            return None;
        }
        Some(Self {
            offsets: [sine.offset as i32, cosine.offset as i32],
            gains: [sine.gain(), cosine.gain()],
            full_scale,
        })
    }

    /// The reading for a pair of codes, with the error of [`trig::atan2`] and of rounding to 2⁻¹⁶ pole pairs.
    ///
    /// # Errors
    /// Saturation, or an amplitude that is not that of the calibration.
    #[inline]
    pub const fn read(&self, sine: u16, cosine: u16) -> Result<u16, HeadFault> {
        if self.at_rail(sine) || self.at_rail(cosine) {
            return Err(HeadFault::Saturated);
        }
        let y = self.normalise(0, sine);
        let x = self.normalise(1, cosine);
        let square = y.unsigned_abs().pow(2) as u64 + x.unsigned_abs().pow(2) as u64;
        if square < (UNIT as u64 * UNIT as u64) * 49 / 100 {
            return Err(HeadFault::Weak);
        }
        if square > (UNIT as u64 * UNIT as u64) * 196 / 100 {
            return Err(HeadFault::Strong);
        }
        Ok((trig::atan2(y, x).to_bits().wrapping_add(1 << 15) as u32 >> 16) as u16)
    }

    const fn at_rail(&self, code: u16) -> bool {
        code == 0 || code >= self.full_scale
    }

    /// A code in units of 2⁻¹² of the amplitude, limited to ±8 amplitudes.
    const fn normalise(&self, channel: usize, code: u16) -> i32 {
        let scaled = ((code as i32 - self.offsets[channel]) as i64 * self.gains[channel] as i64) >> 16;
        let limit = 8 * UNIT as i64;
        if scaled > limit {
            limit as i32
        } else if scaled < -limit {
            -limit as i32
        } else {
            scaled as i32
        }
    }
}

/// Brings the readings of a ring that are held at another instant than those of the other to its instant, by how far
/// they have moved since the sample before.
#[derive(Clone, Copy, Debug)]
pub struct ReadingSkew<const HEADS: usize> {
    /// How much later they are held, in 2⁻¹⁶ of a period.
    later: i32,
    last: [u16; HEADS],
}

impl<const HEADS: usize> ReadingSkew<HEADS> {
    /// For readings held `later` timer counts after the others, of so many in a control period; less than a period.
    pub const fn new(later: i32, period: u32) -> Self {
        Self { later: ((later as i64) << 16).wrapping_div(period as i64) as i32, last: [0; HEADS] }
    }

    /// What the readings were when the others were held. The first after the start is off by up to the whole skew.
    #[inline(always)]
    pub fn at_once(&mut self, readings: [u16; HEADS]) -> [u16; HEADS] {
        let last = core::mem::replace(&mut self.last, readings);
        let mut readings = readings;
        for (reading, last) in readings.iter_mut().zip(last) {
            let way = i32::from(reading.wrapping_sub(last) as i16) * self.later;
            *reading = reading.wrapping_sub((way >> 16) as u16);
        }
        readings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    const SINE: Channel = Channel { offset: 2100, amplitude: 1500 };
    const COSINE: Channel = Channel { offset: 1980, amplitude: 1400 };

    fn codes(place: f64, field: f64) -> (u16, u16) {
        let code = |channel: Channel, value: f64| {
            libm::round(f64::from(channel.offset) + f64::from(channel.amplitude) * field * value).clamp(0.0, 4095.0)
                as u16
        };
        (code(SINE, libm::sin(TAU * place)), code(COSINE, libm::cos(TAU * place)))
    }

    #[test]
    fn a_healthy_head_reads_its_place() {
        let head = Head::new(SINE, COSINE, 4095).unwrap();
        for step in 0..100_000 {
            let place = f64::from(step) / 100_000.0;
            let (sine, cosine) = codes(place, 1.0);
            let error = f64::from(head.read(sine, cosine).unwrap()) / 65536.0 - place;
            // Half a code on both channels is the larger part.
            assert!((error - libm::round(error)).abs() < 1.5e-4, "{place} {error}");
        }
    }

    #[test]
    fn amplitudes_that_are_not_the_calibrated_ones_are_named() {
        let head = Head::new(SINE, COSINE, 4095).unwrap();
        for step in 0..1000 {
            let place = f64::from(step) / 1000.0;
            let read = |field| {
                let (sine, cosine) = codes(place, field);
                head.read(sine, cosine)
            };
            assert_eq!(read(0.5), Err(HeadFault::Weak));
            assert_eq!(read(0.69), Err(HeadFault::Weak));
            assert!(read(0.71).is_ok() && read(1.3).is_ok());
        }
        assert_eq!(head.read(3900, 3100), Err(HeadFault::Strong));
        assert_eq!(head.read(4095, 1980), Err(HeadFault::Saturated));
        assert_eq!(head.read(2100, 0), Err(HeadFault::Saturated));
    }

    #[test]
    fn readings_held_later_are_brought_to_the_instant_of_the_others() {
        // Over the wrap, both ways: a twentieth of a pole pair a period, held an eighth of a period later.
        for speed in [0.05, -0.05, 0.3] {
            let mut skew = ReadingSkew::<1>::new(500, 4000);
            let reading = |turns: f64| (((turns - libm::floor(turns)) * 65_536.0) as u32 & 0xffff) as u16;
            for step in 0..100 {
                let turns = speed * f64::from(step);
                let [found] = skew.at_once([reading(turns + 0.125 * speed)]);
                let error = found.wrapping_sub(reading(turns)) as i16;
                assert!(step == 0 || error.abs() <= 2, "{speed} {step} {error}");
            }
        }
    }

    #[test]
    fn extremes_make_channels() {
        assert_eq!(Channel::from_extremes(600, 3600), Some(SINE));
        assert_eq!(Channel::from_extremes(600, 601), None);
        assert_eq!(Channel::from_extremes(601, 600), None);
        let none = Channel { offset: 0, amplitude: 0 };
        assert!(Head::new(none, COSINE, 4095).is_none());
        assert!(Head::new(SINE, Channel { amplitude: 5000, ..SINE }, 4095).is_none());
    }
}
