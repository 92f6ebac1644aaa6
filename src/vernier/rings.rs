//! Two rings: their pole-pair counts, the heads' resolution, and the margin of error that these leave.

use crate::angle::PolePairs;
use core::fmt;

/// One of the two rings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Ring {
    /// The ring whose pole pairs are counted and whose reading gives the fine angle: the inner one in the paper.
    Reference,
    /// The ring that tells which pole pair of the reference it is.
    Vernier,
}

/// Two rings of coprime pole-pair counts under heads of equal resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Rings {
    reference: PolePairs,
    vernier: PolePairs,
    bits: u8,
}

/// Why two rings make no absolute encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum RingsError {
    /// A ring has no pole pairs or more than 64.
    PolePairs {
        /// Which ring.
        ring: Ring,
        /// The count given.
        found: u8,
    },
    /// Both counts have this divisor in common, so the readings repeat that often in a turn.
    CommonDivisor(u8),
    /// The resolution, given here, is not 8 to 16 bits.
    Resolution(u8),
}

impl fmt::Display for RingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PolePairs { ring, found } => write!(
                f,
                "the {} ring has {found} pole pairs, not 1 to {}",
                match ring {
                    Ring::Reference => "reference",
                    Ring::Vernier => "vernier",
                },
                PolePairs::MAX
            ),
            Self::CommonDivisor(divisor) => write!(
                f,
                "the pole-pair counts have the divisor {divisor} in common: the readings repeat {divisor} times a turn"
            ),
            Self::Resolution(bits) => {
                write!(f, "the heads resolve {bits} bits, not 8 to 16")
            }
        }
    }
}

impl core::error::Error for RingsError {}

/// How far the two readings may contradict each other before the decoder takes the neighbouring table entry for the
/// true one: half the distance of two entries, in either direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margin {
    /// In counts of the vernier ring's head, after all error is put there: N / (2 · pole pairs of the reference).
    pub counts: f32,
    /// The same in electrical degrees of the vernier ring.
    pub electrical_degrees: f32,
    /// The same in mechanical degrees.
    pub mechanical_degrees: f32,
}

impl Rings {
    /// Two rings by their pole-pair counts, 1 to 64 each, the reference first, under heads of `bits` bits, 8 to 16.
    ///
    /// # Errors
    /// Names the number that is out of range or the common divisor of the two counts.
    pub const fn new(reference: u8, vernier: u8, bits: u8) -> Result<Self, RingsError> {
        let Some(reference_pairs) = PolePairs::new(reference) else {
            return Err(RingsError::PolePairs { ring: Ring::Reference, found: reference });
        };
        let Some(vernier_pairs) = PolePairs::new(vernier) else {
            return Err(RingsError::PolePairs { ring: Ring::Vernier, found: vernier });
        };
        let divisor = common_divisor(reference, vernier);
        if divisor != 1 {
            return Err(RingsError::CommonDivisor(divisor));
        }
        if bits < 8 || bits > 16 {
            return Err(RingsError::Resolution(bits));
        }
        Ok(Self { reference: reference_pairs, vernier: vernier_pairs, bits })
    }

    /// Pole pairs of a ring.
    pub const fn pole_pairs(&self, ring: Ring) -> u8 {
        match ring {
            Ring::Reference => self.reference.get(),
            Ring::Vernier => self.vernier.get(),
        }
    }

    /// The heads' resolution in bits.
    pub const fn bits(&self) -> u8 {
        self.bits
    }

    /// A head's code as a reading; bits above the resolution are ignored.
    #[inline(always)]
    pub const fn reading(&self, code: u16) -> u16 {
        code << (16 - self.bits)
    }

    /// The margin of the ideal table.
    pub fn margin(&self) -> Margin {
        let pairs = f32::from(self.reference.get());
        let electrical_degrees = 180.0 / pairs;
        Margin {
            counts: self.residual_counts(1 << 15),
            electrical_degrees,
            mechanical_degrees: electrical_degrees / f32::from(self.vernier.get()),
        }
    }

    /// A residual in counts of the vernier ring's head.
    pub fn residual_counts(&self, residual: i32) -> f32 {
        let counts = (1_u32 << self.bits) as f32;
        residual as f32 * (counts / 65536.0) / f32::from(self.reference.get())
    }

    /// The pole pair of the reference ring, 0 to its count − 1, that belongs to the table value `lattice`.
    ///
    /// Over a turn α the rings have moved by p·α and q·α pole pairs (p: reference, q: vernier): k whole ones and the
    /// reading x of the one, j whole ones and the reading y of the other, both of full scale N. From
    /// q (k N + x) = p (j N + y) it follows that q·x − p·y = n·N with the integer n = p·j − q·k; modulo p, n names k.
    pub(crate) const fn pole_pair(&self, lattice: i32) -> u8 {
        let (p, q) = (self.reference.get() as i32, self.vernier.get() as i32);
        let mut k = 0;
        while (q * k + lattice) % p != 0 {
            k += 1;
        }
        k as u8
    }
}

pub(super) const fn common_divisor(a: u8, b: u8) -> u8 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::ToString;

    #[test]
    fn the_papers_rings_have_the_papers_margin() {
        let margin = Rings::new(37, 45, 12).unwrap().margin();
        assert!((margin.counts - 55.35).abs() < 0.005, "{margin:?}");
        assert!((margin.electrical_degrees - 4.8649).abs() < 1e-4);
        assert!((margin.mechanical_degrees - 0.1081).abs() < 1e-4);
        // The mechanical margin is the same whichever ring is the reference.
        let swapped = Rings::new(45, 37, 12).unwrap().margin();
        assert!((swapped.counts - 45.51).abs() < 0.005);
        assert_eq!(swapped.mechanical_degrees, margin.mechanical_degrees);
    }

    #[test]
    fn bad_rings_are_refused_by_name() {
        assert_eq!(Rings::new(36, 45, 12), Err(RingsError::CommonDivisor(9)));
        assert_eq!(Rings::new(5, 5, 12), Err(RingsError::CommonDivisor(5)));
        let error = Rings::new(36, 45, 12).unwrap_err().to_string();
        assert!(error.contains("divisor 9 in common"), "{error}");
        for found in [0, 65, 255] {
            for (reference, vernier, ring) in [(found, 7, Ring::Reference), (7, found, Ring::Vernier)] {
                assert_eq!(Rings::new(reference, vernier, 12), Err(RingsError::PolePairs { ring, found }));
            }
        }
        for bits in [0, 7, 17, 255] {
            assert_eq!(Rings::new(37, 45, bits), Err(RingsError::Resolution(bits)));
        }
        assert!(Rings::new(1, 64, 8).is_ok());
    }
}
