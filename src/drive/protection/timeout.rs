//! No command for too long.

use crate::control::config::Config;

/// Steps of the outer loops since the last command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeout {
    steps: u32,
    /// What the command itself allows, in these steps; 0: as the settings say.
    pub own: u32,
}

impl Timeout {
    /// A command just came.
    pub const NONE: Self = Self { steps: 0, own: 0 };

    /// A command came.
    pub const fn restart(&mut self) {
        self.steps = 0;
    }

    /// Whether no command has come for too long; to be asked once every step of the outer loops.
    #[inline(always)]
    pub fn is_overdue(&mut self, config: &Config) -> bool {
        let most = if self.own != 0 { self.own } else { config.guard.timeout };
        // A command without a time-out never comes to the largest number.
        self.steps = self.steps.saturating_add(1).min(u32::MAX - 1);
        most != 0 && self.steps >= most
    }
}
