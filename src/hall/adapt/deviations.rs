//! How well the filter knows what it estimates.

use super::Adapter;
use super::filter::{ANGLE, OFFSET, SPEED, THIRD};

/// Standard deviations of the estimates; offset, amplitude and third harmonic relative to the calibrated amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deviations {
    /// Radians.
    pub angle: f32,
    /// Radians a sample.
    pub speed: f32,
    /// Third harmonic.
    pub third: f32,
    /// Of each sensor.
    pub offset: [f32; 3],
    /// Of each sensor.
    pub amplitude: [f32; 3],
    /// Radians; the first is the origin.
    pub placement: [f32; 3],
}

impl Adapter {
    /// How well the filter believes to know what it estimates.
    pub fn deviations(&self) -> Deviations {
        let of = |state: usize| libm::sqrtf(self.covariance.get(state, state).max(0.0));
        Deviations {
            angle: of(ANGLE),
            speed: of(SPEED),
            third: of(THIRD),
            offset: OFFSET.map(of),
            amplitude: OFFSET.map(|own| of(own + 1)),
            placement: [0.0, of(OFFSET[1] + 2), of(OFFSET[2] + 2)],
        }
    }
}
