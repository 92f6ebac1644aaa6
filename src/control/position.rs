//! Position control: a proportional gain asks for a speed, with that of the trajectory fed forward.

use crate::angle::Position;
use crate::control::fixed;
use crate::math::{clamp, high};
use core::f32::consts::TAU;

/// Gain of the position controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gain(i32);

impl Gain {
    /// For a bandwidth in hertz, and speeds in units of position a step of a loop that is computed `loop_hz` times a
    /// second. `None` when it is beyond the range of the integers.
    pub fn new(bandwidth_hz: f32, loop_hz: f32) -> Option<Self> {
        Some(Self(fixed(TAU * bandwidth_hz / loop_hz, 32)?.max(1)))
    }

    /// The gain, halved so many times.
    #[inline(always)]
    pub(crate) const fn halved(&self, times: u8) -> Self {
        Self(self.0 >> (times & 15))
    }

    /// The bandwidth in rad/s, for the same loop.
    pub fn rad_s(&self, loop_hz: f32) -> f32 {
        self.0 as f32 / 4_294_967_296.0 * loop_hz
    }

    /// The speed that makes the `measured` position the `reference` one, beside what is fed `forward`; up to ± `most`.
    /// A deviation beyond 2³¹ counts as that.
    #[inline(always)]
    pub const fn speed(&self, reference: Position, measured: Position, forward: i32, most: i32) -> i32 {
        let error = reference.to_bits().wrapping_sub(measured.to_bits());
        let narrow = error as i32;
        let error = if narrow as i64 == error {
            narrow
        } else if error < 0 {
            -i32::MAX
        } else {
            i32::MAX
        };
        clamp(high(error, self.0) + forward, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn approaches_with_the_bandwidth() {
        let gain = Gain::new(20.0, 40e3).unwrap();
        let reference = Position::from_bits(1 << 30);
        let mut at = 0_i64;
        // One time constant.
        for _ in 0..318 {
            at += i64::from(gain.speed(reference, Position::from_bits(at), 0, i32::MAX / 2));
        }
        let left = 1.0 - at as f64 / f64::from(1 << 30);
        assert!((left - 0.368).abs() < 2e-3, "{left}");
    }

    #[test]
    fn far_away_and_any_feed_forward_stay_within_the_limit() {
        let gain = Gain::new(20.0, 40e3).unwrap();
        for reference in [i64::MIN, -1 << 40, 0, 1 << 40, i64::MAX] {
            for forward in [-1000, 0, 1000] {
                let speed = gain.speed(Position::from_bits(reference), Position::from_bits(0), forward, 900);
                assert!(speed.abs() <= 900, "{reference} {forward} {speed}");
                assert!(reference == 0 || i64::from(speed.signum()) == reference.signum());
            }
        }
    }
}
