//! Clarke and Park transforms and their inverses, amplitude-invariant, in integers.
//!
//! Three phases that sum to zero are a vector: α along the axis of phase A, β a quarter turn ahead. Seen from the rotor, d is along
//! its north pole and q a quarter turn ahead. The length of the vector is the amplitude of the phases. All components are
//! in a unit of the caller's and up to 2²⁸.

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

/// A vector in the frame of the rotor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Dq {
    /// Along the north pole: adds to the rotor's field.
    pub d: i32,
    /// A quarter turn ahead: makes the torque.
    pub q: i32,
}

/// Sine and cosine of the electrical angle of a rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rotation {
    sin: I2F30,
    cos: I2F30,
}

/// The vector of three phases; what they have in common is taken off. Within 1 of the exact value.
#[inline(always)]
pub const fn clarke([a, b, c]: [i32; 3]) -> AlphaBeta {
    /// 2³²/3 and 2³¹/√3.
    const THIRD: i32 = 1_431_655_765;
    const INVERSE_SQRT_3: i32 = 1_239_850_262;
    AlphaBeta { alpha: high(2 * a - b - c, THIRD), beta: high(2 * (b - c), INVERSE_SQRT_3) }
}

/// The three phases of a vector; they sum to zero, but for a rounding of 1. Within 1.5 of the exact value.
#[inline(always)]
pub const fn inverse_clarke(vector: AlphaBeta) -> [i32; 3] {
    /// √3/2 in 2⁻³¹, which halves what it multiplies.
    const HALF_SQRT_3: i32 = 1_859_775_393;
    let half = vector.alpha >> 1;
    let across = high(2 * vector.beta, HALF_SQRT_3);
    [vector.alpha, across - half, -across - half]
}

impl Rotation {
    /// For a rotor at an angle, with the error of [`trig::sin`].
    #[inline(always)]
    pub const fn at(angle: crate::angle::ElectricalAngle) -> Self {
        let (sin, cos) = trig::sin_cos(angle);
        Self { sin, cos }
    }

    /// Park: what the rotor sees of a vector. Within 1 + 5.7e-5 of its length.
    #[inline(always)]
    pub const fn park(self, vector: AlphaBeta) -> Dq {
        let (sin, cos) = (self.sin.to_bits(), self.cos.to_bits());
        Dq {
            d: sum_of_products(vector.alpha, cos, vector.beta, sin),
            q: sum_of_products(vector.beta, cos, -vector.alpha, sin),
        }
    }

    /// Inverse Park, with the error of [`Self::park`].
    #[inline(always)]
    pub const fn inverse_park(self, vector: Dq) -> AlphaBeta {
        let (sin, cos) = (self.sin.to_bits(), self.cos.to_bits());
        AlphaBeta {
            alpha: sum_of_products(vector.d, cos, -vector.q, sin),
            beta: sum_of_products(vector.q, cos, vector.d, sin),
        }
    }
}

/// Upper half of a product.
#[inline(always)]
const fn high(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// `a · x + b · y` with x and y in 2⁻³⁰.
#[inline(always)]
const fn sum_of_products(a: i32, x: i32, b: i32, y: i32) -> i32 {
    ((a as i64 * x as i64 + b as i64 * y as i64) >> 30) as i32
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
    fn clarke_is_within_one_and_forgets_what_is_common() {
        for (length, angle) in vectors() {
            for common in [-1000, 0, 77] {
                let phases = sines(length, angle).map(|x| libm::round(x) as i32);
                let exact = [
                    f64::from(2 * phases[0] - phases[1] - phases[2]) / 3.0,
                    f64::from(phases[1] - phases[2]) / libm::sqrt(3.0),
                ];
                let vector = clarke(phases.map(|x| x + common));
                // The constants have 31 bits, which shows at the largest.
                let bound = 1.0 + length / 1e9;
                assert!((f64::from(vector.alpha) - exact[0]).abs() <= bound, "{length} {angle}");
                assert!((f64::from(vector.beta) - exact[1]).abs() <= bound, "{length} {angle}");
            }
        }
    }

    #[test]
    fn inverse_clarke_is_within_one_and_a_half_and_sums_to_nothing() {
        for (length, angle) in vectors() {
            let vector =
                AlphaBeta { alpha: (length * libm::cos(angle)) as i32, beta: (length * libm::sin(angle)) as i32 };
            let (alpha, beta) = (f64::from(vector.alpha), f64::from(vector.beta) * libm::sqrt(0.75));
            let phases = inverse_clarke(vector);
            for (phase, exact) in phases.into_iter().zip([alpha, beta - alpha / 2.0, -beta - alpha / 2.0]) {
                assert!((f64::from(phase) - exact).abs() <= 1.5 + length / 1e9, "{length} {angle}");
            }
            assert!(phases.iter().sum::<i32>().abs() <= 1);
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
                let bound = 1.0 + 5.7e-5 * length;
                let rotation = Rotation::at(rotor);
                let seen = rotation.park(vector);
                assert!((f64::from(seen.d) - (alpha * cos + beta * sin)).abs() <= bound);
                assert!((f64::from(seen.q) - (beta * cos - alpha * sin)).abs() <= bound);
                let back = rotation.inverse_park(seen);
                assert!((f64::from(back.alpha) - alpha).abs() <= 2.0 * bound);
                assert!((f64::from(back.beta) - beta).abs() <= 2.0 * bound);
            }
        }
    }

    #[test]
    fn a_field_a_quarter_turn_ahead_is_all_torque() {
        let rotor = ElectricalAngle::from_degrees(33.0);
        let field = sines(10_000.0, (33.0 + 90.0) / 360.0 * TAU).map(|x| x as i32);
        let seen = Rotation::at(rotor).park(clarke(field));
        assert!(seen.d.abs() <= 3 && (seen.q - 10_000).abs() <= 3, "{seen:?}");
    }
}
