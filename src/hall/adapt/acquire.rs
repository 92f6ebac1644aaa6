//! The begin, and the begin anew: angle and speed from the samples alone.

use super::filter::{ANGLE, SPEED, State};
use super::{Adapter, Observation, Outcome, Phase};
use crate::angle::ElectricalAngle;
use crate::trig::sin_cos_f32;

impl Adapter {
    /// Finds the angle, and from two of them the speed.
    #[cold]
    pub(super) fn acquire(&mut self, observation: &Observation, mut useless: [bool; 3]) -> Outcome {
        self.window.clear();
        if useless == [false; 3] {
            useless = self.doubts.sensors();
        }
        let signals = [0, 1, 2].map(|k| self.fixed[k].signal(f32::from(observation.codes[k])));
        let angle = bearing(&self.state, &signals, &useless);
        let step = (angle - self.state.angle).to_radians();
        self.state.angle = angle;
        if self.phase != Phase::Still || observation.elapsed != 1 {
            self.phase = Phase::Still;
            return Outcome::Acquiring;
        }
        self.phase = Phase::Tracking;
        self.state.speed = step;
        // The parameters bend the angle, by some third of a radian a radian at worst.
        let deviation = 0.3 * libm::fabsf(step) + 0.04;
        self.covariance.forget(ANGLE, 0.15);
        self.covariance.forget(SPEED, deviation * deviation);
        self.follow_all(&self.measure(&observation.codes, useless));
        Outcome::Acquiring
    }
}

/// The angle that explains three (or, ignoring some, two) signals best as sinusoids.
fn bearing(state: &State, signals: &[f32; 3], ignore: &[bool; 3]) -> ElectricalAngle {
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
    ElectricalAngle::from_radians(libm::atan2f(yc * ss - ys * cs, ys * cc - yc * cs))
}
