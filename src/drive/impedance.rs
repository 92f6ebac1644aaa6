//! Impedance control within the drive: when a spring and a damper are taken up, and what the slots do with them.

use super::arming::Pending;
use super::servo::{Context, Servo, coarse, within_speed};
use super::{Demand, Drive, Refusal, Reply};
use crate::control::Impedance;
use crate::control::config::Motion;
use crate::mode::Mode;

impl Drive {
    /// Takes up a spring and a damper. Its memory goes back where it is refused, otherwise that of the one before.
    pub(super) fn follow_impedance(&mut self, impedance: &'static mut Impedance) -> Reply {
        let allowed = self.allows(impedance);
        let unused = if allowed.is_ok() { self.servo.impedance.replace(impedance) } else { Some(impedance) };
        if let Some(unused) = unused {
            let _ = self.channels.impedances.enqueue(unused);
        }
        allowed?;
        if self.arming.is_active() {
            self.arming.pending = Some(Pending::Demand(Demand::Impedance));
        } else {
            self.take_up(Demand::Impedance);
        }
        Ok(())
    }

    fn allows(&self, impedance: &Impedance) -> Reply {
        let motion = &self.config.control.as_ref().ok_or(Refusal::NoControl)?.motion;
        if self.mode != Mode::Running {
            return Err(Refusal::Mode(self.mode));
        }
        if !impedance.reference.is_within(&motion.bounds) {
            return Err(Refusal::OutOfBounds);
        }
        let here = coarse(self.record.rotor.position()).to_bits();
        match impedance.reference.jumps_to() {
            Some(at) if impedance.is_sprung() && at.abs_diff(here) > motion.far as u64 => Err(Refusal::TooFar),
            _ => Ok(()),
        }
    }
}

impl Servo {
    /// The current of the spring and the damper: none that makes the rotor faster than allowed, or leads it away from
    /// its bounds.
    #[inline(always)]
    pub(super) fn impedance_loop(&self, with: &Context) -> i32 {
        let Some(impedance) = self.impedance.as_deref() else { return 0 };
        let ahead = (self.trajectory.position().to_bits(), self.trajectory.speed());
        let position = coarse(with.rotor.smoothed()).to_bits();
        let current = within_speed(impedance.current(ahead, position, with.rotor.speed()), with);
        if !self.ends {
            return current;
        }
        let [least, most] = with.config.motion.bounds;
        let outward = if current < 0 { position < least } else { position > most };
        if outward { 0 } else { current }
    }

    /// The reference does not run away from a rotor that cannot follow, but waits; whether the rotor is outside of its
    /// bounds.
    #[inline(always)]
    pub(super) fn attend_to_impedance(&mut self, with: &Context) {
        let Motion { bounds, far, .. } = &with.config.motion;
        let here = coarse(with.rotor.position()).to_bits();
        self.ends = here < bounds[0] || here > bounds[1];
        let ahead = self.distance(with);
        self.waits = self.impedance.as_deref().is_some_and(|impedance| {
            let back = impedance.reference.goal(&self.trajectory, bounds) < self.trajectory.position().to_bits();
            impedance.is_sprung() && ahead.unsigned_abs() > *far as u64 / 4 && (ahead < 0) == back
        });
    }

    /// Whether the spring is strained farther than the rotor may be from its reference.
    #[inline(always)]
    pub(super) fn is_strained(&self, with: &Context) -> bool {
        let sprung = self.impedance.as_deref().is_some_and(Impedance::is_sprung);
        sprung && self.distance(with).unsigned_abs() > with.config.motion.far as u64
    }
}
