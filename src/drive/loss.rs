//! Running on from two Halls when the third is lost.

use super::Drive;
use crate::angle::ElectricalAngle;
use crate::fault::{Fault, Limits};
use crate::hall::normalize::Implausible;
use crate::hall::{Channel, Codes};
use crate::mode::Mode;

/// Farthest that two Halls' angle may be from the tracked one to be believed, in bits: 30°.
const NEAR: u32 = ElectricalAngle::THIRD.to_bits() as u32 / 4;

impl Drive {
    /// Names the Hall that is lost and goes on without it, if that is wanted, none was lost before, and the other two say
    /// that the rotor is about where it was tracked.
    #[cold]
    pub(super) fn runs_on_without(&mut self, why: Implausible, codes: Codes) -> bool {
        if !self.config.run_on_two_halls || self.mode != Mode::Running || self.lost.is_some() {
            return false;
        }
        let Some((lost, angle)) = self.name(why, codes) else { return false };
        self.lost = Some(lost);
        self.limits = self.limits.with(Limits::TWO_HALLS);
        // What was missed while finding out is made up for.
        let _ = self.live.rotor.step(&self.config.tracking, angle);
        self.found();
        true
    }

    /// The Hall to do without, and the angle then.
    fn name(&self, why: Implausible, codes: Codes) -> Option<(Channel, ElectricalAngle)> {
        let estimator = self.estimator.as_deref()?;
        let tracked = self.live.rotor.angle();
        let suspects = match why {
            Implausible::AtRail(channel) | Implausible::OutOfRange(channel) => channel.0..=channel.0,
            Implausible::Inconsistent => 0..=2,
            Implausible::Weak | Implausible::Strong => return None,
        };
        let (distance, channel, angle) = suspects
            .filter_map(|k| {
                let angle = estimator.angle_without(Channel(k), &codes)?;
                Some(((angle - tracked).to_bits().unsigned_abs(), Channel(k), angle))
            })
            .min_by_key(|&(distance, ..)| distance)?;
        (distance <= NEAR).then_some((channel, angle))
    }

    /// Angle and speed from the other two.
    #[cold]
    pub(super) fn measure_without(&mut self, lost: Channel, codes: Codes) -> bool {
        let angle = self.estimator.as_deref().and_then(|estimator| estimator.angle_without(lost, &codes));
        let Some(angle) = angle else { return self.fail(Fault::AngleJump) };
        if self.live.rotor.step(&self.config.tracking, angle).is_err() {
            return self.miss() || self.fail(Fault::AngleJump);
        }
        if self.live.missed != 0 {
            self.found();
        }
        if self.live.rotor.speed().unsigned_abs() > self.config.fastest as u32 {
            return self.fail(Fault::OverSpeed);
        }
        true
    }

    /// An estimator has been installed: a running drive that has lost a Hall keeps the limit, whichever it is; at rest, one
    /// for three Halls stands for a repair.
    pub(super) fn take_up_loss(&mut self) {
        let knows = self.estimator.as_deref().is_some_and(|estimator| estimator.lost().is_some());
        if knows {
            self.lost = None;
            self.limits = self.limits.with(Limits::TWO_HALLS);
        } else if self.mode != Mode::Running {
            self.forget_loss();
        }
        self.publish();
    }

    /// A new calibration begins.
    pub(super) fn forget_loss(&mut self) {
        self.lost = None;
        self.limits = self.limits.without(Limits::TWO_HALLS);
    }
}
