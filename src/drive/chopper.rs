//! The output for a brake resistor, beside the output for the bridge.

use super::Drive;
use crate::board::Sample;

impl Drive {
    /// Whether the brake resistor is to be on from now on, for a board that has a pin for it; `None` where it stays as
    /// it is. To be called after each [`step`](Self::step) or [`step_off`](Self::step_off), with the same sample.
    /// Whether the bridge is on does not matter: what turns the motor from outside charges the bus by the bridge's
    /// diodes.
    ///
    /// It is decided every [`OUTER`](super::OUTER) periods, 200 µs at 40 kHz. A running drive that needs a resistor
    /// which was on for too long fails, and its bridge is off in the next period. Not a part of the step: a board
    /// without the pin pays nothing. Never on with the feature `no-chopper`.
    #[inline(always)]
    pub fn chopper(&mut self, sample: &Sample) -> Option<bool> {
        #[cfg(feature = "no-chopper")]
        let on = {
            let _ = sample;
            None
        };
        #[cfg(not(feature = "no-chopper"))]
        let on = self.switch_chopper(sample);
        on
    }
}

#[cfg(not(feature = "no-chopper"))]
mod switched {
    use super::{Drive, Sample};
    use crate::fault::Fault;

    /// The step, of each eight, that decides: not one with an outer loop, lest the longest step become longer.
    const STEP: u32 = 5;

    impl Drive {
        #[inline(always)]
        pub(super) fn switch_chopper(&mut self, sample: &Sample) -> Option<bool> {
            self.servo.schedule.is_step(STEP).then(|| self.decide_chopper(sample))
        }

        /// A resistor that is cold and not needed, as nearly always, is dealt with here, in few registers: the rest would
        /// save others to the stack first.
        #[inline(never)]
        fn decide_chopper(&mut self, sample: &Sample) -> bool {
            match &self.config.control {
                Some(control) if !self.chopper.idles(&control.chopper, control.bus(sample.bus)) => {
                    self.switch_as_needed(sample)
                }
                _ => false,
            }
        }

        #[inline(never)]
        fn switch_as_needed(&mut self, sample: &Sample) -> bool {
            let Some(control) = &self.config.control else { return false };
            if !self.chopper.decide(&control.chopper, control.bus(sample.bus)) {
                self.fail(Fault::BrakeResistor);
            }
            self.chopper.is_on()
        }
    }
}
