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
