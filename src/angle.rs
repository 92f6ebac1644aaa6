//! Angles as wrapping 32-bit turns, multi-turn positions and pole pairs.
//!
//! One turn is the full scale of an `i32`: `i32::MIN` is −180°, `0` is 0° and `i32::MAX` just below +180°. Wrapping
//! costs nothing and cannot go wrong, and one bit is 8.4e-8°. Electrical and mechanical angles are different types;
//! [`PolePairs`] is the only way from one to the other.

use core::fmt;
use core::ops::{Add, AddAssign, Neg, Sub, SubAssign};

/// Bits of one turn as a float: 2³².
pub(crate) const TURN: f32 = 4_294_967_296.0;

macro_rules! angle {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub struct $name(i32);

        impl $name {
            /// 0°.
            pub const ZERO: Self = Self(0);
            /// 90°.
            pub const QUARTER: Self = Self(1 << 30);
            /// 180°, which is also −180°.
            pub const HALF: Self = Self(i32::MIN);
            /// 120° to the nearest bit.
            pub const THIRD: Self = Self(1_431_655_765);

            /// From 2⁻³² turns; every value is legal.
            pub const fn from_bits(bits: i32) -> Self {
                Self(bits)
            }

            /// In 2⁻³² turns.
            pub const fn to_bits(self) -> i32 {
                self.0
            }

            /// From turns, wrapped; the resolution is that of an `f32`, 2⁻²⁴ of the distance from zero.
            /// Not a number becomes 0.
            #[inline(never)]
            pub fn from_turns(turns: f32) -> Self {
                // `as` saturates, so take the fraction first; a float of more than 23 bits has none.
                let fraction = if turns.abs() < 8_388_608.0 { turns - turns as i32 as f32 } else { 0.0 };
                let whole = if fraction >= 0.5 { 1.0 } else if fraction < -0.5 { -1.0 } else { 0.0 };
                Self(((fraction - whole) * TURN) as i32)
            }

            /// In turns, −0.5 to 0.5.
            pub fn to_turns(self) -> f32 {
                self.0 as f32 / TURN
            }

            /// From degrees, wrapped.
            pub fn from_degrees(degrees: f32) -> Self {
                Self::from_turns(degrees / 360.0)
            }

            /// In degrees, −180 to 180.
            pub fn to_degrees(self) -> f32 {
                self.to_turns() * 360.0
            }

            /// From radians, wrapped.
            pub fn from_radians(radians: f32) -> Self {
                Self::from_turns(radians / core::f32::consts::TAU)
            }

            /// In radians, −π to π.
            pub fn to_radians(self) -> f32 {
                self.to_turns() * core::f32::consts::TAU
            }
        }

        impl Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0.wrapping_add(other.0))
            }
        }

        impl Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0.wrapping_sub(other.0))
            }
        }

        impl Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(self.0.wrapping_neg())
            }
        }

        impl AddAssign for $name {
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl SubAssign for $name {
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{:.3}°", self.to_degrees())
            }
        }
    };
}

angle! {
    /// An angle within the electrical turn (one pole pair): 0 where the rotor's north pole faces the axis of phase A.
    ElectricalAngle
}

angle! {
    /// An angle within the mechanical turn of the rotor.
    MechanicalAngle
}

/// A position over many electrical turns: whole turns above bit 32, the electrical angle below.
///
/// ±2³¹ electrical turns; at 2 kHz electrical that lasts twelve days in one direction, and then it wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position(i64);

impl Position {
    /// From 2⁻³² electrical turns.
    pub const fn from_bits(bits: i64) -> Self {
        Self(bits)
    }

    /// In 2⁻³² electrical turns.
    pub const fn to_bits(self) -> i64 {
        self.0
    }

    /// The position of the given angle in turn zero, the turn −½ … ½.
    pub const fn from_angle(angle: ElectricalAngle) -> Self {
        Self(angle.0 as i64)
    }

    /// The angle within the turn.
    pub const fn angle(self) -> ElectricalAngle {
        ElectricalAngle(self.0 as i32)
    }

    /// Number of the turn: the position rounded to whole turns (half a turn rounds up).
    pub const fn turns(self) -> i32 {
        (self.0.wrapping_add(1 << 31) >> 32) as i32
    }

    /// Moves to `angle` along the shorter way: the corrected jump detector of Simpkins and Todorov, eq. (4).
    /// The true motion since the last call must be less than half an electrical turn.
    pub const fn advance_to(self, angle: ElectricalAngle) -> Self {
        let step = angle.0.wrapping_sub(self.0 as i32);
        Self(self.0.wrapping_add(step as i64))
    }

    /// What is left of it beyond whole mechanical turns, at most half a turn either way. Divides, so not for every step.
    #[inline(never)]
    pub const fn within_turn(self, pole_pairs: PolePairs) -> Self {
        let turn = (pole_pairs.get() as i64) << 32;
        // A turn is never 0; so written, nothing can panic.
        match self.0.wrapping_add(turn / 2).checked_rem_euclid(turn) {
            Some(within) => Self(within - turn / 2),
            None => Self(0),
        }
    }

    /// From electrical turns, rounded.
    pub fn from_turns(turns: f64) -> Self {
        Self((turns * 4_294_967_296.0 + 0.5_f64.copysign(turns)) as i64)
    }

    /// In electrical turns; the resolution is that of an `f64`.
    pub fn to_turns(self) -> f64 {
        self.0 as f64 / 4_294_967_296.0
    }
}

/// Number of pole pairs of the rotor, 1 to 64: electrical turns in a mechanical turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PolePairs(u8);

impl PolePairs {
    /// A rotor with two poles.
    pub const ONE: Self = Self(1);
    /// The largest number supported.
    pub const MAX: u8 = 64;

    /// `None` unless 1 to 64.
    pub const fn new(pairs: u8) -> Option<Self> {
        if 1 <= pairs && pairs <= Self::MAX { Some(Self(pairs)) } else { None }
    }

    /// As a number.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The electrical angle at a mechanical angle, exact.
    pub const fn electrical(self, angle: MechanicalAngle) -> ElectricalAngle {
        ElectricalAngle(angle.0.wrapping_mul(self.0 as i32))
    }

    /// The mechanical angle of a multi-turn electrical position, to 2⁻³² turns. Divides, so not for the interrupt.
    pub const fn mechanical(self, position: Position) -> MechanicalAngle {
        MechanicalAngle(position.0.div_euclid(self.0 as i64) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_there_and_back() {
        for tenth in -1799..1800 {
            let degrees = tenth as f32 / 10.0;
            let back = ElectricalAngle::from_degrees(degrees).to_degrees();
            assert!((back - degrees).abs() < 4e-5, "{degrees} {back}");
            let turned = ElectricalAngle::from_degrees(degrees + 720.0).to_degrees();
            assert!((turned - degrees).abs() < 1e-3, "{degrees} {turned}");
        }
        assert_eq!(ElectricalAngle::from_degrees(180.0), ElectricalAngle::HALF);
        assert_eq!(ElectricalAngle::from_degrees(-180.0), ElectricalAngle::HALF);
        assert_eq!(ElectricalAngle::from_degrees(90.0), ElectricalAngle::QUARTER);
        assert_eq!(ElectricalAngle::from_degrees(f32::NAN), ElectricalAngle::ZERO);
        assert_eq!(ElectricalAngle::from_degrees(f32::INFINITY), ElectricalAngle::ZERO);
    }

    #[test]
    fn position_counts_turns_both_ways() {
        let step = ElectricalAngle::from_degrees(170.0);
        let mut position = Position::default();
        let mut angle = ElectricalAngle::ZERO;
        for _ in 0..36 {
            angle += step;
            position = position.advance_to(angle);
        }
        assert_eq!(position.turns(), 17);
        assert_eq!(position.angle(), angle);
        for _ in 0..72 {
            angle -= step;
            position = position.advance_to(angle);
        }
        assert_eq!(position.turns(), -17);
    }

    #[test]
    fn pole_pairs_convert() {
        assert_eq!(PolePairs::new(0), None);
        assert_eq!(PolePairs::new(65), None);
        for pairs in 1..=PolePairs::MAX {
            let pairs = PolePairs::new(pairs).unwrap();
            for k in 0..1000_i64 {
                let mechanical = MechanicalAngle::from_bits((k * 4_294_967) as i32);
                let electrical = i64::from(mechanical.to_bits()) * i64::from(pairs.get());
                let position = Position::from_bits(electrical);
                assert_eq!(pairs.mechanical(position), mechanical);
                assert_eq!(pairs.electrical(mechanical), position.angle());
            }
        }
    }
}
