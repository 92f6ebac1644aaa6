//! Division of 64-bit numbers, small instead of fast: tasks divide some, a second, and the compiler's own takes a
//! kilobyte.

/// The quotient; the remainder to its place. By zero, which the language catches before, no matter what.
#[cfg_attr(target_os = "none", inline(never))]
pub fn divide(dividend: u64, divisor: u64, place: &mut u64) -> u64 {
    // What the control interrupt divides is this short; the core divides it.
    if let (Ok(dividend), Ok(divisor @ 1..)) = (u32::try_from(dividend), u32::try_from(divisor)) {
        *place = (dividend % divisor).into();
        return (dividend / divisor).into();
    }
    // Bit by bit: those of the dividend go out at the top, those of the quotient come in below.
    let (mut bits, mut remainder) = (dividend, 0_u64);
    for _ in 0..64 {
        let beyond = remainder >> 63 != 0;
        remainder = remainder << 1 | bits >> 63;
        bits <<= 1;
        if beyond || remainder >= divisor {
            remainder = remainder.wrapping_sub(divisor);
            bits |= 1;
        }
    }
    *place = remainder;
    bits
}

/// The same of signed numbers, towards zero; the remainder has the dividend's sign.
pub fn divide_signed(dividend: i64, divisor: i64, place: &mut i64) -> i64 {
    let mut remainder = 0;
    let quotient = divide(dividend.unsigned_abs(), divisor.unsigned_abs(), &mut remainder) as i64;
    let signed = |negative: bool, x: i64| if negative { x.wrapping_neg() } else { x };
    *place = signed(dividend < 0, remainder as i64);
    signed((dividend ^ divisor) < 0, quotient)
}

/// What the compiler calls, in place of its own. Where there is a map of the magnets, the control interrupt divides.
#[cfg(all(target_os = "none", not(feature = "map")))]
mod called {
    #[unsafe(no_mangle)]
    extern "C" fn __udivmoddi4(dividend: u64, divisor: u64, place: &mut u64) -> u64 {
        super::divide(dividend, divisor, place)
    }

    #[unsafe(no_mangle)]
    extern "C" fn __divmoddi4(dividend: i64, divisor: i64, place: &mut i64) -> i64 {
        super::divide_signed(dividend, divisor, place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of every length, ones, zeros and a mixture at the end.
    fn numbers() -> impl Iterator<Item = u64> {
        let mixed = 0x9E37_79B9_7F4A_7C15;
        (0..64).flat_map(move |bits| [1 << bits, u64::MAX >> bits, mixed >> bits, mixed << bits])
    }

    #[test]
    fn divides_as_the_language_does() {
        for (a, b) in numbers().flat_map(|a| numbers().map(move |b| (a, b))).filter(|(_, b)| *b != 0) {
            let (mut rest, mut signed_rest) = (0, 0);
            assert_eq!((divide(a, b, &mut rest), rest), (a / b, a % b), "{a} / {b}");
            let (a, b) = (a as i64, b as i64);
            let quotient = divide_signed(a, b, &mut signed_rest);
            assert_eq!((quotient, signed_rest), (a.wrapping_div(b), a.wrapping_rem(b)), "{a} / {b}");
        }
    }
}
