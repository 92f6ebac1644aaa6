//! Acquisition: angle and speed from samples alone, at the start and when tracking was lost.

use super::filter::{ANGLE, SPEED, State};
use super::{Adapter, Observation, Phase, Status};
use crate::angle::ElectricalAngle;
use crate::trig::sin_cos_f32;

impl Adapter {
    /// The angle from one sample, and the speed from two.
    #[cold]
    pub(super) fn acquire(&mut self, observation: &Observation, mut unusable: [bool; 3]) -> Status {
        self.window.clear();
        if unusable == [false; 3] {
            unusable = self.suspicions.suspected();
        }
        let signals: [f32; 3] = core::array::from_fn(|k| self.sensors[k].signal(f32::from(observation.codes[k])));
        let angle = angle_of_signals(&self.state, &signals, &unusable);
        let step = (angle - self.state.angle).to_radians();
        self.state.angle = angle;
        if self.phase != Phase::AngleKnown || observation.elapsed != 1 {
            self.phase = Phase::AngleKnown;
            return Status::Acquiring;
        }
        self.phase = Phase::Tracking;
        self.state.speed = step;
        // The parameters bend the angle, by some third of a radian a radian at worst.
        let deviation = 0.3 * libm::fabsf(step) + 0.04;
        self.covariance.reset(ANGLE, 0.15);
        self.covariance.reset(SPEED, deviation * deviation);
        self.track_all(&self.measure(&observation.codes, unusable));
        Status::Acquiring
    }
}

/// The angle that explains three (or, ignoring some, two) signals best as sinusoids.
pub(super) fn angle_of_signals(state: &State, signals: &[f32; 3], ignore: &[bool; 3]) -> ElectricalAngle {
    // Normal equations of signal = offset + amplitude · (sin θ · cos ψ − cos θ · sin ψ).
    let (mut cc, mut ss, mut cs, mut yc, mut ys) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for k in (0..3).filter(|&k| !ignore[k]) {
        let (sine, cosine) = sin_cos_f32(state.placement[k]);
        let (c, s) = (state.amplitude[k] * cosine, -state.amplitude[k] * sine);
        let y = signals[k] - state.offset[k];
        cc += c * c;
        ss += s * s;
        cs += c * s;
        yc += y * c;
        ys += y * s;
    }
    // The determinant is positive and does not turn the vector.
    ElectricalAngle::from_radians(crate::float::atan2(yc * ss - ys * cs, ys * cc - yc * cs))
}
