//! The Hall sensors' turn counter against the absolute angle.
//!
//! The Halls give the angle within an electrical turn and count electrical turns from power-up on, but not which turn
//! was the first. The encoder's first valid angle sets the counter's zero. From then on the Halls alone give the
//! absolute position, and every later angle of the encoder is compared with it.

use crate::angle::{ElectricalAngle, MechanicalAngle, PolePairs, Position};
use core::fmt;

/// How Halls and encoder are mounted to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TurnCheck {
    /// p: pole pairs of the motor, 1 to 64.
    pub pole_pairs: PolePairs,
    /// Electrical angle of the Halls where the encoder shows zero; [`Self::offset`] measures it.
    pub offset: ElectricalAngle,
    /// How far the Halls may be from the encoder, less than half an electrical turn: what calibration leaves on both
    /// sides, and the way between their samples.
    pub tolerance: ElectricalAngle,
}

/// Zero of the turn counter: whole electrical turns to subtract from the Halls' position. `default` is power-up:
/// unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TurnZero(Option<i32>);

/// How Halls and encoder disagree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Disagreement {
    /// The Hall counter is so many electrical turns ahead of where it should be.
    Slipped(i32),
    /// The electrical angles are this far apart, more than tolerated: one of the two is mounted or calibrated wrong.
    Apart(ElectricalAngle),
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slipped(turns) => write!(f, "the Hall turn counter has slipped by {turns} electrical turns"),
            Self::Apart(angle) => write!(f, "Halls and encoder are {angle} electrical apart"),
        }
    }
}

impl core::error::Error for Disagreement {}

impl TurnCheck {
    /// The offset, from one pair of good readings.
    pub const fn offset(pole_pairs: PolePairs, absolute: MechanicalAngle, halls: ElectricalAngle) -> ElectricalAngle {
        let electrical = pole_pairs.electrical(absolute);
        ElectricalAngle::from_bits(halls.to_bits().wrapping_sub(electrical.to_bits()))
    }

    /// Compares the Halls' position with an absolute angle of the same instant, at any rate; the first sets the zero.
    /// Returns by how much the Halls are ahead. A 64-bit division: not for the interrupt.
    ///
    /// # Errors
    /// The counter has slipped, or the angles are too far apart.
    pub fn check(
        &self,
        zero: &mut TurnZero,
        absolute: MechanicalAngle,
        halls: Position,
    ) -> Result<ElectricalAngle, Disagreement> {
        let pairs = i64::from(self.pole_pairs.get());
        let expected = pairs * i64::from(absolute.to_bits()) + i64::from(self.offset.to_bits());
        let ahead = halls.to_bits().wrapping_sub(expected);
        // Whole electrical turns ahead, and the angle beyond these.
        let angle = ElectricalAngle::from_bits(ahead as i32);
        let turns = (ahead.wrapping_add(1 << 31) >> 32) as i32;
        if angle.to_bits().unsigned_abs() > self.tolerance.to_bits().unsigned_abs() {
            return Err(Disagreement::Apart(angle));
        }
        let slipped = turns.wrapping_sub(*zero.0.get_or_insert(turns)).rem_euclid(pairs as i32);
        match slipped {
            0 => Ok(angle),
            // The shorter way round.
            _ if 2 * slipped > pairs as i32 => Err(Disagreement::Slipped(slipped - pairs as i32)),
            _ => Err(Disagreement::Slipped(slipped)),
        }
    }

    /// The absolute angle by the Halls alone; `None` until [`Self::check`] has set the zero. Divides, so not for the
    /// interrupt.
    pub fn absolute(&self, zero: TurnZero, halls: Position) -> Option<MechanicalAngle> {
        let electrical = halls.to_bits().wrapping_sub(i64::from(self.offset.to_bits()));
        let start = i64::from(zero.0?) << 32;
        Some(self.pole_pairs.mechanical(Position::from_bits(electrical.wrapping_sub(start))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check() -> TurnCheck {
        TurnCheck {
            pole_pairs: PolePairs::new(7).unwrap(),
            offset: ElectricalAngle::from_degrees(100.0),
            tolerance: ElectricalAngle::from_degrees(20.0),
        }
    }

    /// Encoder angle and Hall position of a shaft at `turns`, the counter having started in electrical turn `start`.
    fn at(turns: f64, start: i64) -> (MechanicalAngle, Position) {
        let absolute = MechanicalAngle::from_bits((turns * 4_294_967_296.0) as i64 as i32);
        let electrical = (7.0 * turns + 100.0 / 360.0) * 4_294_967_296.0;
        (absolute, Position::from_bits(electrical as i64 - (start << 32)))
    }

    #[test]
    fn the_halls_become_absolute_and_stay_so() {
        for start in -9..9 {
            let mut zero = TurnZero::default();
            assert_eq!(check().absolute(zero, Position::default()), None);
            for step in -3000..3000 {
                let (absolute, halls) = at(f64::from(step) * 0.013, start);
                let ahead = check().check(&mut zero, absolute, halls).unwrap();
                assert!(ahead.to_degrees().abs() < 1e-3);
                let error = check().absolute(zero, halls).unwrap() - absolute;
                assert!(error.to_degrees().abs() < 1e-3, "{error}");
            }
        }
    }

    #[test]
    fn a_slip_is_told_with_its_size_and_direction() {
        let mut zero = TurnZero::default();
        let (absolute, halls) = at(0.3, 5);
        check().check(&mut zero, absolute, halls).unwrap();
        for slip in -3..=3_i32 {
            let (absolute, halls) = at(11.7, 5 - i64::from(slip));
            let result = check().check(&mut zero, absolute, halls);
            match slip {
                0 => assert!(result.is_ok()),
                _ => assert_eq!(result, Err(Disagreement::Slipped(slip))),
            }
        }
    }

    #[test]
    fn angles_too_far_apart_are_told() {
        let (absolute, halls) = at(0.4, 0);
        for degrees in [-170.0, -25.0, 25.0, 90.0] {
            let away = ElectricalAngle::from_degrees(degrees);
            let halls = Position::from_bits(halls.to_bits() + i64::from(away.to_bits()));
            let mut zero = TurnZero::default();
            let Err(Disagreement::Apart(apart)) = check().check(&mut zero, absolute, halls) else { panic!() };
            assert!((apart.to_degrees() - degrees).abs() < 1e-3);
            // Nothing is learnt from it.
            assert_eq!(zero, TurnZero::default());
        }
        let offset = TurnCheck::offset(check().pole_pairs, absolute, halls.angle());
        assert!((offset.to_degrees() - 100.0).abs() < 1e-3);
    }
}
