//! A rotor that does not turn at the largest current.

use crate::control::config::Config;

/// What a check that finds the rotor turning takes off the count of those that found it at rest.
const RECOVERY: u32 = 4;

/// Checks over which the speed, which is noisy, is averaged, as a power of two.
const AVERAGED: u32 = 4;

/// What is known of a stall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall {
    /// Checks, 64 steps apart, that found the rotor at rest with the current at its limit, less what recovery took off.
    count: u32,
    /// Averaged speed.
    speed: i32,
}

impl Stall {
    /// None so far.
    pub const NONE: Self = Self { count: 0, speed: 0 };

    /// Whether the rotor has stood still with the current at its limit for too long.
    #[inline(always)]
    pub fn is_stalled(&mut self, config: &Config, limited: bool, speed: i32) -> bool {
        let rest_speed = config.guard.rest_speed;
        self.speed += (speed - self.speed) >> AVERAGED;
        let stands = limited && self.speed.wrapping_add(rest_speed) as u32 <= 2 * rest_speed as u32;
        if !stands {
            self.count = self.count.saturating_sub(RECOVERY);
            return false;
        }
        self.count += 1;
        self.count > config.guard.stall
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};

    #[test]
    fn a_rotor_that_has_turned_for_a_quarter_of_the_time_may_stand_again() {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let longest = config.guard.stall;
        let mut stall = Stall::NONE;
        for _ in 0..2 {
            assert!((0..longest).all(|_| !stall.is_stalled(&config, true, 0)));
            assert!((0..longest.div_ceil(4)).all(|_| !stall.is_stalled(&config, false, 0)));
        }
        let checks = (0..).take_while(|_| !stall.is_stalled(&config, true, 0)).count();
        assert_eq!(checks, longest as usize);
    }
}
