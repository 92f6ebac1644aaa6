//! Where the encoder sits on the rotor's shaft: its direction and the Halls' electrical angle at its zero, from one turn.

use super::rings::{Ring, Rings};
use crate::angle::{ElectricalAngle, MechanicalAngle, PolePairs, Position};
use core::fmt;

/// How the encoder is mounted, as far as one turn can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fitted {
    /// Whether the encoder counts down where the phases follow each other as A, B, C.
    pub reversed: bool,
    /// Electrical angle of the rotor where the encoder shows zero, in the order A, B, C.
    pub offset: ElectricalAngle,
}

/// Halls and encoder have not turned alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Unlike {
    /// Electrical turns that the Halls have counted in a turn of the encoder, to the nearest.
    pub found: i32,
    /// Pole pairs of the settings.
    pub expected: u8,
}

impl fmt::Display for Unlike {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "in a turn of the rings the Halls have counted {} electrical turns, not {}: pole_pairs, the rings' pole pairs \
             or the coupling is wrong",
            self.found, self.expected
        )
    }
}

impl Fitted {
    /// For a drive that counts the other way, or back.
    #[must_use]
    pub const fn directed(self, against: bool) -> Self {
        if !against {
            return self;
        }
        let offset = ElectricalAngle::from_bits(self.offset.to_bits().wrapping_neg());
        Self { reversed: !self.reversed, offset }
    }

    /// Electrical angle of the rotor at an angle of the encoder.
    pub const fn electrical(&self, pole_pairs: PolePairs, encoder: MechanicalAngle) -> ElectricalAngle {
        let way = pole_pairs.electrical(encoder).to_bits();
        let way = if self.reversed { way.wrapping_neg() } else { way };
        ElectricalAngle::from_bits(self.offset.to_bits().wrapping_add(way))
    }
}

/// How far the Halls may be from an encoder at rest that shows the right pole pair: half of what the neighbouring one, or
/// any other that the Halls can tell from it, would make; 10° at most. A pole pair of the reference ring, p of them to a
/// turn, more or less moves the electrical angle by a multiple of gcd(p, pole pairs)/p of its turn.
pub fn tolerance_at_rest(rings: &Rings, pole_pairs: PolePairs) -> ElectricalAngle {
    let pairs = rings.pole_pairs(Ring::Reference);
    let common = super::rings::common_divisor(pairs, pole_pairs.get());
    let half = 180.0 * f32::from(common) / f32::from(pairs);
    ElectricalAngle::from_degrees(half.min(10.0))
}

/// Takes samples over a turn.
#[derive(Clone, Copy, Debug, Default)]
pub struct TurnFit {
    /// The first angle, the last one, and the Halls' position at the first.
    first: Option<(MechanicalAngle, MechanicalAngle, Position)>,
    /// Way of the encoder, 2⁻³² turns, and the Halls' way, 2⁻³² electrical turns.
    way: i64,
    halls_way: i64,
    /// Sums of both.
    sum: i128,
    halls_sum: i128,
    count: u32,
}

impl TurnFit {
    /// Takes a sample; true when a turn is complete.
    pub fn push(&mut self, encoder: MechanicalAngle, halls: Position) -> bool {
        let (_, last, begun) = self.first.get_or_insert((encoder, encoder, halls));
        self.way += i64::from((encoder - *last).to_bits());
        *last = encoder;
        self.halls_way = halls.to_bits().wrapping_sub(begun.to_bits());
        self.sum += i128::from(self.way);
        self.halls_sum += i128::from(self.halls_way);
        self.count += 1;
        self.way.abs() >= 1 << 32
    }

    /// How much of the turn is done, 0 to 1.
    pub fn progress(&self) -> f32 {
        self.way.abs() as f32 / crate::angle::TURN
    }

    /// How the encoder is mounted, for a drive that counts as the Halls do.
    ///
    /// # Errors
    /// They have not turned alike.
    pub fn finish(&self, pole_pairs: PolePairs) -> Result<Fitted, Unlike> {
        let expected = pole_pairs.get();
        let pairs = i64::from(expected);
        let reversed = (self.way < 0) != (self.halls_way < 0);
        let found = (self.halls_way.abs().wrapping_add(1 << 31) >> 32) as i32;
        let (Some((first, _, begun)), true) =
            (self.first, (self.halls_way.abs() - pairs * self.way.abs()).abs() < 1 << 31)
        else {
            return Err(Unlike { found, expected });
        };
        let pairs = i128::from(if reversed { -pairs } else { pairs });
        let apart = (self.halls_sum - pairs * self.sum) / i128::from(self.count.max(1));
        let electrical = begun.to_bits().wrapping_add(apart as i64) as i32;
        let unshifted = Fitted { reversed, offset: ElectricalAngle::ZERO }.electrical(pole_pairs, first);
        Ok(Fitted { reversed, offset: ElectricalAngle::from_bits(electrical.wrapping_sub(unshifted.to_bits())) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn of a shaft either way, under Halls with a ripple.
    fn turned(pairs: f64, reversed: bool, speed: f64) -> TurnFit {
        let mut fit = TurnFit::default();
        for step in 0..100_000 {
            let shaft = 0.3 + speed * f64::from(step);
            let encoder = if reversed { -shaft } else { shaft };
            let electrical = pairs * shaft + 0.2 + 0.01 * libm::sin(7.0 * shaft * core::f64::consts::TAU);
            let encoder = MechanicalAngle::from_bits((encoder * 4_294_967_296.0) as i64 as i32);
            if fit.push(encoder, Position::from_turns(electrical)) {
                return fit;
            }
        }
        panic!("it has turned far enough");
    }

    #[test]
    fn direction_and_offset_are_found_either_way() {
        let pole_pairs = PolePairs::new(4).unwrap();
        for reversed in [false, true] {
            for speed in [1e-4, -1.3e-4] {
                let fitted = turned(4.0, reversed, speed).finish(pole_pairs).unwrap();
                assert_eq!(fitted.reversed, reversed);
                // The electrical angle at a shaft angle of zero, where the encoder shows zero.
                assert!((fitted.offset.to_degrees() - 72.0).abs() < 0.1, "{}", fitted.offset);
                assert_eq!(fitted.directed(true).directed(true), fitted);
                // Against the phases all angles have the other sign.
                let encoder = MechanicalAngle::from_degrees(33.0);
                let there = fitted.electrical(pole_pairs, encoder);
                let back = fitted.directed(true).electrical(pole_pairs, encoder);
                assert_eq!(there.to_bits(), back.to_bits().wrapping_neg());
            }
        }
    }

    #[test]
    fn a_wrong_number_of_pole_pairs_is_told() {
        let wrong = turned(7.0, false, 1e-4).finish(PolePairs::new(4).unwrap());
        assert_eq!(wrong, Err(Unlike { found: 7, expected: 4 }));
    }

    #[test]
    fn at_rest_the_halls_tell_pole_pairs_apart_that_are_not_alike_to_them() {
        for (reference, vernier, pairs) in [(37, 45, 4_u8), (45, 37, 5), (36, 35, 4), (64, 63, 3), (5, 4, 1)] {
            let rings = Rings::new(reference, vernier, 12).unwrap();
            let tolerance = tolerance_at_rest(&rings, PolePairs::new(pairs).unwrap()).to_degrees();
            for wrong in 1..reference {
                let electrical = 360.0 * f32::from(pairs) * f32::from(wrong) / f32::from(reference);
                let away = electrical - 360.0 * libm::roundf(electrical / 360.0);
                assert!(away.abs() < 1e-3 || away.abs() > 1.99 * tolerance, "{reference} {pairs} {wrong}: {away}");
            }
        }
    }
}
