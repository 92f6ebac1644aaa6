//! Periods in which the bridge has to be off, whatever the commands say.

use super::{Drive, Refusal};
use crate::board::{Interlock, Output, Sample};
use crate::fault::Fault;

impl Drive {
    /// One PWM period with an interlock, in place of [`step`](Self::step), which so has nothing to look at: the bridge
    /// is off, and everything else goes on.
    #[inline(always)]
    pub fn step_off(&mut self, sample: &Sample, interlock: Interlock) -> Output {
        self.go_on_off(sample, interlock);
        Output::OFF
    }

    /// The work of such a period: without an output, which would have to lie in memory.
    #[cold]
    #[inline(never)]
    fn go_on_off(&mut self, sample: &Sample, interlock: Interlock) {
        self.disabled = interlock == Interlock::Disabled;
        self.yield_to(interlock);
        self.general_step(sample);
        // A command that was due in this step may have armed.
        self.yield_to(interlock);
        self.disabled = false;
    }

    fn yield_to(&mut self, interlock: Interlock) {
        match interlock {
            Interlock::Disabled => {
                self.give_up_arming(Err(Refusal::Fault(Fault::Disabled)));
                self.fail(Fault::Disabled);
            }
            Interlock::Stop => {
                // As one that has armed and is disarmed at once.
                self.give_up_arming(Ok(()));
                // Refused where the bridge is off already.
                let _ = self.disarm();
            }
        }
    }
}
