//! Space-vector modulation by min/max centring, the voltage limit as a circle, and what the dead time takes.
//!
//! The star point is free, so the three compare values are moved together until the highest and the lowest lie
//! symmetrically in the allowed range. That makes 2/√3 of the amplitude of centred sines possible, the circle inside
//! the hexagon of space vectors.

use crate::commutation::frames::{AlphaBeta, Dq, inverse_clarke};
use crate::pwm::Limits;

/// Bits of the fraction of a voltage or a compare value.
pub const FRACTION: u32 = 8;

/// Compare values of a vector in 2⁻⁸ counts, to which each phase's `correction` in 2⁻⁸ counts is added, see
/// [`dead_time`]. Within one count of the exact value where that is within the limits, and never outside them,
/// whatever the vector.
#[inline(always)]
pub const fn compare(vector: AlphaBeta, correction: [i32; 3], limits: &Limits) -> [u16; 3] {
    let [a, b, c] = inverse_clarke(vector);
    let (a, b, c) = (a + correction[0], b + correction[1], c + correction[2]);
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    let low = if c < low { c } else { low };
    let high = if c > high { c } else { high };
    let shift = limits.middle(FRACTION) - ((low + high) >> 1);
    [
        limits.clamped((a + shift) >> FRACTION),
        limits.clamped((b + shift) >> FRACTION),
        limits.clamped((c + shift) >> FRACTION),
    ]
}

/// A vector cut to a circle, its direction kept; `radius` is 0 to 2¹⁵ and the components are from −2²⁰ to 2²⁰. The
/// length of the result is at most `radius` · (1 + 6e-5) + 1.5; a component beyond the circle is cut to it first.
#[inline(always)]
pub const fn within_circle(vector: Dq, radius: i32) -> Dq {
    let d = clamp(vector.d, radius);
    let q = clamp(vector.q, radius);
    let square = (d * d) as u32 + (q * q) as u32;
    let most = (radius * radius) as u32;
    if square <= most {
        return Dq { d, q };
    }
    // From a half to one, in 2⁻¹⁵: the square is at most twice the most, and its leading one makes the divisor positive.
    let shift = square.leading_zeros();
    let ratio = (most << shift) / (((square << shift) >> 15) + 1);
    // Rounding may have gone below a half.
    let ratio = if ratio < 1 << 14 { 1 << 14 } else { ratio };
    let [start, slope] = SQUARE_ROOT[((ratio >> 9) & 31) as usize];
    let factor = start + ((slope * (ratio & 511) as i32) >> 16);
    Dq { d: (d * factor) >> 15, q: (q * factor) >> 15 }
}

#[inline(always)]
const fn clamp(x: i32, most: i32) -> i32 {
    if x > most {
        most
    } else if x < -most {
        -most
    } else {
        x
    }
}

/// What to add to a compare value so that a current flows as if there were no dead time, in the unit of `most`, which
/// is half of the dead time's counts: with the sign of the current, and in proportion to it below `ramp`, where the
/// terminal floats for part of the dead time. `slope` is `most` · 2¹⁶ / `ramp`.
#[inline(always)]
pub const fn dead_time(current: i32, slope: i32, most: i32) -> i32 {
    clamp(((current as i64 * slope as i64) >> 16) as i32, most)
}

/// Square root in 2⁻¹⁵ from ½ to 1 in 32 segments of 512 steps: start, and slope in 2⁻¹⁶.
static SQUARE_ROOT: [[i32; 2]; 32] = {
    let mut table = [[0; 2]; 32];
    let mut index = 0;
    while index < 32 {
        let (start, end) = (root(32 + index as i64), root(33 + index as i64));
        table[index] = [start as i32, ((end - start) * 128) as i32];
        index += 1;
    }
    table
};

/// √(`sixtyfourths` / 64) in 2⁻¹⁵, rounded down.
const fn root(sixtyfourths: i64) -> i64 {
    let square = sixtyfourths << 24;
    let mut root = 1 << 15;
    while root * root > square {
        root = (root + square / root) / 2;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    extern crate std;

    #[test]
    fn the_line_voltages_are_the_vectors_and_the_range_is_used_evenly() {
        let limits = Limits::new(2125, 0, 1997).unwrap();
        let longest = limits.longest_vector();
        for tenth in 0..3600 {
            for share in [0.01, 0.5, 1.0] {
                let length = share * longest * 256.0;
                let angle = f64::from(tenth) / 3600.0 * TAU;
                let vector =
                    AlphaBeta { alpha: (length * libm::cos(angle)) as i32, beta: (length * libm::sin(angle)) as i32 };
                let compare = compare(vector, [0; 3], &limits).map(f64::from);
                for (k, next) in [(0, 1), (1, 2), (2, 0)] {
                    let phase = |k: usize| length / 256.0 * libm::cos(angle - k as f64 / 3.0 * TAU);
                    let exact = phase(k) - phase(next);
                    assert!((compare[k] - compare[next] - exact).abs() <= 1.1, "{tenth} {share}");
                }
                let high = compare.iter().copied().fold(0.0, f64::max);
                let low = compare.iter().copied().fold(1e9, f64::min);
                assert!((high + low - 1997.0).abs() <= 2.0, "{compare:?}");
            }
        }
    }

    #[test]
    fn a_full_vector_is_two_over_root_three_of_centred_sines() {
        let limits = Limits::new(2000, 0, 2000).unwrap();
        let ratio = limits.longest_vector() / 1000.0;
        assert!((ratio - 2.0 / 3.0_f64.sqrt()).abs() < 0.004, "{ratio}");
    }

    proptest! {
        #[test]
        fn no_input_leaves_the_limits(
            period in 64..=65_535_u16, low in 0..=20_u16, window in 0..=20_u16,
            alpha in -(1 << 28)..(1 << 28), beta in -(1 << 28)..(1 << 28), correction in -50_000..50_000,
        ) {
            let limits = Limits::new(period, low, period - window).unwrap();
            let vector = AlphaBeta { alpha, beta };
            for compare in compare(vector, [correction, -correction, correction / 2], &limits) {
                prop_assert!((low..=period - window).contains(&compare));
            }
        }
    }

    #[test]
    fn the_circle_keeps_the_direction() {
        for radius in [0, 1, 100, 5000, 18_000, 32_768] {
            for degree in 0..360 {
                for share in [0.2, 0.99, 1.01, 1.2, 1.4, 5.0, 30.0] {
                    let length = share * f64::from(radius);
                    let angle = f64::from(degree) / 360.0 * TAU;
                    let vector = Dq { d: (length * libm::cos(angle)) as i32, q: (length * libm::sin(angle)) as i32 };
                    let cut = within_circle(vector, radius);
                    let found = libm::hypot(f64::from(cut.d), f64::from(cut.q));
                    assert!(found <= f64::from(radius) * (1.0 + 6e-5) + 1.5, "{radius} {degree} {share} {found}");
                    if share < 1.0 {
                        assert_eq!(cut, vector);
                    } else if share < 1.01 && radius >= 5000 {
                        // Cut along the direction: nothing of the length is given away.
                        assert!(found >= f64::from(radius) * (1.0 - 1.5e-4) - 2.0, "{radius} {degree} {share} {found}");
                        let cross = f64::from(cut.d) * libm::sin(angle) - f64::from(cut.q) * libm::cos(angle);
                        assert!(cross.abs() <= 3.0, "{cross}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_dead_time_is_given_back_with_the_sign_of_the_current() {
        let (most, ramp) = (42 << 8, 100);
        let slope = (most << 16) / ramp;
        assert_eq!([-5000, -101, 0, 101, 5000].map(|i| dead_time(i, slope, most)), [-most, -most, 0, most, most]);
        assert!((dead_time(50, slope, most) - most / 2).abs() <= 1);
    }
}
