//! Set-points that come one after the other: which of them turn the current round?
//!
//! A current that is turned round again and again may be on its way at every look at it: what is missing of it then is no
//! fault. One that is asked for again and again, and does not come, is.

use super::Demand;
use crate::control::{Current, Speed};

/// The last set-point.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetPoints {
    /// Its value, whatever it is of; a position in 2⁻¹⁶ electrical turns, wrapping.
    last: i32,
    /// Whether it was beyond the one before.
    rises: bool,
}

impl SetPoints {
    /// None yet.
    pub const NONE: Self = Self { last: 0, rises: false };

    /// Takes one up: whether the current has a new way to go. A current has by a step of more than half of it, and so not by the
    /// noise of a user's own loop; a speed or a position where it comes back after it went away, or goes away after it came back.
    pub fn turns_round(&mut self, demand: Demand) -> bool {
        let value = match demand {
            Demand::Current(Current(value)) | Demand::Speed(Speed(value)) => value,
            Demand::Position(position) => (position.to_bits() >> 16) as i32,
            Demand::Voltage | Demand::Impedance => return false,
        };
        let change = value.wrapping_sub(core::mem::replace(&mut self.last, value));
        if let Demand::Current(_) = demand {
            return change.unsigned_abs() > value.unsigned_abs() / 2;
        }
        change != 0 && core::mem::replace(&mut self.rises, change > 0) != (change > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::Position;

    /// Which of these turn round, the first one aside.
    fn turned<const N: usize>(set_points: [Demand; N]) -> [bool; N] {
        let mut before = SetPoints::NONE;
        set_points.map(|demand| before.turns_round(demand))
    }

    #[test]
    fn a_current_turns_round_by_a_step_and_not_by_its_noise() {
        let currents = [100, 100, 110, 95, -95, -100, 0, 0, 100, 300].map(|value| Demand::Current(Current(value)));
        assert_eq!(turned(currents)[1..], [false, false, false, true, false, true, false, true, true]);
    }

    #[test]
    fn a_speed_or_a_position_turns_round_where_it_comes_back() {
        let values = [0, 100, 200, 200, 300, -300, -300, -400, 400, 100];
        let speeds = values.map(|value| Demand::Speed(Speed(value)));
        let positions = values.map(|value| Demand::Position(Position::from_bits(i64::from(value) << 20)));
        for set_points in [speeds, positions] {
            assert_eq!(turned(set_points), [false, true, false, false, false, true, false, false, true, true]);
        }
    }
}
