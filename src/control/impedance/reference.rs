//! Where the spring is at rest: a position that is gone to, one that moves, a speed, or a range.

use super::coarse;
use crate::angle::Position;
use crate::control::trajectory::{Limits, Trajectory};

/// What the reference does. Positions in 2⁻²⁹ electrical turns, speeds in those a step of the outer loops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) enum Reference {
    /// Begins at a position, or where it is, with a speed, at once; then it travels.
    Begin {
        /// `None`: where it is.
        at: Option<i64>,
        travel: Travel,
    },
    /// Approaches, within limits, a target that moves on with the speed of the travel; then it travels.
    Approach { target: i64, limits: Limits, travel: Travel },
    /// Travels.
    Travel(Travel),
    /// The nearer end of a range for a rotor outside of it.
    Within { least: i64, most: i64 },
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
    #[inline(always)]
    const fn end(&self, bounds: &[i64; 2]) -> i64 {
        match self.stop {
            Some(stop) => stop,
            None if self.speed < 0 => bounds[0],
            None => bounds[1],
        }
    }
}

impl Reference {
    /// Stays where it is.
    pub const REST: Self = Self::Travel(Travel { speed: 0, stop: None, limits: Limits::SLOWEST });

    /// Moved by the position at which the user's is zero.
    pub fn shift(&mut self, origin: Position) {
        let way = coarse(origin);
        let moved = |position: i64| position.saturating_add(way);
        match self {
            Self::Begin { at, travel } => {
                *at = at.map(moved);
                travel.stop = travel.stop.map(moved);
            }
            Self::Approach { target, travel, .. } => {
                *target = moved(*target);
                travel.stop = travel.stop.map(moved);
            }
            Self::Travel(travel) => travel.stop = travel.stop.map(moved),
            Self::Within { least, most } => (*least, *most) = (moved(*least), moved(*most)),
        }
    }

    /// Whether every position that is asked for is within the bounds.
    pub fn is_within(&self, [least, most]: &[i64; 2]) -> bool {
        let allowed = |position: Option<i64>| position.is_none_or(|position| (*least..=*most).contains(&position));
        match self {
            Self::Begin { at, travel } => allowed(*at) && allowed(travel.stop),
            Self::Approach { target, travel, .. } => allowed(Some(*target)) && allowed(travel.stop),
            Self::Travel(travel) => allowed(travel.stop),
            Self::Within { .. } => true,
        }
    }

    /// The position that it jumps to.
    pub const fn jumps_to(&self) -> Option<i64> {
        if let Self::Begin { at, .. } = self { *at } else { None }
    }

    /// Taken up: a jump is done.
    pub const fn begin(&mut self, trajectory: &mut Trajectory) {
        if let Self::Begin { at, travel } = *self {
            let at = match at {
                Some(at) => Position::from_bits(at),
                None => trajectory.position(),
            };
            *trajectory = Trajectory::at(at, travel.speed);
            *self = Self::Travel(travel);
        }
    }

    /// Prepares [`Self::advance`].
    #[inline(always)]
    pub const fn plan(&mut self, trajectory: &mut Trajectory, bounds: &[i64; 2]) {
        match self {
            Self::Approach { target, limits, travel } => {
                let (here, drift) = (trajectory.position().to_bits(), travel.speed);
                let end = travel.end(bounds);
                let left = if drift < 0 { here - end } else { end - here };
                // The end comes before the target is reached, or the target has been.
                let arrives = here == *target && trajectory.speed() == drift;
                if drift != 0 && (arrives || !trajectory.stops_within(left, &travel.limits)) {
                    let travel = *travel;
                    *self = Self::Travel(travel);
                    trajectory.plan(Position::from_bits(end), &travel.limits);
                } else {
                    trajectory.plan(Position::from_bits(*target), limits);
                    *target += drift as i64;
                }
            }
            Self::Travel(travel) if travel.speed != 0 => {
                trajectory.plan(Position::from_bits(travel.end(bounds)), &travel.limits);
            }
            _ => {}
        }
    }

    /// One step of the outer loops.
    #[inline(always)]
    pub const fn advance(&self, trajectory: &mut Trajectory) {
        match self {
            Self::Approach { limits, travel, .. } => trajectory.advance_with(travel.speed, limits),
            Self::Travel(travel) if travel.speed != 0 => trajectory.advance(&travel.limits),
            Self::Travel(travel) => trajectory.towards_speed(0, &travel.limits),
            Self::Begin { .. } | Self::Within { .. } => {}
        }
    }

    /// Where it goes.
    #[inline(always)]
    pub const fn goal(&self, trajectory: &Trajectory, bounds: &[i64; 2]) -> i64 {
        match self {
            Self::Approach { target, .. } => *target,
            Self::Travel(travel) if travel.speed != 0 => travel.end(bounds),
            _ => trajectory.position().to_bits(),
        }
    }

    /// Whether it has come to what was asked for: rest, or the speed.
    pub const fn is_complete(&self, trajectory: &Trajectory, bounds: &[i64; 2]) -> bool {
        match self {
            Self::Approach { target, travel, .. } => {
                trajectory.position().to_bits() == *target && trajectory.speed() == travel.speed
            }
            Self::Travel(travel) => {
                trajectory.speed() == travel.speed || trajectory.position().to_bits() == travel.end(bounds)
            }
            Self::Begin { .. } => false,
            Self::Within { .. } => true,
        }
    }
}
