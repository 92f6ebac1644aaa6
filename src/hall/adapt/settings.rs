//! Settings of the adaptation in SI units, and the form the filter works with.

use crate::hall::{Channel, Halls};
use core::f32::consts::TAU;
use core::fmt;

/// One number for each kind of parameter; all but the placement are shares of the sensor's calibrated amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Spread {
    /// Offset of each sensor, share of the amplitude.
    pub offset: f32,
    /// Amplitude of each sensor, share of the calibrated one.
    pub amplitude: f32,
    /// ψ: placement of the second and third sensor against the first, electrical degrees.
    pub placement_deg: f32,
    /// h₃: third harmonic, which the sensors share, share of the amplitude.
    pub third: f32,
}

/// Settings of the adaptation. The default is for the motor of Simpkins and Todorov after a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// Three, or two: then the third is not looked at.
    pub halls: Halls,
    /// Resolution of the ADC, 8 to 16.
    pub adc_bits: u8,
    /// Rate of the samples, 50 Hz to 20 kHz.
    pub update_hz: f32,
    /// Standard deviation of each sensor's noise in ADC codes, 0 to a tenth of the ADC's range. The calibration
    /// measures it; half a code of quantisation comes on top.
    pub noise_codes: [f32; 3],
    /// Pole pairs of the rotor, 1 to 64.
    pub pole_pairs: u8,
    /// J: inertia of all that turns, 1e-9 to 10 kg·m².
    pub inertia_kgm2: f32,
    /// k_e + μ_f of eq. (11): torque against the motion per speed, 0 to 10 N·m·s.
    pub damping_nms: f32,
    /// Density of the torque that is not told to the filter, N·m/√Hz: what follows from the inertia must be from 1e-3
    /// to 1e5 rad/s²/√Hz, electrical. Low smooths more, high follows faster.
    pub torque_noise_nm_rthz: f32,
    /// What each parameter may wander by in a second, and in t seconds √t times as much; each 0 to 1, degrees 0 to 10.
    pub drift: Spread,
    /// Standard deviation of the model it starts from; each 0 to 0.5, degrees 0 to 20.
    pub start: Spread,
    /// Limits around that model which no parameter leaves; at least as large as `start`, at most 0.6 and 25 degrees.
    pub limits: Spread,
    /// Slowest speed at which parameters are learnt, 0.05 Hz electrical to a tenth of `update_hz`.
    pub slowest_hz: f32,
}

impl Settings {
    /// How far a data sheet and a ruler may be from the truth: for a start without a calibration.
    pub const NOMINAL: Spread = Spread { offset: 0.06, amplitude: 0.18, placement_deg: 6.5, third: 0.05 };
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            halls: Halls::Three,
            adc_bits: 12,
            update_hz: 1e3,
            noise_codes: [2.5; 3],
            pole_pairs: 4,
            inertia_kgm2: 1e-5,
            damping_nms: 1.6e-4,
            torque_noise_nm_rthz: 1e-5,
            drift: Spread { offset: 5e-4, amplitude: 2e-3, placement_deg: 0.02, third: 2e-4 },
            start: Spread { offset: 0.01, amplitude: 0.03, placement_deg: 1.0, third: 0.01 },
            limits: Spread { offset: 0.25, amplitude: 0.45, placement_deg: 20.0, third: 0.15 },
            slowest_hz: 0.5,
        }
    }
}

/// A setting out of its range.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfRange {
    /// Name of the field.
    pub field: &'static str,
    /// What it is.
    pub value: f32,
    /// Least allowed.
    pub min: f32,
    /// Most allowed.
    pub max: f32,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is {}, but must be from {} to {}", self.field, self.value, self.min, self.max)
    }
}

impl core::error::Error for OutOfRange {}

/// [`Settings`] in the units of the filter: samples, radians and amplitudes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    pub(crate) halls: Halls,
    pub(crate) adc_bits: u8,
    pub(crate) noise_codes: [f32; 3],
    /// Share of the speed that friction takes in a sample, 0 to 1.
    pub(crate) damping: f32,
    /// Acceleration by a torque, rad/sample² for 1 N·m.
    pub(crate) per_nm: f32,
    /// Variance of the speed's random change in a sample, rad²/sample².
    pub(crate) acceleration: f32,
    /// Variances that the parameters gain in a sample.
    pub(crate) drift: Spread,
    /// Variances of the parameters at the start.
    pub(crate) start: Spread,
    /// Limits of the parameters, share of the amplitude and rad.
    pub(crate) limits: Spread,
    /// Slowest speed at which parameters are adapted, rad a sample.
    pub(crate) slowest: f32,
    /// Samples without adaptation after which the drift of that time is added before it goes on: one second.
    pub(crate) pause: u32,
}

impl Config {
    /// The sensor that is not there, if one is not.
    pub(crate) fn absent(&self) -> Option<Channel> {
        (self.halls == Halls::Two).then_some(Channel::THIRD)
    }

    /// Whether a code sits at the end of the ADC's range.
    #[inline]
    pub(crate) const fn is_at_rail(&self, code: u16) -> bool {
        // Code 0 wraps to the top.
        (code as u32).wrapping_sub(1) >= (1 << self.adc_bits) - 2
    }
}

fn within(field: &'static str, value: f32, min: f32, max: f32) -> Result<f32, OutOfRange> {
    // Not a number is in no range.
    if (min..=max).contains(&value) { Ok(value) } else { Err(OutOfRange { field, value, min, max }) }
}

/// A spread in radians, each field within its range. The names are those of the fields.
fn spread(names: [&'static str; 4], value: &Spread, least: &Spread, most: &Spread) -> Result<Spread, OutOfRange> {
    Ok(Spread {
        offset: within(names[0], value.offset, least.offset, most.offset)?,
        amplitude: within(names[1], value.amplitude, least.amplitude, most.amplitude)?,
        placement_deg: within(names[2], value.placement_deg, least.placement_deg, most.placement_deg)?.to_radians(),
        third: within(names[3], value.third, least.third, most.third)?,
    })
}

/// The same number in all fields but the placement.
const fn even(relative: f32, placement_deg: f32) -> Spread {
    Spread { offset: relative, amplitude: relative, placement_deg, third: relative }
}

impl Spread {
    /// Squares, times a factor.
    fn variances(&self, times: f32) -> Self {
        Self {
            offset: self.offset * self.offset * times,
            amplitude: self.amplitude * self.amplitude * times,
            placement_deg: self.placement_deg * self.placement_deg * times,
            third: self.third * self.third * times,
        }
    }
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first that cannot be.
    pub fn validate(&self) -> Result<Config, OutOfRange> {
        let range = (1_u32 << within("adc_bits", self.adc_bits.into(), 8.0, 16.0)? as u32) as f32;
        let hz = within("update_hz", self.update_hz, 50.0, 20e3)?;
        for noise in self.noise_codes {
            within("noise_codes", noise, 0.0, range / 10.0)?;
        }
        let pairs = within("pole_pairs", self.pole_pairs.into(), 1.0, 64.0)?;
        let inertia = within("inertia_kgm2", self.inertia_kgm2, 1e-9, 10.0)?;
        let damping = within("damping_nms", self.damping_nms, 0.0, 10.0)?;
        let per_nm = pairs / inertia;
        let noise = within("torque_noise_nm_rthz", self.torque_noise_nm_rthz, 1e-3 / per_nm, 1e5 / per_nm)? * per_nm;
        let names = ["drift.offset", "drift.amplitude", "drift.placement_deg", "drift.third"];
        let drift = spread(names, &self.drift, &even(0.0, 0.0), &even(1.0, 10.0))?;
        let names = ["start.offset", "start.amplitude", "start.placement_deg", "start.third"];
        let start = spread(names, &self.start, &even(0.0, 0.0), &even(0.5, 20.0))?;
        let names = ["limits.offset", "limits.amplitude", "limits.placement_deg", "limits.third"];
        let limits = spread(names, &self.limits, &self.start, &even(0.6, 25.0))?;
        let slowest = within("slowest_hz", self.slowest_hz, 0.05, hz / 10.0)?;
        Ok(Config {
            halls: self.halls,
            adc_bits: self.adc_bits,
            noise_codes: self.noise_codes,
            // A speed that dies within a sample is gone, not reversed.
            damping: (damping / inertia / hz).min(1.0),
            per_nm: per_nm / (hz * hz),
            acceleration: noise * noise / (hz * hz * hz),
            drift: drift.variances(1.0 / hz),
            start: start.variances(1.0),
            limits,
            slowest: TAU * slowest / hz,
            pause: hz as u32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Change = fn(&mut Settings);

    #[test]
    fn every_field_out_of_range_is_named() {
        let cases: [(&str, Change); 21] = [
            ("adc_bits", |s| s.adc_bits = 7),
            ("update_hz", |s| s.update_hz = 49.0),
            ("update_hz", |s| s.update_hz = f32::NAN),
            ("noise_codes", |s| s.noise_codes[1] = -1.0),
            ("noise_codes", |s| s.noise_codes[2] = f32::INFINITY),
            ("pole_pairs", |s| s.pole_pairs = 65),
            ("inertia_kgm2", |s| s.inertia_kgm2 = 0.0),
            ("damping_nms", |s| s.damping_nms = -1.0),
            ("torque_noise_nm_rthz", |s| s.torque_noise_nm_rthz = 0.0),
            ("torque_noise_nm_rthz", |s| s.torque_noise_nm_rthz = 1.0),
            ("drift.offset", |s| s.drift.offset = -0.1),
            ("drift.amplitude", |s| s.drift.amplitude = 1.1),
            ("drift.placement_deg", |s| s.drift.placement_deg = f32::NAN),
            ("drift.third", |s| s.drift.third = 2.0),
            ("start.offset", |s| s.start.offset = 0.51),
            ("start.placement_deg", |s| s.start.placement_deg = 21.0),
            ("limits.offset", |s| s.limits.offset = 0.001),
            ("limits.amplitude", |s| s.limits.amplitude = 0.7),
            ("limits.placement_deg", |s| s.limits.placement_deg = 26.0),
            ("limits.third", |s| s.limits.third = 0.0),
            ("slowest_hz", |s| s.slowest_hz = 101.0),
        ];
        for (field, change) in cases {
            let mut settings = Settings::default();
            change(&mut settings);
            assert_eq!(settings.validate().unwrap_err().field, field);
        }
    }

    #[test]
    fn the_default_is_valid_and_converts() {
        let config = Settings::default().validate().unwrap();
        assert!((config.damping / 0.016 - 1.0).abs() < 1e-5);
        // 4 / 1e-5 rad/s² for one N·m, at a millisecond.
        assert!((config.per_nm / 0.4 - 1.0).abs() < 1e-5);
        // 4 rad/s²/√Hz moves the speed by 4 · √0.001 rad/s, that is by 1.26e-4 rad/sample, in a sample.
        assert!((config.acceleration.sqrt() / 1.265e-4 - 1.0).abs() < 1e-3);
    }
}
