//! Where the spring is at rest: a position that is gone to, one that moves on, a speed, or a range.

use crate::angle::Position;
use crate::control::trajectory::Limits;
use crate::schedule::coarse;

/// What the reference does. Positions in 2⁻²⁹ electrical turns, speeds in those a step of the outer loops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) enum Course {
    /// It begins somewhere and travels.
    Travel { from: Start, travel: Travel },
    /// It goes to a position, within limits.
    Approach { target: i64, limits: Limits },
    /// The nearer end of a range, for a rotor outside of it: one end, and the strains about it that count as none.
    Within { end: Option<i64>, dead: [i32; 2] },
}

/// Where a travel begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) enum Start {
    /// Where the reference is, with the speed that it has.
    Smoothly,
    /// Where the reference is, with the travel's speed at once.
    AtSpeed,
    /// At a position with the travel's speed, at once.
    At(i64),
}

/// A speed, up to a position at which it comes to rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Travel {
    pub speed: i32,
    /// `None`: the bound of the position.
    pub stop: Option<i64>,
    /// With the speed's magnitude.
    pub limits: Limits,
}

impl Travel {
    /// Where it ends.
    pub const fn end(&self, bounds: &[i64; 2]) -> i64 {
        match self.stop {
            Some(stop) => stop,
            None if self.speed < 0 => bounds[0],
            None => bounds[1],
        }
    }
}

impl Course {
    /// Stays where it is.
    pub const REST: Self =
        Self::Travel { from: Start::Smoothly, travel: Travel { speed: 0, stop: None, limits: Limits::SLOWEST } };

    /// Moved by the position at which the user's is zero.
    pub fn shift(&mut self, origin: Position) {
        let way = coarse(origin).to_bits();
        let moved = |position: i64| position.saturating_add(way);
        match self {
            Self::Travel { from, travel } => {
                if let Start::At(at) = from {
                    *at = moved(*at);
                }
                travel.stop = travel.stop.map(moved);
            }
            Self::Approach { target, .. } => *target = moved(*target),
            Self::Within { end, .. } => *end = end.map(moved),
        }
    }

    /// Whether every position that it leads to is within the bounds.
    pub fn is_within(&self, [least, most]: &[i64; 2]) -> bool {
        let allowed = |position: i64| (*least..=*most).contains(&position);
        match self {
            Self::Travel { from: Start::At(at), travel } => allowed(*at) && travel.stop.is_none_or(allowed),
            Self::Travel { travel, .. } => travel.stop.is_none_or(allowed),
            Self::Approach { target, .. } => allowed(*target),
            Self::Within { .. } => true,
        }
    }
}
