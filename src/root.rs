//! The square root, for code that runs on chips.

/// The square root, rounded to nearest: the same bits on every chip and computer. With the feature `small` digit by
/// digit, as tasks need some a second only, and libm's table and code are 350 bytes more.
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

#[cfg(test)]
mod tests {
    use super::*;

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
