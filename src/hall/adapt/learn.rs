//! What becomes of what is learnt: turns seen whole, the box, the drift, and a new model.

use super::filter::{Covariance, STATES, THIRD, radians};
use super::{Adapter, Fault, Outcome, Parameter};
use crate::angle::ElectricalAngle;
use crate::hall::{Channel, estimate};

/// Fewest samples of a turn seen whole.
const WHOLE: u32 = 64;

impl Adapter {
    pub(super) fn follow(&mut self) -> Outcome {
        self.paused = self.paused.saturating_add(1);
        Outcome::Following
    }

    #[inline(always)]
    pub(super) fn learn(&mut self) -> Outcome {
        if self.paused != 0 {
            self.resume();
        }
        self.learnt += 1;
        let eighth = 1 << (self.state.angle.to_bits() as u32 >> 29);
        if self.seen & eighth == 0 { self.new_eighth(eighth) } else { Outcome::Learning }
    }

    /// Learning has come to an eighth of the turn not seen since the last model.
    #[cold]
    fn new_eighth(&mut self, eighth: u8) -> Outcome {
        self.confine();
        self.seen |= eighth;
        if self.seen != u8::MAX {
            return Outcome::Learning;
        }
        self.seen = 0;
        if self.learnt >= WHOLE {
            self.learnt = 0;
            self.doubts.clear();
            self.wander();
            // The model is the next observation's work.
            self.turned = true;
        }
        Outcome::Learning
    }

    /// Makes up for the drift while nothing was learnt.
    #[cold]
    fn resume(&mut self) {
        if self.paused >= self.config.pause {
            self.wander();
        }
        self.paused = 0;
    }

    /// The parameters may have drifted since the last time.
    fn wander(&mut self) {
        let samples = core::mem::take(&mut self.since) as f32;
        for state in THIRD..STATES {
            self.covariance.widen(state, self.drift[state] * samples, self.start[state]);
        }
    }

    /// Doubts all parameters as at the start.
    pub(super) fn restart(&mut self) {
        self.covariance = Covariance::diagonal(&self.start);
        self.seen = 0;
        self.learnt = 0;
        self.turned = false;
    }

    /// Keeps the parameters in the box.
    fn confine(&mut self) {
        let (limits, state) = (&self.config.limits, &mut self.state);
        let limit = radians(limits.placement_deg).to_bits();
        state.third = within(state.third, -limits.third, limits.third);
        for (k, fixed) in self.fixed.iter().enumerate() {
            state.offset[k] = within(state.offset[k], -limits.offset, limits.offset);
            state.amplitude[k] = within(state.amplitude[k], 1.0 - limits.amplitude, 1.0 + limits.amplitude);
            let middle = fixed.sensor.placement;
            let placement = (state.placement[k] - middle).to_bits().clamp(-limit, limit);
            state.placement[k] = middle + ElectricalAngle::from_bits(placement);
        }
    }

    /// The first parameter at the edge of the box.
    fn at_edge(&self) -> Option<Fault> {
        let (limits, state) = (&self.config.limits, &self.state);
        let reached = |value: f32, limit: f32| value.abs() >= 0.999 * limit;
        for k in 0..3 {
            let placement = (state.placement[k] - self.fixed[k].sensor.placement).to_radians();
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

    /// All of the turn has been seen: is it a model?
    #[cold]
    pub(super) fn whole_turn(&mut self) -> Outcome {
        self.turned = false;
        let edge = self.at_edge();
        if let Some(fault) = edge.filter(|_| edge == self.edge) {
            self.fail(fault);
            return Outcome::Following;
        }
        self.edge = edge;
        let model = self.current();
        if edge.is_some() || estimate::validate(&model, self.config.adc_bits).is_err() {
            return Outcome::Learning;
        }
        self.model = model;
        Outcome::Learnt
    }
}

/// `value` within a range. `f32::clamp` says what is wrong with a range that is none, and brings all of the formatting of floats with
/// it into a firmware.
fn within(value: f32, least: f32, most: f32) -> f32 {
    value.max(least).min(most)
}
