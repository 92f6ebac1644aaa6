//! No command for too long.

use crate::control::config::Config;

/// Steps of the outer loops since the last command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeout(u32);

impl Timeout {
    /// A command just came.
    pub const NONE: Self = Self(0);

    /// Whether no command has come for too long; to be asked once every step of the outer loops.
    #[inline(always)]
    pub fn is_overdue(&mut self, config: &Config) -> bool {
        self.0 = self.0.saturating_add(1);
        config.guard.timeout != 0 && self.0 >= config.guard.timeout
    }
}
