//! What tasks compute in floating point, in less flash with the feature `small` than libm takes.

use core::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// The square root, rounded to nearest: the same bits on every chip and computer. With the feature `small` digit by
/// digit, as tasks need some a second only, and libm's table and code are 316 bytes more.
pub fn root(x: f32) -> f32 {
    if cfg!(feature = "small") { digit_by_digit(x) } else { libm::sqrtf(x) }
}

/// Two bits of the number give one of the root.
#[cfg_attr(feature = "small", inline(never))]
fn digit_by_digit(x: f32) -> f32 {
    if !(x > 0.0 && x < f32::INFINITY) {
        // Zeros and infinity are their own roots; a negative number has none.
        return if x < 0.0 { f32::NAN } else { x };
    }
    if x < f32::MIN_POSITIVE {
        // By a power of two, which is exact, it has a leading one.
        return digit_by_digit(x * 16_777_216.0) / 4096.0;
    }
    let exponent = (x.to_bits() >> 23).wrapping_sub(127);
    let mut rest = (x.to_bits() & 0x007F_FFFF | 0x0080_0000) << (1 + (exponent & 1));
    let (mut root, mut doubled, mut digit) = (0, 0, 1 << 24);
    while digit != 0 {
        let tried = doubled + digit;
        if tried <= rest {
            doubled = tried + digit;
            rest -= tried;
            root += digit;
        }
        rest <<= 1;
        digit >>= 1;
    }
    // One digit more than a float holds rounds it; a root is never in the middle between two.
    f32::from_bits(
        ((root + (root & 1)) >> 1).wrapping_add(0x3F00_0000).wrapping_add(((exponent as i32) >> 1 << 23) as u32),
    )
}

/// The angle of a vector in radians, −π to π; 0 of none. With the feature `small` within 5·10⁻⁷ of libm's, which takes
/// 412 bytes more.
pub fn atan2(y: f32, x: f32) -> f32 {
    if cfg!(feature = "small") { short_atan2(y, x) } else { libm::atan2f(y, x) }
}

/// The smaller over the larger component, folded once more, and a polynomial: that of `atanf` in Moshier's Cephes.
#[cfg_attr(feature = "small", inline(never))]
fn short_atan2(y: f32, x: f32) -> f32 {
    let (high, wide) = (libm::fabsf(y), libm::fabsf(x));
    let (less, more) = if high > wide { (wide, high) } else { (high, wide) };
    // Not a number stays one; without a vector the quotient would be none, too.
    let ratio = if more == 0.0 { 0.0 } else { less / more };
    let folds = ratio > 0.414_213_57;
    let (base, ratio) = if folds { (FRAC_PI_4, (ratio - 1.0) / (ratio + 1.0)) } else { (0.0, ratio) };
    let square = ratio * ratio;
    let series = ((0.080_537_446 * square - 0.138_776_86) * square + 0.199_777_11) * square - 0.333_329_5;
    let acute = base + (series * square * ratio + ratio);
    let upper = if high > wide { FRAC_PI_2 - acute } else { acute };
    let upper = if x < 0.0 { PI - upper } else { upper };
    if y < 0.0 { -upper } else { upper }
}

/// The least whole number that is not less: libm's, shorter.
#[inline(never)]
pub fn ceil(x: f32) -> f32 {
    // From here on every number is whole; not a number stays one.
    if !(libm::fabsf(x) < 8_388_608.0) {
        return x;
    }
    let whole = x as i32 as f32;
    if whole < x { whole + 1.0 } else { whole }
}

/// The largest whole number that is not more.
#[inline(always)]
pub fn floor(x: f32) -> f32 {
    -ceil(-x)
}

/// The nearest whole number, away from zero in the middle between two, or the nearest `i32`; 0 of what is not a number. One
/// copy: libm's `roundf` would be inlined in many places.
#[inline(never)]
pub fn nearest(x: f32) -> i32 {
    // With a half, the number below it would be one. From 2²³ on, where all are whole, so little changes nothing.
    (x + libm::copysignf(0.499_999_97, x)) as i32
}

/// Cut to ± a limit; not a number stays one.
#[inline(never)]
pub fn cut(x: f32, limit: f32) -> f32 {
    if x > limit {
        limit
    } else if x < -limit {
        -limit
    } else {
        x
    }
}

/// One with the sign of a number: `signum` without a look at whether it is one.
#[inline(always)]
pub fn sign_of(x: f32) -> f32 {
    libm::copysignf(1.0, x)
}

/// The largest power of two that is not more than the magnitude, as its exponent; −127 of what is below all normal
/// numbers.
#[inline(always)]
pub const fn exponent(x: f32) -> i32 {
    ((x.to_bits() >> 23) & 0xFF) as i32 - 127
}

/// Without its fraction, as an integer of 64 bits, within ± `i64::MAX`; 0 of what is not a number. Shorter than the
/// compiler's.
#[inline(never)]
pub fn whole(x: f32) -> i64 {
    const HALF: f32 = 4_294_967_296.0;
    let magnitude = libm::fabsf(x);
    let high = (magnitude / HALF) as i32;
    let whole = (i64::from(high) << 32) + i64::from((magnitude - high as f32 * HALF) as u32);
    if x < 0.0 { -whole } else { whole }
}

/// Without its fraction, as the nearest integer of 16 bits without a sign; 0 of what is not a number. The core converts to 32
/// bits only, and the compiler compares with either end at each place: one copy, by integers.
#[inline(never)]
pub fn whole_u16(x: f32) -> u16 {
    (x as u32).min(u16::MAX.into()) as u16
}

/// The same with a sign.
#[inline(never)]
pub fn whole_i16(x: f32) -> i16 {
    (x as i32).clamp(i16::MIN.into(), i16::MAX.into()) as i16
}

/// A power of two of a normal number's exponent, −126 to 127.
#[inline(always)]
pub const fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((127 + exponent) as u32) << 23)
}

/// The natural logarithm of a positive normal number, within 1.5e-6, or as much of its value; of zero minus infinity. 124
/// bytes of flash less than libm's.
#[inline(never)]
pub fn ln(x: f32) -> f32 {
    const HALF_ROOT: u32 = 0x3F35_04F3;
    if x <= 0.0 {
        return f32::NEG_INFINITY;
    }
    // A power of two, and a factor of √½ to √2, of which the series has few terms.
    let above = x.to_bits().wrapping_sub(HALF_ROOT);
    let factor = f32::from_bits((above & 0x007F_FFFF) + HALF_ROOT);
    let part = (factor - 1.0) / (factor + 1.0);
    let square = part * part;
    let series = 2.0 * part * (1.0 + square * (1.0 / 3.0 + square / 5.0));
    (above as i32 >> 23) as f32 * core::f32::consts::LN_2 + series
}

/// The exponential function of −10 to 10, within 5e-4 of its value, as (1 + x/n)ⁿ with the next term: in a tenth of the
/// flash of libm's.
#[inline(never)]
pub fn exp(x: f32) -> f32 {
    const SQUARINGS: i32 = 10;
    let part = x / (1 << SQUARINGS) as f32;
    (0..SQUARINGS).fold(1.0 + part * (1.0 + part / 2.0), |power, _| power * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_libms() {
        let all = (0..u32::MAX / 4093).map(|k| f32::from_bits(k * 4093));
        let seams = [0.5_f32, 1.5, 8_388_607.5, 8_388_608.0, 8_388_609.0, 16_777_217.0, 2_147_483_648.0, f32::INFINITY];
        let around = seams.into_iter().flat_map(|x| [x.next_down(), x, x.next_up()]).flat_map(|x| [x, -x]);
        for x in all.chain(around) {
            assert_eq!(nearest(x), libm::roundf(x) as i32, "{x}");
        }
    }

    #[test]
    fn whole_numbers_and_exponents_are_libms() {
        for bits in (0..=u32::MAX).step_by(1009) {
            let x = f32::from_bits(bits);
            if x.is_nan() {
                assert!(ceil(x).is_nan() && floor(x).is_nan());
            } else {
                assert!(ceil(x) == libm::ceilf(x) && floor(x) == libm::floorf(x), "{x}");
            }
            if x.is_normal() {
                assert_eq!(exponent(x), libm::ilogbf(x), "{x}");
            }
        }
        assert!((-126..=127).all(|k| power_of_two(k) == libm::ldexpf(1.0, k)));
    }

    #[test]
    fn the_exponential_function_is_libms() {
        for k in -100_000..=100_000 {
            let x = k as f32 / 10_000.0;
            let exact = libm::exp(f64::from(x));
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 5e-4, "{x}");
        }
    }

    #[test]
    fn the_logarithm_is_libms() {
        for k in -80_000..=80_000 {
            let x = libm::exp2f(k as f32 / 640.0);
            let exact = libm::log(f64::from(x));
            assert!((f64::from(ln(x)) - exact).abs() < 1.5e-6 * exact.abs().max(1.0), "{x}: {} {exact}", ln(x));
        }
        assert_eq!(ln(0.0), f32::NEG_INFINITY);
    }

    #[test]
    fn a_long_integer_is_the_compilers() {
        for k in -200_000..=200_000 {
            let x = k as f32 * libm::exp2f((k % 60) as f32);
            assert_eq!(whole(x), (x as i64).max(-i64::MAX), "{x}");
        }
        assert!(whole(f32::INFINITY) == i64::MAX && whole(1e30) == i64::MAX && whole(f32::NAN) == 0);
        assert!(whole(f32::NEG_INFINITY) == -i64::MAX && whole(-1e30) == -i64::MAX);
    }

    #[test]
    fn short_integers_are_the_compilers() {
        for bits in (0..=u32::MAX).step_by(1009) {
            let x = f32::from_bits(bits);
            assert!(whole_u16(x) == x as u16 && whole_i16(x) == x as i16, "{x}");
        }
        for x in
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 32_767.0, 32_768.0, -32_768.0, -32_769.0, 65_535.0, 65_536.0]
        {
            assert!(whole_u16(x) == x as u16 && whole_i16(x) == x as i16, "{x}");
        }
    }

    #[test]
    fn the_angle_is_libms() {
        let mut worst = 0.0_f32;
        for k in -200_000..=200_000 {
            let angle = k as f32 / 200_000.0 * PI;
            for length in [1e-12, 1e-3, 1.0, 37.0, 1e12] {
                let (y, x) = (length * libm::sinf(angle), length * libm::cosf(angle));
                worst = worst.max(libm::fabsf(short_atan2(y, x) - libm::atan2f(y, x)));
            }
        }
        assert!(worst < 5e-7, "{worst}");
        for (y, x) in [(0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (-1.0, -1.0)] {
            assert!(libm::fabsf(short_atan2(y, x) - libm::atan2f(y, x)) < 5e-7, "{y} {x}");
        }
        assert!(short_atan2(f32::NAN, 1.0).is_nan() && short_atan2(1.0, f32::NAN).is_nan());
    }

    #[test]
    fn has_the_bits_of_libms() {
        let mut bits = 0_u32;
        loop {
            let x = f32::from_bits(bits);
            let (found, expected) = (digit_by_digit(x), libm::sqrtf(x));
            assert!(
                found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(),
                "{x}: {found} {expected}"
            );
            match bits.checked_add(1009) {
                Some(next) => bits = next,
                None => break,
            }
        }
        for x in [f32::MAX, f32::MIN_POSITIVE, f32::from_bits(1), f32::from_bits(0x007F_FFFF), 1.0, 2.0, 4.0, 0.25] {
            assert_eq!(digit_by_digit(x).to_bits(), libm::sqrtf(x).to_bits(), "{x}");
        }
    }
}
