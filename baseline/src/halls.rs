//! The angle of Simpkins and Todorov, eq. (2) and (4) to (6), with the errata: the baseline of
//! [`hallservo::hall::estimate`].
//!
//! The arcsine of one signal is ambiguous and steepens without bound at the peaks, where it amplifies noise; and a
//! signal beyond ±1 has none. That is in the method, so it stays.

use fixed::types::{I2F30, I4F28};
use hallservo::angle::ElectricalAngle;
use hallservo::hall::Channel;
use hallservo::hall::plausibility::{Implausible, Window};
use hallservo::trig;

/// A normalised signal: ±1 at the calibrated minimum and maximum.
pub type Signal = I4F28;

/// Normalises the codes of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
        let gain = (f64::from(1_u32 << Signal::FRAC_NBITS) / f64::from(amplitude)).round();
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
/// Arcsine of a signal; beyond ±1 it stays at ±90°.
fn arcsine(signal: Signal) -> ElectricalAngle {
    trig::asin(I2F30::saturating_from_num(signal))
}

/// Eq. (5), (6): the Hall angle from the first sensor alone. The second, at the given placement 0° < ψ < 180°, only
/// decides the quadrant: on the rising half of the first sensor's wave it is below its value at the other candidate.
pub fn single_sensor(first: Signal, second: Signal, placement: ElectricalAngle) -> ElectricalAngle {
    resolve(first, |candidate| {
        let expected = trig::sin(candidate - placement);
        distance(second, expected)
    })
}

/// Eq. (4): the mean of the three arcsines, each in the quadrant that fits the other two signals best.
pub fn three_sensors(signals: [Signal; 3], placements: [ElectricalAngle; 3]) -> ElectricalAngle {
    let angle_of = |own: usize| {
        let rising = resolve(signals[own], |candidate| {
            let hall = candidate + placements[own];
            (0..3).map(|other| distance(signals[other], trig::sin(hall - placements[other]))).sum()
        });
        rising + placements[own]
    };
    let first = angle_of(0);
    // Mean of the differences, for the mean of angles is not defined across the wrap.
    let rest: i64 = [1, 2].map(|own| i64::from((angle_of(own) - first).to_bits())).iter().sum();
    first + ElectricalAngle::from_bits((rest / 3) as i32)
}

/// The arcsine, or 180° less it: whichever has the smaller cost.
fn resolve(signal: Signal, cost: impl Fn(ElectricalAngle) -> i64) -> ElectricalAngle {
    let rising = arcsine(signal);
    let falling = ElectricalAngle::HALF - rising;
    if cost(rising) <= cost(falling) { rising } else { falling }
}

/// How far a signal is from an expected one.
fn distance(signal: Signal, expected: I2F30) -> i64 {
    (i64::from(signal.to_bits()) - i64::from(expected.to_bits() >> 2)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hallservo::hall::plausibility::PLAUSIBLE;

    /// Ideal signals all around, at spacings of 60° and 120° in either order.
    fn worst_error(estimate: impl Fn([Signal; 3], [ElectricalAngle; 3]) -> ElectricalAngle) -> f32 {
        let mut worst = 0.0_f32;
        for spacing in [60.0, 120.0, -60.0, -120.0] {
            let placements = [0.0, spacing, 2.0 * spacing].map(ElectricalAngle::from_degrees);
            for k in 0..3600 {
                let hall = ElectricalAngle::from_degrees(k as f32 / 10.0);
                let signals = placements.map(|placement| Signal::from_num(trig::sin(hall - placement)));
                worst = worst.max((estimate(signals, placements) - hall).to_degrees().abs());
            }
        }
        worst
    }

    #[test]
    fn single_sensor_finds_ideal_angles() {
        // The error at the peaks is that of the sine table, 4e-5, under the square root: √(2 · 4e-5) rad = 0.51°.
        let worst = worst_error(|signals, placements| single_sensor(signals[0], signals[1], placements[1]));
        assert!(worst < 0.52, "{worst}");
    }

    #[test]
    fn three_sensors_find_ideal_angles() {
        let worst = worst_error(three_sensors);
        assert!(worst < 0.2, "{worst}");
    }

    #[test]
    fn signals_beyond_one_stay_at_the_peak() {
        let beyond = Signal::from_num(1.3);
        let angle = single_sensor(beyond, Signal::from_num(-0.5), ElectricalAngle::THIRD);
        assert_eq!(angle, ElectricalAngle::QUARTER);
    }

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
