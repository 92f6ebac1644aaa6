//! Adaptation of the parameters: coverage of the turn, limits, drift, and a new model.

use super::filter::{STATES, THIRD, radians};
use super::{Adapter, Fault, Parameter, Status};
use crate::angle::ElectricalAngle;
use crate::hall::{Channel, estimate};
use crate::math::clamp;

/// Fewest samples from which a model is made.
const FEWEST_SAMPLES: u8 = 64;

impl Adapter {
    pub(super) fn follow(&mut self) -> Status {
        self.paused = self.paused.saturating_add(1);
        let eighth = self.eighth();
        if self.calibrated && self.followed_eighths & eighth == 0 {
            self.follow_eighth(eighth);
        }
        Status::Tracking
    }

    /// The eighth of the turn that the rotor is in, a bit.
    #[inline]
    const fn eighth(&self) -> u8 {
        1 << (self.state.angle.to_bits() as u32 >> 29)
    }

    /// An eighth has been followed since something was last not understood: after a whole turn, that counts no more.
    #[cold]
    fn follow_eighth(&mut self, eighth: u8) {
        self.followed_eighths |= eighth;
        if self.followed_eighths == u8::MAX {
            self.followed_eighths = 0;
            self.is_even();
            self.wait_in_doubt();
            (self.suspicions.reacquisitions, self.suspicions.restarts) = (0, 0);
            self.tune();
        }
    }

    #[inline]
    pub(super) fn learn(&mut self) -> Status {
        if self.paused != 0 {
            self.end_pause();
        }
        self.learnt_samples = self.learnt_samples.saturating_add(1);
        let eighth = self.eighth();
        if self.seen_eighths & eighth == 0 { self.new_eighth(eighth) } else { Status::Adapting }
    }

    /// The rotor has come to an eighth of the turn that was not covered since the last model.
    #[cold]
    fn new_eighth(&mut self, eighth: u8) -> Status {
        self.limit_parameters();
        if self.seen_eighths == 0 {
            // Not at the end of the turn, where there is other work.
            self.tune();
        }
        self.seen_eighths |= eighth;
        if self.seen_eighths != u8::MAX {
            return Status::Adapting;
        }
        self.seen_eighths = 0;
        if self.learnt_samples >= FEWEST_SAMPLES {
            self.learnt_samples = 0;
            self.suspicions.clear();
            self.add_drift();
            // The model is the next observation's work.
            self.model_due |= self.is_even();
        }
        Status::Adapting
    }

    /// Adds the drift of the time in which nothing was learnt.
    #[cold]
    fn end_pause(&mut self) {
        if self.paused >= self.config.pause {
            self.add_drift();
        }
        self.paused = 0;
    }

    /// Adds the drift since the last time to the parameters' variances.
    fn add_drift(&mut self) {
        let samples = core::mem::take(&mut self.samples_since_drift) as f32;
        for state in THIRD..STATES {
            self.covariance.inflate(state, self.drift[state] * samples, self.start[state]);
        }
    }

    /// Parameters' variances as at the start.
    pub(super) fn restart(&mut self) {
        self.covariance.set_diagonal(&self.start);
        self.seen_eighths = 0;
        self.learnt_samples = 0;
        self.model_due = false;
    }

    /// Cuts the parameters to their limits around the calibration.
    pub(super) fn limit_parameters(&mut self) {
        let (limits, state) = (&self.config.limits, &mut self.state);
        let limit = radians(limits.placement_deg).to_bits();
        state.third = within(state.third, -limits.third, limits.third);
        for (k, sensors) in self.sensors.iter().enumerate() {
            state.offset[k] = within(state.offset[k], -limits.offset, limits.offset);
            state.amplitude[k] = within(state.amplitude[k], 1.0 - limits.amplitude, 1.0 + limits.amplitude);
            let middle = sensors.sensor.placement;
            let placement = clamp((state.placement[k] - middle).to_bits(), limit);
            state.placement[k] = middle + ElectricalAngle::from_bits(placement);
        }
    }

    /// The first parameter at its limit.
    fn limit_reached(&self) -> Option<Fault> {
        let (limits, state) = (&self.config.limits, &self.state);
        let reached = |value: f32, limit: f32| value.abs() >= 0.999 * limit;
        for k in 0..3 {
            let placement = (state.placement[k] - self.sensors[k].sensor.placement).to_radians();
            let parameter = if reached(state.offset[k], limits.offset) {
                Parameter::Offset
            } else if reached(state.amplitude[k] - 1.0, limits.amplitude) {
                Parameter::Amplitude
            } else if reached(placement, limits.placement_deg) {
                Parameter::Placement
            } else {
                continue;
            };
            return Some(Fault::Drifted(Channel(k as u8), parameter));
        }
        reached(state.third, limits.third).then_some(Fault::Distorted)
    }

    /// All of the turn has been covered: makes a model of it, unless a parameter is at its limit.
    #[cold]
    pub(super) fn publish_model(&mut self) -> Status {
        self.model_due = false;
        let last_limit = self.limit_reached();
        if let Some(fault) = last_limit.filter(|_| last_limit == self.last_limit) {
            self.fail(fault);
            return Status::Tracking;
        }
        self.last_limit = last_limit;
        let model = self.current();
        if last_limit.is_some()
            || estimate::validate_without(&model, self.config.adc_bits, self.config.absent()).is_err()
        {
            return Status::Adapting;
        }
        self.model = model;
        Status::ModelReady
    }
}

/// `value` within a range. `f32::clamp` says what is wrong with a range that is none, and brings all of the formatting
/// of floats with it into a firmware.
fn within(value: f32, least: f32, most: f32) -> f32 {
    value.max(least).min(most)
}
