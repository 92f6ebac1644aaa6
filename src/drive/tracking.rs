//! Tracking of the rotor, and what is done about samples without a plausible angle.

use super::{Drive, OUTER};
use crate::angle::ElectricalAngle;
use crate::control::current::PARK_BITS;
use crate::fault::{Fault, Limits};
use crate::hall::Codes;
use crate::hall::plausibility::Implausible;
use crate::hall::track::{Jump, Tracker};

impl Drive {
    /// Angle and speed from the Halls: from all three, or from two after the loss of one.
    pub(super) fn measure(&mut self, codes: &Codes) {
        match (self.hall_loss.lost, &self.estimator) {
            (Some(lost), _) if self.mode.drives() => self.measure_without(lost, *codes),
            (_, Some(estimator)) => match estimator.angle(codes) {
                Ok(angle) => self.track(angle - self.correction),
                Err(why) => self.no_angle(why),
            },
            (_, None) => {}
        }
        self.resolve_suspicion(*codes);
    }

    /// What the Halls' angle is ahead by, for the steps until it is looked up again: by the map in their middle, less
    /// what the rotor turns while the Halls' signals are late, and by the field of the windings.
    #[inline(always)]
    pub(super) fn look_up_correction(&mut self) {
        let rotor = &self.record.rotor;
        let mut correction = ElectricalAngle::ZERO;
        if let Some(map) = self.map() {
            // The fastest rotor turns a twentieth in a step, so this is no half turn. The smoothed angle, as the last
            // measured one still has the correction of where the rotor was.
            let ahead = rotor.speed().wrapping_mul(OUTER as i32 + 1) >> 1;
            let position = rotor.position().advance_to(rotor.angle() + ElectricalAngle::from_bits(ahead));
            correction = ElectricalAngle::from_bits(map.value(position));
        }
        if let Some(control) = &self.config.control {
            let behind = (rotor.speed() >> 8).wrapping_mul(control.hall_delay.into());
            // The current that is measured, as where the voltage is at its limit it is not the one that is asked for; 0
            // where none is.
            let turned = (self.servo.current().q >> PARK_BITS).wrapping_mul(control.hall_coil);
            correction += ElectricalAngle::from_bits(turned.wrapping_sub(behind));
        }
        self.correction = correction;
    }

    /// The turns are counted anew: the pole is not known any more.
    #[cold]
    pub(super) fn forget_pole(&mut self) {
        for table in [self.map(), self.servo.cogging_by_pole()].into_iter().flatten() {
            table.count_anew();
        }
        self.correction = ElectricalAngle::ZERO;
    }

    /// Takes up an angle.
    fn track(&mut self, angle: ElectricalAngle) {
        match self.record.rotor.step(&self.config.tracking, angle) {
            Ok(()) => self.angle_found(),
            Err(Jump) => self.angle_jumped(angle),
        }
    }

    /// The angle is plausible, perhaps again.
    pub(super) fn angle_found(&mut self) {
        if self.record.missed != 0 {
            self.record.missed = 0;
            self.limits = self.limits.without(Limits::EXTRAPOLATED);
            self.publish();
        }
    }

    /// No angle fits the codes.
    fn no_angle(&mut self, why: Implausible) {
        self.record.rotor.coast();
        if self.count_missed() {
            return;
        }
        if !self.mode.drives() {
            // Nothing is known of the rotor, so it is not extrapolated any longer.
            self.record.rotor = Tracker::at(self.record.rotor.angle());
            self.forget_pole();
        }
        self.fail_or_suspect(Fault::Hall(why));
    }

    /// The angle is farther from the tracked one than the rotor can have turned.
    fn angle_jumped(&mut self, angle: ElectricalAngle) {
        if self.count_missed() {
            return;
        }
        if !self.mode.drives() {
            // With the bridge off, an angle that persists is believed.
            self.record.rotor = Tracker::at(angle);
            self.forget_pole();
            self.angle_found();
        }
        self.fail_or_suspect(Fault::AngleJump);
    }

    /// Counts a sample without a plausible angle; false when they are too many.
    pub(super) fn count_missed(&mut self) -> bool {
        self.record.missed = self.record.missed.saturating_add(1);
        self.limits = self.limits.with(Limits::EXTRAPOLATED);
        let tolerated = self.record.missed <= self.config.tolerated;
        // Otherwise the fault is published, or that the angle was found by two Halls.
        if tolerated || !self.mode.drives() {
            self.publish();
        }
        tolerated
    }
}
