//! No command for too long.

use crate::control::config::Config;

/// Steps of the outer loops that are left until the command times out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeout(u32);

impl Timeout {
    /// Nothing that could time out.
    pub const NONE: Self = Self(u32::MAX);

    /// A command came; it may have a time of its `own`.
    pub fn restart(&mut self, config: &Config, own: Option<u32>) {
        self.0 = own.unwrap_or(config.guard.timeout);
    }

    /// Whether no command has come for too long; to be asked once every step of the outer loops.
    #[inline(always)]
    pub fn is_overdue(&mut self) -> bool {
        self.0 = self.0.saturating_sub(1);
        self.0 == 0
    }
}
