//! Division of 64-bit numbers, small instead of fast: tasks divide some, a second, and the compiler's own takes a
//! kilobyte.

/// Quotient and remainder. By zero, which the language catches before, no matter what.
pub fn divide(dividend: u64, divisor: u64) -> (u64, u64) {
    // What the control interrupt divides is this short; the core divides it.
    if let (Ok(dividend), Ok(divisor @ 1..)) = (u32::try_from(dividend), u32::try_from(divisor)) {
        return ((dividend / divisor).into(), (dividend % divisor).into());
    }
    let more = divisor.leading_zeros().saturating_sub(dividend.leading_zeros());
    let mut shift = more.min(63);
    let (mut quotient, mut remainder) = (0, dividend);
    loop {
        quotient <<= 1;
        if remainder >> shift >= divisor {
            remainder -= divisor << shift;
            quotient |= 1;
        }
        if shift == 0 {
            return (quotient, remainder);
        }
        shift -= 1;
    }
}

/// The same of signed numbers, towards zero; the remainder has the dividend's sign.
pub fn divide_signed(dividend: i64, divisor: i64) -> (i64, i64) {
    let (quotient, remainder) = divide(dividend.unsigned_abs(), divisor.unsigned_abs());
    let (quotient, remainder) = (quotient as i64, remainder as i64);
    let signed = |negative: bool, x: i64| if negative { x.wrapping_neg() } else { x };
    (signed((dividend < 0) != (divisor < 0), quotient), signed(dividend < 0, remainder))
}

/// What the compiler calls, in place of its own. Where there is a map of the magnets, the control interrupt divides.
#[cfg(all(target_os = "none", not(feature = "map")))]
mod called {
    #[unsafe(no_mangle)]
    extern "C" fn __udivmoddi4(dividend: u64, divisor: u64, place: Option<&mut u64>) -> u64 {
        let (quotient, remainder) = super::divide(dividend, divisor);
        if let Some(place) = place {
            *place = remainder;
        }
        quotient
    }

    #[unsafe(no_mangle)]
    extern "C" fn __divmoddi4(dividend: i64, divisor: i64, place: &mut i64) -> i64 {
        let (quotient, remainder) = super::divide_signed(dividend, divisor);
        *place = remainder;
        quotient
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
            assert_eq!(divide(a, b), (a / b, a % b), "{a} / {b}");
            let (a, b) = (a as i64, b as i64);
            assert_eq!(divide_signed(a, b), (a.wrapping_div(b), a.wrapping_rem(b)), "{a} / {b}");
        }
    }
}
