//! Running on from two Halls when the third is lost.

use super::Drive;
use crate::angle::{ElectricalAngle, Position};
use crate::fault::{Fault, Limits};
use crate::hall::estimate::Estimator;
use crate::hall::plausibility::Implausible;
use crate::hall::{Channel, Codes, Halls};
use crate::mode::Mode;

/// Farthest that two Halls' angle may be from the tracked one to be believed, in bits: 90°.
const NEAR: u32 = 1 << 30;

/// Farthest that two Halls' strength may be from [`Estimator::NOMINAL_STRENGTH`]: harmonics and drift together stay
/// below.
const UNHEALTHY: u16 = 450;

/// A Hall that goes through so many times less than another one is stuck. At the peak of a healthy one, where it changes
/// least, another goes through four times as much.
const UNMOVED: u32 = 8;

/// The doubt is about the mean of so many steps, 2ⁿ.
const DOUBT_BITS: u32 = 10;

/// A pair of more doubt has the lost Hall in it, and has lost its turns. If that Hall heals, a pair that counts on from
/// there may be taken at the next loss.
const ASTRAY: u32 = (UNHEALTHY as u32) << DOUBT_BITS;

/// What is known and suspected of a lost Hall.
#[derive(Clone, Copy, Debug)]
pub(super) struct HallLoss {
    /// The Hall that was lost while running, until an estimator without it is installed.
    pub lost: Option<Channel>,
    /// The fault to latch unless the other two Halls give the angle; set and resolved within a step.
    suspicion: Option<Fault>,
    /// By Hall, the rotor as the other two see it, from the loss on.
    without: [View; 3],
}

/// The rotor as two Halls see it, and what the third one does.
#[derive(Clone, Copy, Debug)]
struct View {
    /// With its turns: each view counts its own, as that of a pair with the lost Hall in it goes to and fro.
    position: Position,
    /// The mean of `off` over the last steps, times 2ⁿ of them.
    doubt: u32,
    /// What their strength is off by, in 1/1024.
    off: u16,
    /// Lowest and highest code of the third.
    lowest: u16,
    highest: u16,
}

impl View {
    const NONE: Self = Self { position: Position::from_bits(0), doubt: 0, off: 0, lowest: u16::MAX, highest: 0 };

    /// Takes the next angle and strength, and the code of the third, of a rotor that is tracked there.
    fn take(&mut self, angle: ElectricalAngle, strength: u32, third: u16, tracked: Position) {
        let counted = if self.doubt > ASTRAY { tracked } else { self.position };
        self.position = counted.advance_to(angle);
        let off = strength.abs_diff(Estimator::NOMINAL_STRENGTH).min(Estimator::NOMINAL_STRENGTH);
        self.doubt = self.doubt - (self.doubt >> DOUBT_BITS) + off;
        self.off = off as u16;
        self.lowest = self.lowest.min(third);
        self.highest = self.highest.max(third);
    }

    /// Codes that the third Hall went through.
    const fn span(&self) -> u32 {
        self.highest.saturating_sub(self.lowest) as u32
    }
}

impl HallLoss {
    /// All three are there.
    pub const NONE: Self = Self { lost: None, suspicion: None, without: [View::NONE; 3] };

    fn without(&mut self, lost: Channel) -> &mut View {
        // So that the compiler sees that it is in range.
        &mut self.without[usize::from(lost.0.min(2))]
    }
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

    /// Resolves a suspicion, if there is one.
    #[inline(always)]
    pub(super) fn resolve_suspicion(&mut self, codes: Codes) {
        if let Some(fault) = self.hall_loss.suspicion.take() {
            self.suspect(fault, codes);
        }
    }

    /// Names the Hall that is lost and goes on without it, if the other two say that the rotor is about where it was
    /// tracked; otherwise it is a fault.
    #[cfg_attr(not(feature = "small"), cold, inline(never))]
    #[cfg_attr(feature = "small", inline(always))]
    fn suspect(&mut self, fault: Fault, codes: Codes) {
        let suspects = match fault {
            Fault::Hall(Implausible::AtRail(channel) | Implausible::OutOfRange(channel)) => channel.0..=channel.0,
            Fault::Hall(Implausible::Inconsistent) | Fault::AngleJump => 0..=2,
            _ => return self.fail(fault),
        };
        let rotor = &self.record.rotor;
        self.hall_loss.without = [View { position: rotor.smoothed(), ..View::NONE }; 3];
        if !self.view_by_two(&codes) {
            return self.fail(fault);
        }
        let tracked = self.record.rotor.angle();
        let distance = |view: &View| (view.position.angle() - tracked).to_bits().unsigned_abs();
        for (k, view) in (0..).zip(&mut self.hall_loss.without) {
            // A pair with the lost Hall in it is in the wrong place, and too strong or too weak: 30° count as much as a
            // third of the strength.
            view.doubt = ((distance(view) >> 20) + u32::from(view.off)).min(UNHEALTHY.into()) << DOUBT_BITS;
            if !suspects.contains(&k) {
                view.off = u16::MAX;
            }
        }
        let lost = self.least_doubted();
        match lost.filter(|&lost| distance(self.hall_loss.without(lost)) <= NEAR) {
            Some(lost) => self.go_on_without(lost),
            None => self.fail(fault),
        }
    }

    /// The Hall without which the other two fit best.
    #[inline(never)]
    fn least_doubted(&self) -> Option<Channel> {
        let (mut least, mut found) = (u32::MAX, None);
        for (k, view) in (0..).zip(&self.hall_loss.without) {
            if view.off <= UNHEALTHY && view.doubt < least {
                (least, found) = (view.doubt, Some(Channel(k)));
            }
        }
        found
    }

    /// What each two of the Halls say; false where the estimator knows of two only.
    fn view_by_two(&mut self, codes: &Codes) -> bool {
        let Self { estimator: Some(estimator), hall_loss, correction, record, .. } = self else { return false };
        for ((view, &third), k) in hall_loss.without.iter_mut().zip(codes).zip(0..) {
            let Some((angle, strength)) = estimator.angle_without(Channel(k), codes) else { return false };
            view.take(angle - *correction, strength, third, record.rotor.position());
        }
        true
    }

    /// Takes a Hall for lost. Until it was found, it has pulled the tracked angle away.
    fn go_on_without(&mut self, lost: Channel) {
        self.hall_loss.lost = Some(lost);
        self.limits = self.limits.with(Limits::TWO_HALLS);
        self.record.rotor.put_at(self.hall_loss.without(lost).position);
        self.record.missed = 0;
        self.limits = self.limits.without(Limits::EXTRAPOLATED);
        self.publish();
    }

    /// Angle and speed from the other two.
    #[cold]
    pub(super) fn measure_without(&mut self, lost: Channel, codes: Codes) {
        self.view_by_two(&codes);
        let (view, rotor) = (self.hall_loss.without(lost), &mut self.record.rotor);
        if view.off > UNHEALTHY {
            rotor.coast();
        } else if rotor.step(&self.config.tracking, view.position.angle()).is_ok() {
            // Samples that were refused may have taken it half a turn and more away.
            view.position = rotor.position();
            let doubt = view.doubt;
            return match self.find_unmoved(doubt) {
                Some(lost) => self.go_on_without(lost),
                None => self.angle_found(),
            };
        }
        self.find_other_loss();
    }

    /// The Hall that is stuck though it was not taken for the lost one: it stays where it is while both others move, and
    /// they fit better without it. Otherwise a rotor may rock for ever about where the wrong two see it turn the other
    /// way, with a strength that a magnet may have. Were one enough, a lost Hall that wanders would do at a rotor at rest.
    fn find_unmoved(&self, doubt: u32) -> Option<Channel> {
        let (mut least, mut second, mut found) = (u32::MAX, u32::MAX, None);
        for (k, view) in (0..).zip(&self.hall_loss.without) {
            let span = view.span();
            second = second.min(span.max(least));
            if span < least {
                (least, found) = (span, (view.doubt < doubt).then_some(Channel(k)));
            }
        }
        found.filter(|_| UNMOVED * least < second)
    }

    /// The two do not agree: the wrong Hall was taken for the lost one, or another is lost, too.
    fn find_other_loss(&mut self) {
        if self.count_missed() {
            return;
        }
        match self.least_doubted() {
            Some(lost) => self.go_on_without(lost),
            None => self.fail(Fault::Hall(Implausible::Inconsistent)),
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
