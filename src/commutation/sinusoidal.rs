//! Sinusoidal commutation: Simpkins and Todorov, eq. (8) and (9), with the errata.
//!
//! The sines are signed and duties are not, so the duties are centred at one half. The third phase is driven so that
//! the three always sum to the same; reversal is the complement, a negative amplitude.

use crate::angle::ElectricalAngle;
use crate::math::high;
use crate::pwm::Amplitude;
use crate::trig;

/// Direction from phase A to B to C along which a vector turns: forward, or with two phases exchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PhaseOrder(ElectricalAngle);

impl PhaseOrder {
    /// A, B, C.
    pub const FORWARD: Self = Self(ElectricalAngle::THIRD);
    /// A, C, B.
    pub const REVERSED: Self = Self(ElectricalAngle::from_bits(-ElectricalAngle::THIRD.to_bits()));

    /// Whether it is A, B, C.
    #[inline(always)]
    pub const fn is_forward(self) -> bool {
        self.0.to_bits() >= 0
    }
}

/// A voltage amplitude along and across the axis of phase A, as [`compare`] needs it: made when the command changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Axes {
    /// The amplitude.
    along: i32,
    /// √3 times the amplitude, with the sign of the order of the phases.
    across: i32,
    /// One half, and half a count for rounding.
    middle: i32,
    /// Three times that: what the three phases sum to.
    sum: i32,
}

/// Bits of the fraction of a count where sines and amplitudes have been multiplied.
const FRACTION: u32 = Amplitude::FRACTION - 2;

impl Axes {
    /// For a timer with `half` of its period as the middle.
    pub const fn new(amplitude: Amplitude, order: PhaseOrder, half: u16) -> Self {
        /// √3 in 2⁻³¹.
        const SQRT_3: i64 = 3_719_550_787;
        let along = amplitude.to_bits();
        let across = ((along as i64 * SQRT_3) >> 31) as i32;
        let middle = ((half as i32) << FRACTION) + (1 << (FRACTION - 1));
        Self { along, across: if order.is_forward() { across } else { -across }, middle, sum: 3 * middle }
    }
}

/// Compare values for a voltage vector at an angle.
///
/// Within 0.6 counts of the exact value; never outside the limits that the [`Amplitude`] was made for.
#[cfg_attr(not(feature = "small"), inline(always))]
#[cfg_attr(feature = "small", inline(never))]
pub const fn compare(vector: ElectricalAngle, axes: &Axes) -> [u16; 3] {
    let (sin, cos) = trig::sin_cos(vector);
    let a = axes.middle + high(axes.along, cos.to_bits());
    // Twice the mean of the other two, and their difference.
    let rest = axes.sum - a;
    let difference = high(axes.across, sin.to_bits());
    [
        (a >> FRACTION) as u16,
        ((rest + difference) >> (FRACTION + 1)) as u16,
        ((rest - difference) >> (FRACTION + 1)) as u16,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pwm::Limits;
    use core::f64::consts::TAU;

    extern crate std;

    fn for_all_angles(mut check: impl FnMut(ElectricalAngle, f64)) {
        for k in 0..1 << 16 {
            let angle = ElectricalAngle::from_bits((k as u32).wrapping_mul(65_537) as i32);
            check(angle, f64::from(angle.to_bits()) / 4_294_967_296.0 * TAU);
        }
    }

    #[test]
    fn follows_the_equations_to_a_count() {
        let half = 2048;
        let limits = Limits::new(4096, 0, 4096).unwrap();
        for modulation in [-1.0, -0.3, 0.01, 0.5, 0.97] {
            let amplitude = limits.amplitude(crate::commutation::Modulation::saturating_from_num(modulation));
            let exact = amplitude.to_counts();
            for_all_angles(|angle, radians| {
                for (order, sign) in [(PhaseOrder::FORWARD, 1.0), (PhaseOrder::REVERSED, -1.0)] {
                    let found = compare(angle, &Axes::new(amplitude, order, half));
                    for (k, &compare) in found.iter().enumerate() {
                        let ideal = 2048.0 + exact * (radians - sign * TAU * k as f64 / 3.0).cos();
                        let tolerance = 0.6;
                        assert!((f64::from(compare) - ideal).abs() < tolerance, "{modulation} {k} {compare} {ideal}");
                    }
                    assert!(found.iter().map(|&c| u32::from(c)).sum::<u32>().abs_diff(3 * 2048) <= 1);
                }
            });
        }
    }

    #[test]
    fn reversal_is_the_complement() {
        let limits = Limits::new(2125, 40, 2085).unwrap();
        let [forward, reversed] = [0.6, -0.6].map(|m| limits.amplitude(crate::commutation::Modulation::from_num(m)));
        for_all_angles(|angle, _| {
            let a = compare(angle, &Axes::new(forward, PhaseOrder::FORWARD, limits.half()));
            let b = compare(angle, &Axes::new(reversed, PhaseOrder::FORWARD, limits.half()));
            for k in 0..3 {
                let sum = i32::from(a[k]) + i32::from(b[k]) - 2 * i32::from(limits.half());
                assert!(sum.abs() <= 2, "{sum}");
            }
        });
    }

    #[test]
    fn never_leaves_the_limits() {
        for (period, low, high) in [(2125, 40, 2085), (2125, 0, 2125), (100, 10, 80), (65_535, 1000, 65_000)] {
            let limits = Limits::new(period, low, high).unwrap();
            for modulation in [crate::commutation::Modulation::MIN, crate::commutation::Modulation::MAX] {
                let amplitude = limits.amplitude(modulation);
                for_all_angles(|angle, _| {
                    for c in compare(angle, &Axes::new(amplitude, PhaseOrder::FORWARD, limits.half())) {
                        assert!((low..=high).contains(&c), "{low} {c} {high}");
                    }
                });
            }
        }
    }
}
