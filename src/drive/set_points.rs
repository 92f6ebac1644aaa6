//! Set-points that come one after the other: which of them turn the current round?
//!
//! A current that is turned round again and again may be on its way at every look at it: what is missing of it then is no
//! fault. One that is asked for again and again, and does not come, is.

/// The last set-point.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetPoints {
    /// Its value, whatever it is of.
    last: i32,
    /// Whether it was beyond the one before.
    rises: bool,
}

impl SetPoints {
    /// None yet.
    pub const NONE: Self = Self { last: 0, rises: false };

    /// Whether a current has a new way to go: by a step of more than half of it, and so not by the noise of a user's own loop.
    #[inline(always)]
    pub const fn steps(&mut self, current: i32) -> bool {
        let change = current.wrapping_sub(core::mem::replace(&mut self.last, current));
        change.unsigned_abs() > current.unsigned_abs() / 2
    }

    /// Whether a speed or a position comes back after it went away, or goes away after it came back: the acceleration turns
    /// round.
    #[inline(always)]
    pub const fn comes_back(&mut self, value: i32) -> bool {
        let change = value.wrapping_sub(core::mem::replace(&mut self.last, value));
        change != 0 && core::mem::replace(&mut self.rises, change > 0) != (change > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_current_has_a_new_way_to_go_by_a_step_and_not_by_its_noise() {
        let mut set_points = SetPoints::NONE;
        let turned = [100, 100, 110, 95, -95, -100, 0, 0, 100, 300].map(|current| set_points.steps(current));
        assert_eq!(turned, [true, false, false, false, true, false, true, false, true, true]);
    }

    #[test]
    fn a_speed_or_a_position_turns_round_where_it_comes_back() {
        let mut set_points = SetPoints::NONE;
        let turned = [0, 100, 200, 200, 300, -300, -300, -400, 400, 100].map(|value| set_points.comes_back(value));
        assert_eq!(turned, [false, true, false, false, false, true, false, false, true, true]);
    }
}
