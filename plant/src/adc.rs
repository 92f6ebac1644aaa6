//! From voltages to codes.

use crate::error::{Error, finite, not_negative, positive, require};
use crate::noise::Noise;

/// An analog-to-digital converter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdcParameters {
    /// Resolution, 8 to 16 bit.
    pub bits: u8,
    /// Voltage of full scale, V.
    pub reference_v: f64,
    /// Gain error, relative.
    pub gain_error: f64,
    /// Offset error in LSB, added to the code before it is rounded.
    pub offset_lsb: f64,
}

impl AdcParameters {
    /// Without errors but rounding.
    #[must_use]
    pub const fn ideal(bits: u8, reference_v: f64) -> Self {
        Self { bits, reference_v, gain_error: 0.0, offset_lsb: 0.0 }
    }

    /// Volts of one LSB.
    #[must_use]
    pub fn lsb_v(&self) -> f64 {
        self.reference_v / self.steps()
    }

    fn steps(&self) -> f64 {
        f64::from(1_u32 << self.bits)
    }
}

/// A sensor that the converter reads beside the Halls: a phase current's amplifier, the bus
/// divider.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SenseParameters {
    /// Volts at the converter per ampere (volt) measured.
    pub gain: f64,
    /// Volts at the converter at zero.
    pub offset_v: f64,
    /// Standard deviation of the Gaussian noise at the converter, V.
    pub noise_v: f64,
}

impl SenseParameters {
    /// `names` are those of the three fields.
    pub(crate) fn check(&self, names: [&'static str; 3]) -> Result<(), Error> {
        finite(self.gain, names[0])?;
        finite(self.offset_v, names[1])?;
        not_negative(self.noise_v, names[2])
    }

    pub(crate) fn volts(&self, quantity: f64, noise: &mut Noise) -> f64 {
        self.gain * quantity + self.offset_v + noise.scaled(self.noise_v)
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Adc {
    lsb_per_v: f64,
    offset_lsb: f64,
    highest: f64,
}

impl Adc {
    pub fn new(parameters: &AdcParameters) -> Result<Self, Error> {
        require((8..=16).contains(&parameters.bits), "adc.bits", "8 to 16")?;
        positive(parameters.reference_v, "adc.reference_v")?;
        finite(parameters.gain_error, "adc.gain_error")?;
        finite(parameters.offset_lsb, "adc.offset_lsb")?;
        Ok(Self {
            lsb_per_v: (1.0 + parameters.gain_error) * parameters.steps() / parameters.reference_v,
            offset_lsb: parameters.offset_lsb,
            highest: parameters.steps() - 1.0,
        })
    }

    /// The nearest code, within 0 ..= 2^bits - 1.
    pub fn code(&self, volts: f64) -> u16 {
        let code = volts * self.lsb_per_v + self.offset_lsb + 0.5;
        // The cast drops the fraction and stops at 0.
        (if code > self.highest { self.highest } else { code }) as u16
    }
}
