//! A rotor that does not turn at the largest current.

use crate::control::config::Config;

/// What a check that finds the rotor turning takes off the count of those that found it at rest.
const RECOVERY: u32 = 4;

/// Checks, 64 steps apart, that found the rotor at rest with the current at its limit, less
/// what recovery took off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall(u32);

impl Stall {
    /// None so far.
    pub const NONE: Self = Self(0);

    /// Whether the rotor has stood still with the current at its limit for too long.
    #[inline(always)]
    pub fn is_stalled(&mut self, config: &Config, limited: bool, speed: i32) -> bool {
        let rest_speed = config.guard.rest_speed;
        let stands = limited && speed.wrapping_add(rest_speed) as u32 <= 2 * rest_speed as u32;
        if !stands {
            // The speed is noisy: a single check above the threshold must not clear the count.
            self.0 = self.0.saturating_sub(RECOVERY);
            return false;
        }
        self.0 += 1;
        self.0 > config.guard.stall
    }
}
