//! How well the filter knows what it estimates.

use super::filter::{ANGLE, Covariance, OFFSET, SPEED, THIRD};

/// Standard deviations of the estimates; offset, amplitude and third harmonic relative to the calibrated amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deviations {
    /// √P of the angle, rad electrical.
    pub angle: f32,
    /// √P of the speed, rad electrical a sample.
    pub speed: f32,
    /// √P of the third harmonic, share of the amplitude.
    pub third: f32,
    /// √P of each offset, share of the calibrated amplitude.
    pub offset: [f32; 3],
    /// √P of each amplitude, share of the calibrated one.
    pub amplitude: [f32; 3],
    /// √P of each placement, rad electrical; the first is the origin and zero.
    pub placement: [f32; 3],
}

impl Deviations {
    /// The square roots of the diagonal.
    pub(super) fn of(covariance: &Covariance) -> Self {
        let of = |state: usize| crate::float::root(covariance.get(state, state).max(0.0));
        Self {
            angle: of(ANGLE),
            speed: of(SPEED),
            third: of(THIRD),
            offset: OFFSET.map(of),
            amplitude: OFFSET.map(|own| of(own + 1)),
            placement: [0.0, of(OFFSET[1] + 2), of(OFFSET[2] + 2)],
        }
    }
}
