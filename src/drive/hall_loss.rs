//! Running on from two Halls when the third is lost.

use super::Drive;
use crate::angle::ElectricalAngle;
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::hall::plausibility::Implausible;
use crate::hall::{Channel, Codes, Halls};
use crate::mode::Mode;

/// Farthest that two Halls' angle may be from the tracked one to be believed, in bits: 45°.
const NEAR: u32 = 1 << 29;

/// Farthest that two Halls' strength may be from [`Estimator::NOMINAL_STRENGTH`]: harmonics and drift together stay
/// below.
const UNHEALTHY: u32 = 450;

/// What is known and suspected of a lost Hall.
#[derive(Clone, Copy, Debug)]
pub(super) struct HallLoss {
    /// The Hall that was lost while running, until an estimator without it is installed.
    pub lost: Option<Channel>,
    /// The fault to latch unless the other two Halls give the angle; set and resolved within a step.
    suspicion: Option<Fault>,
}

impl HallLoss {
    /// All three are there.
    pub const NONE: Self = Self { lost: None, suspicion: None };
}

impl Drive {
    /// Latches a fault, or only notes a suspicion if the drive may run on two Halls and none was lost before.
    pub(super) fn fail_or_suspect(&mut self, fault: Fault) {
        if self.config.run_on_two_halls && self.mode == Mode::Running && self.hall_loss.lost.is_none() {
            self.hall_loss.suspicion = Some(fault);
        } else {
            self.fail(fault);
        }
    }

    /// Resolves a suspicion: names the Hall that is lost and goes on without it, if the other two say that the rotor is
    /// about where it was tracked; otherwise it is a fault.
    pub(super) fn resolve_suspicion(&mut self, codes: Codes) {
        let Some(fault) = self.hall_loss.suspicion.take() else { return };
        let Some((lost, angle)) = self.find_lost_hall(fault, codes) else { return self.fail(fault) };
        self.hall_loss.lost = Some(lost);
        self.limits = self.limits.with(Limits::TWO_HALLS);
        // Until it was found, the lost Hall has pulled the tracked angle away.
        self.record.rotor.move_to(angle);
        self.angle_found();
    }

    /// The lost Hall, and the angle by the other two.
    fn find_lost_hall(&self, fault: Fault, codes: Codes) -> Option<(Channel, ElectricalAngle)> {
        let estimator = self.estimator()?;
        let tracked = self.record.rotor.angle();
        let suspects = match fault {
            Fault::Hall(Implausible::AtRail(channel) | Implausible::OutOfRange(channel)) => channel.0..=channel.0,
            Fault::Hall(Implausible::Inconsistent) | Fault::AngleJump => 0..=2,
            _ => return None,
        };
        let (_, distance, channel, angle) = suspects
            .filter_map(|k| {
                let (angle, strength) = estimator.angle_without(Channel(k), &codes)?;
                let angle = angle - self.correction;
                let distance = (angle - tracked).to_bits().unsigned_abs();
                // A pair with the lost Hall in it is in the wrong place, and too strong or too weak: 30° count as much
                // as a third of the strength.
                let doubt = (distance >> 20).saturating_add(strength.abs_diff(Estimator::NOMINAL_STRENGTH));
                Some((doubt, distance, Channel(k), angle))
            })
            .min_by_key(|&(doubt, ..)| doubt)?;
        (distance <= NEAR).then_some((channel, angle))
    }

    /// Angle and speed from the other two.
    #[cold]
    pub(super) fn measure_without(&mut self, lost: Channel, codes: Codes) {
        let pair = self.estimator().and_then(|estimator| estimator.angle_without(lost, &codes));
        let healthy = pair.filter(|(_, strength)| strength.abs_diff(Estimator::NOMINAL_STRENGTH) <= UNHEALTHY);
        match healthy.map(|(angle, _)| self.record.rotor.step(&self.config.tracking, angle - self.correction)) {
            Some(Ok(())) => self.angle_found(),
            _ => self.find_other_loss(lost, codes),
        }
    }

    /// The two do not agree: the wrong Hall was taken for the lost one, or another is lost, too. The wrong pair has
    /// moved the tracked angle, so the strength alone decides.
    fn find_other_loss(&mut self, lost: Channel, codes: Codes) {
        let best = self.estimator().and_then(|estimator| {
            let others = (0..3).map(Channel).filter(|&channel| channel != lost);
            let pair = |channel| Some((channel, estimator.angle_without(channel, &codes)?));
            others.filter_map(pair).min_by_key(|(_, (_, strength))| strength.abs_diff(Estimator::NOMINAL_STRENGTH))
        });
        match best {
            Some((channel, (angle, strength))) if strength.abs_diff(Estimator::NOMINAL_STRENGTH) <= UNHEALTHY => {
                self.hall_loss.lost = Some(channel);
                self.record.rotor.move_to(angle - self.correction);
            }
            _ => {
                self.record.rotor.coast();
                if !self.count_missed() {
                    self.fail(Fault::Hall(Implausible::Inconsistent));
                }
            }
        }
    }

    /// An estimator has been installed. Only one for three Halls that comes of a calibration ends the loss of a Hall:
    /// others are learnt, or have another direction.
    pub(super) fn update_hall_loss(&mut self, calibrated: bool) {
        let knows = self.estimator().is_some_and(|estimator| estimator.lost().is_some());
        let meant = self.config.halls == Halls::Two;
        if knows && !meant {
            self.hall_loss.lost = None;
            self.limits = self.limits.with(Limits::TWO_HALLS);
        } else if calibrated || meant {
            self.hall_loss.lost = None;
            self.limits = self.limits.without(Limits::TWO_HALLS);
        }
        self.publish();
    }
}
