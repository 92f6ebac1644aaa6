//! Clarke and Park transforms and their inverses, amplitude-invariant, in integers.
//!
//! Three phases that sum to zero are a vector: α along the axis of phase A, β a quarter turn ahead. Seen from the
//! rotor, d is along its north pole and q a quarter turn ahead. The length of the vector is the amplitude of the
//! phases. All components are in a unit of the caller's and up to 2²⁸.

use crate::math::high;
use crate::trig;
use fixed::types::I2F30;

/// A vector in the frame of the stator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AlphaBeta {
    /// Along the axis of phase A.
    pub alpha: i32,
    /// A quarter turn ahead.
    pub beta: i32,
}

impl AlphaBeta {
    /// Square of the length of one as [`Clarke::of`] makes it, in 2⁻³⁰ of the full scale's.
    #[inline(always)]
    pub(crate) const fn square(self) -> i32 {
        let (alpha, beta) = (self.alpha >> 15, self.beta >> 15);
        let square = alpha.wrapping_mul(alpha).wrapping_add(beta.wrapping_mul(beta));
        // Codes of more bits than the settings have reach anywhere.
        if square < 0 { i32::MAX } else { square }
    }
}

/// A vector in the frame of the rotor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Dq {
    /// Along the north pole: adds to the rotor's field.
    pub d: i32,
    /// A quarter turn ahead: makes the torque.
    pub q: i32,
}

impl Dq {
    /// Nothing.
    pub(crate) const ZERO: Self = Self { d: 0, q: 0 };
}

/// Sine and cosine of the electrical angle of a rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rotation {
    sin: I2F30,
    cos: I2F30,
}

/// From the codes of three current amplifiers to a vector: what they have in common is taken off, and each amplifier's
/// zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Clarke {
    /// Gain and bias of α and of β.
    along: [i32; 2],
    across: [i32; 2],
}

impl Clarke {
    /// For codes of which 2¹⁵ · 2^−`shift` are 2³⁰, with the amplifiers' zeros in 2⁻⁸ · 2^−`shift` codes; phases B and
    /// C exchanged if the motor is `reversed`.
    pub const fn new(shift: u32, zeros: [i32; 3], reversed: bool) -> Self {
        /// 2¹⁵/3 and 2¹⁵/√3 with a shift of 8.
        const THIRD: i32 = 2_796_203;
        const INVERSE_SQRT_3: i32 = 4_843_165;
        let (along, across) = ((THIRD >> (8 - shift)), (INVERSE_SQRT_3 >> (8 - shift)));
        let across = if reversed { -across } else { across };
        let [a, b, c] = zeros;
        Self { along: [along, bias(2 * a - b - c, along, shift)], across: [across, bias(b - c, across, shift)] }
    }

    /// The vector. Within 1e-4 of its length, codes taken for exact.
    #[inline(always)]
    pub const fn of(&self, [a, b, c]: [u16; 3]) -> AlphaBeta {
        let (a, b, c) = (a as i32, b as i32, c as i32);
        AlphaBeta {
            alpha: self.along[1].wrapping_add((2 * a - b - c).wrapping_mul(self.along[0])),
            beta: self.across[1].wrapping_add((b - c).wrapping_mul(self.across[0])),
        }
    }
}

const fn bias(zero: i32, gain: i32, shift: u32) -> i32 {
    (-(zero as i64 * gain as i64) >> (8 + shift)) as i32
}

/// From a vector to half of the three phases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct InverseClarke(i32);

impl InverseClarke {
    /// With phases B and C exchanged if the motor is `reversed`.
    pub const fn new(reversed: bool) -> Self {
        /// √3/2 in 2⁻³¹, which halves what it multiplies.
        const HALF_SQRT_3: i32 = 1_859_775_393;
        Self(if reversed { -HALF_SQRT_3 } else { HALF_SQRT_3 })
    }

    /// Whether phases B and C are exchanged.
    pub const fn is_reversed(self) -> bool {
        self.0 < 0
    }

    /// Half of the phases; they sum to zero, but for a rounding of 2. Within 2 of the exact value.
    #[inline(always)]
    pub const fn of(self, vector: AlphaBeta) -> [i32; 3] {
        let along = vector.alpha >> 1;
        let (half, across) = (along >> 1, high(vector.beta, self.0));
        [along, across - half, -across - half]
    }

    /// The same for the vector a quarter turn ahead of this one; the first phase has the wrong sign.
    #[inline(always)]
    pub(crate) const fn of_ahead(self, vector: AlphaBeta) -> [i32; 3] {
        let along = vector.beta >> 1;
        let (half, across) = (along >> 1, high(vector.alpha, self.0));
        [along, across + half, half - across]
    }
}

impl Rotation {
    /// For a rotor at an angle, with the error of [`trig::sin`].
    #[inline(always)]
    pub const fn at(angle: crate::angle::ElectricalAngle) -> Self {
        let (sin, cos) = trig::sin_cos(angle);
        Self { sin, cos }
    }

    /// The same for tasks.
    pub(crate) const fn of_tasks(angle: crate::angle::ElectricalAngle) -> Self {
        let (sin, cos) = trig::sin_cos_of_tasks(angle);
        Self { sin, cos }
    }

    /// Park: a quarter of what the rotor sees of a vector. Within 2 + 1.5e-5 of the vector's length.
    #[inline(always)]
    pub const fn park(self, vector: AlphaBeta) -> Dq {
        let (sin, cos) = (self.sin.to_bits(), self.cos.to_bits());
        Dq { d: high(vector.alpha, cos) + high(vector.beta, sin), q: high(vector.beta, cos) - high(vector.alpha, sin) }
    }

    /// Inverse Park: a quarter of the vector, with the error of [`Self::park`].
    #[inline(always)]
    pub const fn inverse_park(self, vector: Dq) -> AlphaBeta {
        let (sin, cos) = (self.sin.to_bits(), self.cos.to_bits());
        AlphaBeta { alpha: high(vector.d, cos) - high(vector.q, sin), beta: high(vector.q, cos) + high(vector.d, sin) }
    }

    /// The same for a vector along d.
    #[inline(always)]
    pub const fn inverse_park_d(self, d: i32) -> AlphaBeta {
        AlphaBeta { alpha: high(d, self.cos.to_bits()), beta: high(d, self.sin.to_bits()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::ElectricalAngle;
    use core::f64::consts::TAU;

    fn vectors() -> impl Iterator<Item = (f64, f64)> {
        [3.0, 1000.0, 32_768.0, 2.0e6, 2.6e8]
            .into_iter()
            .flat_map(|length| (0..360).map(move |degree| (length, f64::from(degree) / 360.0 * TAU)))
    }

    fn sines(length: f64, angle: f64) -> [f64; 3] {
        [0.0, 1.0, 2.0].map(|k| length * libm::cos(angle - k / 3.0 * TAU))
    }

    #[test]
    fn clarke_takes_off_the_zeros_and_what_is_common() {
        for (shift, reversed) in [(4, false), (4, true), (0, false), (8, false)] {
            let middle = f64::from(1 << (15 - shift));
            let zeros = [100, -70, 33].map(|off: i32| 32_768 * 256 + off * 256);
            let clarke = Clarke::new(shift, zeros, reversed);
            for k in 0..360 {
                let angle = f64::from(k) / 360.0 * TAU;
                let phases = sines(0.9 * middle, angle);
                for common in [0.0, 0.05 * middle] {
                    let codes = [0, 1, 2].map(|k| {
                        let zero = f64::from(zeros[k]) / 256.0 / f64::from(1 << shift);
                        libm::round(zero + phases[k] + common) as u16
                    });
                    let found = clarke.of(codes);
                    let unit = 1_073_741_824.0 / middle;
                    let exact = [libm::cos(angle), libm::sin(angle) * if reversed { -1.0 } else { 1.0 }]
                        .map(|x| x * 0.9 * middle * unit);
                    // Rounding of the codes, and of the gains.
                    let bound = unit + 1e-4 * 1_073_741_824.0;
                    assert!((f64::from(found.alpha) - exact[0]).abs() <= bound, "{shift} {k} {found:?} {exact:?}");
                    assert!((f64::from(found.beta) - exact[1]).abs() <= bound, "{shift} {k} {found:?} {exact:?}");
                }
            }
        }
    }

    #[test]
    fn inverse_clarke_halves_within_two_and_sums_to_nothing() {
        for (length, angle) in vectors() {
            for (reversed, sign) in [(false, 1.0), (true, -1.0)] {
                let inverse = InverseClarke::new(reversed);
                let at = |angle: f64| AlphaBeta {
                    alpha: (length * libm::cos(angle)) as i32,
                    beta: (length * libm::sin(angle)) as i32,
                };
                let vector = at(angle);
                let (alpha, beta) = (f64::from(vector.alpha), sign * f64::from(vector.beta) * libm::sqrt(0.75));
                let exact = [alpha, beta - alpha / 2.0, -beta - alpha / 2.0].map(|x| x / 2.0);
                let phases = inverse.of(vector);
                for (phase, exact) in phases.into_iter().zip(exact) {
                    assert!((f64::from(phase) - exact).abs() <= 2.0 + length / 1e9, "{length} {angle}");
                }
                assert!(phases.iter().sum::<i32>().abs() <= 2);
                let [a, b, c] = inverse.of_ahead(vector);
                let ahead = inverse.of(AlphaBeta { alpha: -vector.beta, beta: vector.alpha });
                for (found, exact) in [-a, b, c].into_iter().zip(ahead) {
                    assert!((found - exact).abs() <= 3, "{length} {angle}");
                }
            }
        }
    }

    #[test]
    fn park_turns_by_the_angle_and_back() {
        for (length, angle) in vectors() {
            let vector =
                AlphaBeta { alpha: (length * libm::cos(angle)) as i32, beta: (length * libm::sin(angle)) as i32 };
            for k in 0..257_u32 {
                let rotor = ElectricalAngle::from_bits(k.wrapping_mul(0x9E37_79B9) as i32);
                let turns = f64::from(rotor.to_bits()) / 4_294_967_296.0;
                let (sin, cos) = libm::sincos(turns * TAU);
                let (alpha, beta) = (f64::from(vector.alpha), f64::from(vector.beta));
                let bound = 2.0 + 1.5e-5 * length;
                let rotation = Rotation::at(rotor);
                let seen = rotation.park(vector);
                assert!((f64::from(seen.d) - (alpha * cos + beta * sin) / 4.0).abs() <= bound);
                assert!((f64::from(seen.q) - (beta * cos - alpha * sin) / 4.0).abs() <= bound);
                let back = rotation.inverse_park(seen);
                assert!((f64::from(back.alpha) - alpha / 16.0).abs() <= 2.0 * bound);
                assert!((f64::from(back.beta) - beta / 16.0).abs() <= 2.0 * bound);
                let along = rotation.inverse_park_d(vector.alpha);
                let full = rotation.inverse_park(Dq { d: vector.alpha, q: 0 });
                assert!((along.alpha - full.alpha).abs() <= 1 && (along.beta - full.beta).abs() <= 1);
            }
        }
    }

    #[test]
    fn a_field_a_quarter_turn_ahead_is_all_torque() {
        let rotor = ElectricalAngle::from_degrees(33.0);
        let codes = sines(10_000.0, (33.0 + 90.0) / 360.0 * TAU).map(|x| (32_768.0 + x) as u16);
        let seen = Rotation::at(rotor).park(Clarke::new(0, [32_768 * 256; 3], false).of(codes));
        assert!((seen.d >> 13).abs() <= 3 && ((seen.q >> 13) - 10_000).abs() <= 3, "{seen:?}");
    }
}
