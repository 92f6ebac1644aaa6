//! The trajectory to a position or a speed, with limited speed and acceleration, computed on line: the target may
//! change at any step.
//!
//! Each step takes the highest of the three speeds within reach, a little more, the same or a little less, from which
//! the rotor can still stop in time. It arrives exactly.
//!
//! Above a speed c the power of braking may be limited rather than its torque. From there on, a rotor of the speed v slows
//! down by a·c/v only, and takes the way v³ / 3ac + c² / 6a to rest. A constant deceleration of 3a(c/v) / (2 + (c/v)³) takes
//! the same way; the plan is made with that.

use crate::angle::Position;
use crate::math::{clamp, high};

/// Limits of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    /// Largest acceleration, units of speed a step.
    acceleration: i32,
    /// Largest speed.
    speed: i32,
}

impl Limits {
    /// Largest acceleration, units of speed a step, and speed. `None` unless both are from 1 to 2²⁹.
    pub const fn new(acceleration: i32, speed: i32) -> Option<Self> {
        if acceleration < 1 || speed < 1 || acceleration > Self::MOST || speed > Self::MOST {
            return None;
        }
        Some(Self { acceleration, speed })
    }

    /// The same of numbers from 1, of which the speed is within the range.
    #[inline(always)]
    pub(crate) fn up_to(acceleration: i32, speed: i32) -> Self {
        Self { acceleration: acceleration.min(Self::MOST), speed }
    }

    /// The largest of either.
    pub(crate) const MOST: i32 = 1 << 29;

    /// The least of both.
    pub(crate) const SLOWEST: Self = Self { acceleration: 1, speed: 1 };

    /// Largest speed.
    pub const fn speed(&self) -> i32 {
        self.speed
    }

    /// Largest acceleration, units of speed a step.
    pub const fn acceleration(&self) -> i32 {
        self.acceleration
    }

    /// Halves the acceleration so many times.
    #[inline(always)]
    pub(crate) const fn soften(&mut self, times: u8) {
        self.acceleration = (self.acceleration >> (times & 15)) | 1;
    }

    /// A deceleration that always brakes from the largest speed to rest, whose power is limited above a speed `full_braking`.
    pub(crate) const fn deceleration(&self, full_braking: i32) -> i32 {
        self.braking(self.speed, full_braking)[1]
    }

    /// The deceleration at a speed, if its power is limited above another one, and the constant one that takes the same
    /// way to rest, or hardly more.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    const fn braking(&self, speed: i32, full: i32) -> [i32; 2] {
        let speed = speed.unsigned_abs();
        if speed <= full as u32 {
            return [self.acceleration; 2];
        }
        // The share x of the acceleration, in 2⁻¹⁴.
        let share = (full as u32 / ((speed >> 14) | 1)) as i32;
        let braking = ((self.acceleration as i64 * share as i64) >> 14) as i32 | 1;
        // 3 / (2 + x³) is a little more than 1 + (1 − x²) / 2.
        [braking, braking + high(braking, ((1 << 28) - share * share) << 3)]
    }
}

/// Where the trajectory is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Trajectory {
    /// Reference of the position.
    position: Position,
    /// Reference of the speed, units of position a step.
    speed: i32,
    /// Change of the speed in the last step.
    acceleration: i32,
    /// Deceleration that it has at this speed; negative if the target lies in the negative direction.
    braking: i32,
    /// Twice the deceleration times the distance to the target: the square of the speed from which the rotor just stops
    /// there.
    stopping: u64,
    /// Distance to the target, if one step can cover it; otherwise the largest number.
    last_step: i32,
}

impl Trajectory {
    /// At a position with a speed. Until a target is planned for, it brakes to rest.
    pub const fn at(position: Position, speed: i32) -> Self {
        Self { position, speed, acceleration: 0, braking: 0, stopping: 0, last_step: 0 }
    }

    /// One step towards a speed, up to ± that of the limits.
    #[inline(always)]
    pub const fn towards_speed(&mut self, target: i32, limits: &Limits) {
        let change = target.wrapping_sub(self.speed);
        self.move_on(self.speed + clamp(change, limits.acceleration));
    }

    /// One step towards rest at a position: [`Self::plan`] and [`Self::advance`], which may as well be called one after
    /// the other.
    #[inline(always)]
    pub const fn towards(&mut self, target: Position, limits: &Limits) {
        self.plan(target, limits, i32::MAX);
        self.advance(limits);
    }

    /// Prepares [`Self::advance`] for the distance to a position. Above a speed `full_braking` the power of braking is
    /// limited. That is from 2²⁰.
    #[inline(always)]
    pub const fn plan(&mut self, target: Position, limits: &Limits, full_braking: i32) {
        let left = target.to_bits().wrapping_sub(self.position.to_bits());
        let direction = (left >> 63) as i32;
        let left = left.unsigned_abs();
        self.last_step = if left <= limits.acceleration as u64 { left as i32 } else { i32::MAX };
        let [braking, on_average] = limits.braking(self.speed, full_braking);
        self.braking = along(braking, direction);
        self.stopping = stopping(left, on_average);
    }

    /// One step towards the position that was planned for.
    #[inline(always)]
    pub const fn advance(&mut self, limits: &Limits) {
        let Limits { acceleration, speed: fastest, .. } = *limits;
        // Positive towards the target.
        let direction = self.braking >> 31;
        let (speed, braking) = (along(self.speed, direction), along(self.braking, direction));
        let faster = speed + acceleration;
        let slow = faster as u32 <= 2 * acceleration as u32;
        let faster = if faster < fastest { faster } else { fastest };
        let next = if slow && self.last_step <= fastest {
            self.last_step
        } else if speed.wrapping_sub(1) as u32 >= fastest as u32 {
            // Above the largest speed, or not moving towards the target, which is more than one step away.
            let slower = speed - braking;
            if speed <= 0 {
                faster
            } else if slower < fastest {
                fastest
            } else {
                slower
            }
        } else if stops(faster, acceleration, self.stopping) {
            faster
        } else if stops(speed, acceleration, self.stopping) {
            speed
        } else {
            speed - braking
        };
        self.move_on(along(next, direction));
    }

    /// Whether half of the acceleration that was planned with stops it in time.
    #[inline(always)]
    pub(crate) const fn stops_gently(&self) -> bool {
        // Of the squares, 32 bits say enough.
        let speed = self.speed as i64;
        ((speed * speed) >> 32) as u32 <= (self.stopping >> 33) as u32
    }

    /// Where it can be at rest when it brakes from now on, and at most one step farther. Divides, so not for every step.
    pub(crate) fn resting_place(&self, limits: &Limits) -> Position {
        // Of v (v + a) / 2a; an acceleration is never 0; so written, nothing can panic.
        let steps = self.speed.unsigned_abs().checked_div(limits.acceleration.unsigned_abs()).unwrap_or(0);
        let way = (i64::from(self.speed) * (i64::from(steps) + 2)) >> 1;
        Position::from_bits(self.position.to_bits().wrapping_add(way))
    }

    /// Makes the last step towards the position no longer than that of a rotor at a speed.
    #[inline(always)]
    pub const fn wait_for(&mut self, speed: i32) {
        let most = along(speed, self.direction());
        let most = if most > 0 { most } else { 0 };
        let beyond = along(self.speed, self.direction()) - most;
        if beyond > 0 {
            let back = along(beyond, self.direction());
            self.speed -= back;
            self.position = Position::from_bits(self.position.to_bits().wrapping_sub(back as i64));
        }
    }

    /// Takes it to a place and a speed; the target has to be planned for before the next step.
    #[inline(always)]
    pub const fn take_along(&mut self, position: Position, speed: i32) {
        (self.position, self.speed) = (position, speed);
    }

    /// Goes on from so much farther; the target has to be planned for before the next step.
    #[inline(always)]
    pub const fn shift(&mut self, way: i64) {
        self.position = Position::from_bits(self.position.to_bits().wrapping_add(way));
    }

    #[inline(always)]
    const fn move_on(&mut self, speed: i32) {
        self.acceleration = speed - self.speed;
        self.speed = speed;
        self.position = Position::from_bits(self.position.to_bits().wrapping_add(speed as i64));
    }

    /// The direction that was planned for: −1, or 0 for the positive one.
    #[inline(always)]
    pub(crate) const fn direction(&self) -> i32 {
        self.braking >> 31
    }

    /// Where the rotor should be.
    pub const fn position(&self) -> Position {
        self.position
    }

    /// How fast it should turn.
    pub const fn speed(&self) -> i32 {
        self.speed
    }

    /// Its acceleration, for the feed-forward.
    pub const fn acceleration(&self) -> i32 {
        self.acceleration
    }
}

/// The speed along a direction: with the other sign where that is −1.
#[inline(always)]
const fn along(speed: i32, direction: i32) -> i32 {
    (speed ^ direction) - direction
}

/// Whether a deceleration brakes a speed, which is not negative, to rest within a distance.
#[inline(always)]
pub(crate) const fn stops_within(left: i64, speed: i32, braking: i32) -> bool {
    left >= 0 && stops(speed, braking, stopping(left as u64, braking))
}

/// Twice a deceleration times a distance, or a number beyond the square of any speed.
#[cfg_attr(not(feature = "small"), inline(always))]
#[cfg_attr(feature = "small", inline(never))]
const fn stopping(left: u64, braking: i32) -> u64 {
    let twice = 2 * braking as u32;
    let fits = ((left >> 32) as u32).leading_zeros() + twice.leading_zeros() > 32;
    if fits { left * twice as u64 } else { 1 << 62 }
}

/// Whether braking from `speed`, which is positive, ends before the target: with v the speed and a the acceleration,
/// v (v + a) ≤ 2 a times the distance, which is `stopping`.
#[inline(always)]
const fn stops(speed: i32, acceleration: i32, stopping: u64) -> bool {
    // Of two that are not negative: a rotor out of control may be so fast that no `i32` holds the sum.
    speed as u32 as u64 * (speed as u32 + acceleration as u32) as u64 <= stopping
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn no_speed_is_too_fast_to_ask_whether_it_stops() {
        assert!(!stops_within(1 << 40, i32::MAX, Limits::MOST + Limits::MOST / 2));
        assert!(stops_within(i64::MAX, 1 << 30, Limits::MOST + Limits::MOST / 2));
    }

    /// Steps until at rest at the target; asserts the limits on the way.
    fn arrive(trajectory: &mut Trajectory, target: i64, limits: &Limits) -> u32 {
        let started_within = trajectory.speed.abs() <= limits.speed;
        for step in 0..2_000_000 {
            if trajectory.position.to_bits() == target && trajectory.speed == 0 {
                return step;
            }
            let before = *trajectory;
            trajectory.towards(Position::from_bits(target), limits);
            assert!((trajectory.speed - before.speed).abs() <= 2 * limits.acceleration);
            assert!(!started_within || trajectory.speed.abs() <= limits.speed);
        }
        panic!("never arrives: {trajectory:?}, {target}");
    }

    #[test]
    fn takes_the_time_of_a_trapezoid() {
        let limits = Limits::new(1000, 1_000_000).unwrap();
        let distance = 20_000_000_000;
        let steps = arrive(&mut Trajectory::default(), distance, &limits);
        // Way over speed, and the time to speed up: 20000 + 1000 steps.
        assert!((20_990..=21_030).contains(&steps), "{steps}");
    }

    #[test]
    fn never_overshoots_from_rest() {
        let limits = Limits::new(777, 123_456).unwrap();
        for distance in (1..50_000_000_i64).step_by(1_234_567).chain(0..50) {
            for target in [distance, -distance] {
                let mut trajectory = Trajectory::default();
                while trajectory.position.to_bits() != target || trajectory.speed != 0 {
                    trajectory.towards(Position::from_bits(target), &limits);
                    let way = trajectory.position.to_bits() * target.signum();
                    assert!((0..=distance).contains(&way), "{target} {trajectory:?}");
                }
            }
        }
    }

    #[test]
    fn a_speed_is_reached_by_a_ramp() {
        let limits = Limits::new(1000, 100_000).unwrap();
        let mut trajectory = Trajectory::default();
        for step in 1..=100 {
            trajectory.towards_speed(50_500, &limits);
            assert_eq!(trajectory.speed(), (step * 1000).min(50_500));
            assert_eq!(
                trajectory.acceleration(),
                if step <= 50 {
                    1000
                } else if step == 51 {
                    500
                } else {
                    0
                }
            );
        }
    }

    /// Its power of braking is limited above a fifth of the largest speed.
    #[test]
    fn brakes_with_the_power_that_there_is() {
        let (acceleration, fastest, full) = (20_000, 100_000_000, 20_000_000);
        let limits = Limits::new(acceleration, fastest).unwrap();
        let target = Position::from_bits(2_000_000_000_000);
        let mut trajectory = Trajectory::default();
        let (mut largest, mut steps) = (0.0_f64, 0);
        while trajectory.position != target || trajectory.speed != 0 {
            trajectory.plan(target, &limits, full);
            trajectory.advance(&limits);
            assert!(trajectory.position.to_bits() <= target.to_bits());
            let power = -f64::from(trajectory.acceleration) * f64::from(trajectory.speed.max(full));
            largest = largest.max(power / f64::from(acceleration) / f64::from(full));
            steps += 1;
        }
        // 5000 steps to speed up, 13 000 to brake on the way v³ / 3ac + c² / 6a, and between them what is left.
        let braked = 1e24 / 3.0 / 4e11 + 4e14 / 6.0 / 2e4;
        let ideal = 18_000.0 + (2e12 - 2.5e11 - braked) / 1e8;
        assert!(largest < 1.02 && (f64::from(steps) / ideal - 1.0).abs() < 0.02, "{largest} {steps} {ideal}");
    }

    proptest! {
        #[test]
        fn arrives_with_a_limited_power_of_braking(
            start in -(1_i64 << 38)..(1 << 38), target in -(1_i64 << 38)..(1 << 38),
            speed in -(1 << 26)..(1 << 26), acceleration in 1000..(1 << 20), full in (1 << 20)..(1 << 27),
        ) {
            let limits = Limits::new(acceleration, 1 << 28).unwrap();
            let mut trajectory = Trajectory::at(Position::from_bits(start), speed);
            let arrived = (0..2_000_000).any(|_| {
                trajectory.plan(Position::from_bits(target), &limits, full);
                trajectory.advance(&limits);
                trajectory.position.to_bits() == target && trajectory.speed == 0
            });
            prop_assert!(arrived, "{trajectory:?}");
        }

        #[test]
        fn arrives_from_any_state_at_any_target(
            start in -(1_i64 << 36)..(1 << 36), target in -(1_i64 << 36)..(1 << 36),
            speed in -(1 << 24)..(1 << 24), acceleration in 1000..(1 << 20), fastest in (1 << 20)..(1 << 28),
        ) {
            let limits = Limits::new(acceleration, fastest).unwrap();
            arrive(&mut Trajectory::at(Position::from_bits(start), speed), target, &limits);
        }

        #[test]
        fn extremes_do_not_overflow(
            start in any::<i64>(), targets in prop::collection::vec(any::<i64>(), 1..20),
            acceleration in 1..=(1 << 29), fastest in 1..=(1 << 29),
        ) {
            let limits = Limits::new(acceleration, fastest).unwrap();
            let mut trajectory = Trajectory::at(Position::from_bits(start), 0);
            for target in targets {
                for _ in 0..10 {
                    trajectory.towards(Position::from_bits(target), &limits);
                    prop_assert!(i64::from(trajectory.speed).abs() <= i64::from(fastest) + 2 * i64::from(acceleration));
                }
            }
        }
    }
}
