//! Does the speed control swing the rotor to and fro by itself? Where a mass was taken off the shaft since the settings
//! were found, its gains are too large for the rotor that is left: it hums at rest, at the largest current. So they are
//! for a load on a shaft that has become soft, and for a tracker that is too slow for them.
//!
//! In such a swing the reference of the current goes from one side to the other many times a second, while the rotor
//! hardly turns. What uneven magnets or cogging have the current do comes again with the rotor's angle, at most
//! some times in an electrical turn. Set-points that go to and fro, and other gains, begin it anew.

use crate::angle::Position;

/// Measurements for which it has to go on, 8 s of them: longer than `hallctl tune` and `commission` let a bandwidth swing that
/// they try, which judge it by that.
const LASTING: u16 = 10_000;
/// Measurements that a reversal takes at most, 20 ms of them: a rotor that is heavier than the settings say swings more
/// slowly.
const LONGEST: u8 = 25;
/// Farthest that the rotor turns on from a reversal to the next but one, in 2⁻³² turns: 80° electrical. How far it goes to and
/// fro meanwhile does not matter: a load on a soft shaft, or a slow tracker, makes it swing far.
const FARTHEST: u64 = 954_437_177;

/// What has been seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hunting {
    /// Direction of the last large current, where the rotor was when it came, where it was at the reversal before, and
    /// measurements since the last.
    backward: bool,
    here: Position,
    before: Position,
    since: u8,
    /// Measurements of all reversals, one after the other.
    lasted: u16,
}

impl Hunting {
    /// Nothing.
    pub const NONE: Self =
        Self { backward: false, here: Position::from_bits(0), before: Position::from_bits(0), since: 0, lasted: 0 };

    /// Takes in the reference of the current and the largest one, and where the rotor is; whether the control swings.
    pub fn look(&mut self, reference: i32, largest: i32, position: Position) -> bool {
        self.since = self.since.saturating_add(1);
        if reference.abs() < largest / 2 || (reference < 0) == self.backward {
            return false;
        }
        let turned = position.to_bits().wrapping_sub(self.before.to_bits()).unsigned_abs();
        let follows = self.since <= LONGEST && turned <= FARTHEST;
        let lasted = if follows { self.lasted + u16::from(self.since) } else { 0 };
        let swings = lasted >= LASTING;
        let lasted = if swings { 0 } else { lasted };
        *self = Self { backward: reference < 0, here: position, before: self.here, since: 0, lasted };
        swings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LARGEST: i32 = 10_000;

    /// After how many measurements of sixteen seconds the current and the angle of a time, s, are a swing.
    fn found(current: impl Fn(f64) -> f64, angle_deg: impl Fn(f64) -> f64) -> Option<u32> {
        let mut hunting = Hunting::NONE;
        (0..20_000).find(|&k| {
            let t = f64::from(k) / 1250.0;
            let position = Position::from_bits((angle_deg(t) / 360.0 * 4_294_967_296.0) as i64);
            hunting.look((current(t) * f64::from(LARGEST)) as i32, LARGEST, position)
        })
    }

    fn sine(hz: f64, t: f64) -> f64 {
        (core::f64::consts::TAU * hz * t).sin()
    }

    #[test]
    fn a_swing_about_any_place_is_found() {
        for hz in [30.0, 100.0, 220.0, 410.0, 580.0] {
            for share in [0.7, 1.0] {
                let found = found(|t| share * sine(hz, t), |t| 100.0 + 15.0 * sine(hz, t + 1.0));
                assert!(
                    found.is_some_and(|records| (10_000..10_100).contains(&records)),
                    "{hz} Hz, {share}: {found:?}"
                );
            }
        }
    }

    /// As with a load on a soft shaft, or with a tracker that is slow for the gains: what counts is that it comes back.
    #[test]
    fn a_swing_may_go_far_to_and_fro() {
        for hz in [30.0, 50.0, 170.0, 250.0] {
            for (far_deg, drift_deg_s) in [(30.0, 0.0), (60.0, 0.0), (90.0, 0.0), (45.0, 360.0)] {
                let found = found(|t| sine(hz, t), |t| drift_deg_s * t + far_deg * sine(hz, t + 1.0));
                assert!(
                    found.is_some_and(|records| (10_000..10_100).contains(&records)),
                    "{hz} Hz, {far_deg}°: {found:?}"
                );
            }
        }
    }

    #[test]
    fn what_comes_with_the_angle_and_what_is_slow_or_small_is_none() {
        // Once to four times in an electrical turn, at 10 to 1300 Hz electrical: seen once a turn or more rarely, too.
        for hz in [10.0, 40.0, 120.0, 600.0, 1250.0, 1300.0] {
            for times in [1.0, 2.0, 4.0] {
                assert_eq!(found(|t| sine(times * hz, t), |t| 360.0 * hz * t), None, "{hz} Hz, {times}");
            }
        }
        assert_eq!(found(|t| sine(15.0, t), |_| 0.0), None);
        assert_eq!(found(|t| 0.4 * sine(200.0, t), |_| 0.0), None);
        // A load that comes and goes, with noise.
        assert_eq!(found(|t| 0.7 + 0.3 * sine(310.0, t), |_| 0.0), None);
    }

    /// It goes on being told, for as long as it swings.
    #[test]
    fn it_is_told_again() {
        let mut hunting = Hunting::NONE;
        let told = (0..40_100)
            .filter(|k| hunting.look(if k % 2 == 0 { -LARGEST } else { LARGEST }, LARGEST, Position::from_bits(0)));
        assert_eq!(told.count(), 4);
    }
}
