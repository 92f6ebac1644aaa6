//! Which tool controls the drive, and whether it lives.

/// The tool that controls, if one does. Any number of others may read.
#[derive(Default)]
pub(crate) struct Controller {
    /// Its number; 0 for none.
    client: u32,
    /// When it was heard last, ms, wrapping: who is silent loses the control long before.
    heard_ms: u32,
    /// Whether what it began is to end when it falls silent.
    attended: bool,
    /// The one that fell silent last while it controlled, the bridge on; 0 for none.
    silent: u32,
    /// Whether the drive has stopped its motor for want of commands since.
    stopped: bool,
}

impl Controller {
    /// The tool that controls, 0 for none.
    pub const fn client(&self) -> u32 {
        self.client
    }

    /// A request of a tool has come, of whatever kind.
    pub const fn hear(&mut self, client: u32, now_ms: u64) {
        if client == self.client {
            self.heard_ms = now_ms as u32;
        }
    }

    /// Whether another tool controls.
    pub const fn is_other(&self, client: u32) -> bool {
        self.client != 0 && self.client != client
    }

    /// Takes the control for a tool that is to change something; false where another one has it.
    pub const fn take(&mut self, client: u32, unattended: bool, now_ms: u64) -> bool {
        if self.is_other(client) {
            return false;
        }
        (self.client, self.heard_ms, self.attended) = (client, now_ms as u32, !unattended);
        true
    }

    /// A tool gives the control up; what another one has stays.
    pub const fn release(&mut self, client: u32) {
        if client == self.client {
            self.client = 0;
        }
        if client == self.silent {
            self.silent = 0;
        }
    }

    /// Nobody controls any more.
    pub const fn end(&mut self) {
        (self.client, self.silent) = (0, 0);
    }

    /// Whether a tool was the last one that has lost the control by its silence, the motor was stopped, and it has not
    /// released the drive since.
    pub const fn bars(&self, client: u32) -> bool {
        self.stopped && self.silent != 0 && client == self.silent
    }

    /// Once a millisecond: whether the bridge is on, and whether the drive has stopped its motor for want of commands, which
    /// a setting that comes ends. Who was silent with the bridge off has missed nothing.
    pub const fn watch(&mut self, drives: bool, stopped: bool) {
        if !drives {
            self.silent = 0;
        }
        self.stopped = self.silent != 0 && (self.stopped || stopped);
    }

    /// Ends the control by a tool that was silent for longer than `timeout_ms`. True, once, if what it began has to end
    /// with it.
    pub const fn is_abandoned(&mut self, now_ms: u64, timeout_ms: u32) -> bool {
        if (now_ms as u32).wrapping_sub(self.heard_ms) <= timeout_ms {
            return false;
        }
        if self.client != 0 {
            self.stopped = self.stopped && self.silent == self.client;
            (self.silent, self.client) = (self.client, 0);
        }
        core::mem::replace(&mut self.attended, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_controls_until_it_releases_or_falls_silent() {
        let mut controller = Controller::default();
        assert!(controller.take(7, false, 100) && !controller.take(8, false, 150));
        // Another's requests are no sign of life, nor does its release count.
        controller.hear(8, 1000);
        controller.release(8);
        assert!(!controller.is_abandoned(1100, 1000) && controller.client() == 7);
        controller.hear(7, 1000);
        assert!(!controller.is_abandoned(2000, 1000) && controller.is_abandoned(2001, 1000));
        assert_eq!(controller.client(), 0);
        assert!(controller.take(8, false, 2001));
        controller.release(8);
        assert!(controller.take(7, false, 2002));
    }

    #[test]
    fn who_was_silent_is_known_until_it_releases_or_all_ends() {
        let silent = || {
            let mut controller = Controller::default();
            assert!(!controller.is_abandoned(1001, 1000));
            controller.watch(true, true);
            assert!(!controller.bars(0));
            controller.take(7, false, 2000);
            controller.watch(true, true);
            assert!(!controller.bars(7) && controller.is_abandoned(3001, 1000));
            controller
        };
        let mut controller = silent();
        // Its command may hold for longer.
        controller.watch(true, false);
        assert!(!controller.bars(7));
        controller.watch(true, true);
        // What it may do all the same, and what others do, changes nothing.
        controller.take(7, false, 3100);
        controller.release(8);
        controller.watch(true, false);
        assert!(controller.bars(7) && !controller.bars(8) && !controller.bars(0));
        // Nor does another silence, but of another tool.
        controller.is_abandoned(4200, 1000);
        assert!(controller.bars(7));
        controller.take(8, false, 4300);
        controller.is_abandoned(5400, 1000);
        assert!(!controller.bars(7) && !controller.bars(8));
        let stopped = || {
            let mut controller = silent();
            controller.watch(true, true);
            assert!(controller.bars(7));
            controller
        };
        let ends: [fn(&mut Controller); 3] = [|of| of.release(7), Controller::end, |of| of.watch(false, true)];
        for end in ends {
            let mut controller = stopped();
            end(&mut controller);
            controller.watch(true, true);
            assert!(!controller.bars(7) && !controller.bars(0));
        }
    }

    #[test]
    fn what_was_begun_unattended_is_never_abandoned() {
        let mut controller = Controller::default();
        assert!(controller.take(7, true, 0) && !controller.is_abandoned(5000, 1000));
        // Another tool may control then, and what it begins is its own.
        assert!(controller.take(8, false, 5000) && controller.is_abandoned(7000, 1000));
    }
}
