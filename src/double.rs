//! Double precision as messages have it, taken apart by integers: a chip that computes with single precision only would
//! need 4 KiB of code to compute with it.

/// Bits of a double's fraction.
const FRACTION: u32 = 52;
/// Biased exponent of one.
const ONE: i32 = 1023;

/// `value` in 2⁻³², towards zero. `None` beyond ±2³⁰ and where it is no number.
pub fn to_fixed(value: f64) -> Option<i64> {
    let bits = value.to_bits();
    let exponent = (bits >> FRACTION & 0x7FF) as i32 - ONE;
    if exponent >= 30 {
        return None;
    }
    // In 2⁻⁵² of two to the exponent.
    let mantissa = bits & ((1 << FRACTION) - 1) | 1 << FRACTION;
    let up = exponent - (FRACTION as i32 - 32);
    let magnitude = if up >= 0 { mantissa << up } else { mantissa.checked_shr(up.unsigned_abs()).unwrap_or(0) } as i64;
    Some(if bits >> 63 == 1 { -magnitude } else { magnitude })
}

/// From 2⁻³², towards zero.
#[cfg_attr(feature = "small", inline(never))]
pub const fn from_fixed(fixed: i64) -> f64 {
    let magnitude = fixed.unsigned_abs();
    if magnitude == 0 {
        return 0.0;
    }
    let leading = magnitude.leading_zeros();
    // The first one at the top, then where the fraction begins, without that one.
    let fraction = (magnitude << leading) >> (63 - FRACTION) & ((1 << FRACTION) - 1);
    let exponent = (ONE + 31 - leading as i32) as u64;
    f64::from_bits((fixed as u64 >> 63 << 63) | exponent << FRACTION | fraction)
}

/// In single precision, towards zero; what is too large becomes infinite, what is too small zero.
pub const fn narrow(value: f64) -> f32 {
    let bits = value.to_bits();
    let exponent = (bits >> FRACTION & 0x7FF) as i32 - ONE;
    let sign = (bits >> 63 << 31) as u32;
    let fraction = (bits >> (FRACTION - 23)) as u32 & 0x7F_FFFF;
    let is_nan = exponent == 1024 && bits << 12 != 0;
    f32::from_bits(match exponent {
        _ if is_nan => f32::NAN.to_bits(),
        128.. => sign | f32::INFINITY.to_bits(),
        -126..=127 => sign | ((exponent + 127) as u32) << 23 | fraction,
        _ => sign,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SCALE: f64 = 4_294_967_296.0;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn fixed_is_what_arithmetic_makes_of_it(value in -1_073_741_823.9..1_073_741_823.9_f64, down in 0..80_i32) {
            for value in [value, value * libm::exp2(f64::from(-down))] {
                prop_assert_eq!(to_fixed(value), Some((value * SCALE) as i64));
            }
        }

        #[test]
        fn and_back(fixed: i64, down in 0..64_u32) {
            let fixed = fixed >> down;
            let back = from_fixed(fixed);
            let exact = fixed as f64 / SCALE;
            prop_assert!((back - exact).abs() <= exact.abs() * f64::EPSILON, "{back} {exact}");
            if fixed.unsigned_abs() < 1 << 53 {
                prop_assert_eq!(back, exact);
            }
        }

        #[test]
        fn single_precision_is_near(bits: u64) {
            let value = f64::from_bits(bits);
            let (narrow, exact) = (narrow(value), value as f32);
            prop_assert_eq!(narrow.is_nan(), exact.is_nan());
            let near = (f64::from(narrow) - f64::from(exact)).abs() <= f64::from(exact).abs() * 1.2e-7;
            let tiny = exact.abs() < 1.2e-38 && narrow == 0.0;
            let huge = exact.abs() >= f32::MAX && narrow.abs() >= f32::MAX;
            prop_assert!(near || tiny || huge || exact.is_nan(), "{narrow} {exact}");
        }
    }

    #[test]
    fn what_is_no_number_or_too_large_is_no_fixed_one() {
        for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1_073_741_824.0, -1e300] {
            assert_eq!(to_fixed(bad), None, "{bad}");
        }
        assert_eq!([0.0, -0.0, 1e-300, 1.0, -0.5].map(to_fixed), [0, 0, 0, 1 << 32, -(1 << 31)].map(Some));
    }
}
