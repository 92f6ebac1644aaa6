//! Where the rotor is, and what becomes of samples that do not tell.

use super::Drive;
use crate::angle::ElectricalAngle;
use crate::fault::{Fault, Limits};
use crate::hall::Codes;
use crate::hall::plausibility::Implausible;
use crate::hall::track::{Jump, Tracker};

impl Drive {
    /// Angle and speed from the Halls in a step that is in no hurry.
    #[inline(always)]
    pub(super) fn measure(&mut self, codes: &Codes) {
        let Some(estimator) = &self.resting else { return };
        let angle = estimator.angle(codes);
        self.track(angle, Self::found);
    }

    /// Takes up an angle, if it is one; `done` is for what else is to be done then. False when a running drive failed.
    #[inline(always)]
    pub(super) fn track(&mut self, angle: Result<ElectricalAngle, Implausible>, done: impl Fn(&mut Self)) -> bool {
        match angle {
            Ok(angle) => match self.live.rotor.step(&self.config.tracking, angle) {
                Ok(()) => {
                    done(self);
                    true
                }
                Err(Jump) => self.jumped(angle),
            },
            Err(why) => self.blind(why),
        }
    }

    /// The angle is plausible, perhaps again.
    pub(super) fn found(&mut self) {
        if self.live.missed != 0 {
            self.live.missed = 0;
            self.limits = self.limits.without(Limits::EXTRAPOLATED);
            self.publish();
        }
    }

    /// The codes are no angle.
    #[cold]
    #[inline(never)]
    fn blind(&mut self, why: Implausible) -> bool {
        self.live.rotor.coast();
        if self.miss() {
            return true;
        }
        if !self.mode.drives() {
            // Nothing is known of the rotor, so it is not turned on and on.
            self.live.rotor = Tracker::at(self.live.rotor.angle());
        }
        self.fail_unless_two_do(Fault::Hall(why))
    }

    /// The angle is not where the rotor can be.
    #[cold]
    #[inline(never)]
    pub(super) fn jumped(&mut self, angle: ElectricalAngle) -> bool {
        if self.miss() {
            return true;
        }
        if !self.mode.drives() {
            // While nothing is driven, believe what comes again and again.
            self.live.rotor = Tracker::at(angle);
            self.found();
        }
        self.fail_unless_two_do(Fault::AngleJump)
    }

    /// Counts a sample without a plausible angle; false when they are too many.
    pub(super) fn miss(&mut self) -> bool {
        self.live.missed = self.live.missed.saturating_add(1);
        self.limits = self.limits.with(Limits::EXTRAPOLATED);
        self.publish();
        self.live.missed <= self.config.tolerated
    }

    /// Angle and speed from the Halls that are left.
    #[inline(always)]
    pub(super) fn observe(&mut self, codes: &Codes) {
        match self.lost {
            None => self.measure(codes),
            Some(lost) => self.measure_without(lost, *codes),
        }
        self.runs_on(*codes);
    }
}
