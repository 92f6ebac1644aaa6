//! Impedance control within the drive: when a spring and a damper are taken up, where their reference is, and what the
//! slots do with them.

use super::arming::Pending;
use super::servo::{Context, Servo};
use super::{Demand, Drive, Refusal, Reply};
use crate::angle::Position;
use crate::control::Impedance;
use crate::control::config::Config;
use crate::control::impedance::{Course, Spring, Start};
use crate::control::trajectory::Trajectory;
use crate::hall::track::Tracker;
use crate::mode::Mode;
use crate::schedule::coarse;
use crate::telemetry::Reference;

/// The spring and the damper, and their reference beside the trajectory.
pub(super) struct Shaft {
    impedance: Option<&'static mut Impedance>,
    spring: Spring,
    /// Feed-forward current.
    forward: i32,
    /// How far the reference is ahead of the rotor.
    strain: i32,
    /// Largest strain that is no fault; without a spring, any.
    far: u32,
    /// Strains that count as none, from here to there, and that they do: outside of a range only, spring and damper act.
    dead: [i32; 2],
    ranges: bool,
    /// Whether a speed is to be reached rather than a position.
    travels: bool,
    /// Whether the reference has come to where it was commanded to.
    complete: bool,
}

impl Shaft {
    /// Neither.
    pub const NONE: Self = Self {
        impedance: None,
        spring: Spring::NONE,
        forward: 0,
        strain: 0,
        far: u32::MAX,
        dead: [0; 2],
        ranges: false,
        travels: false,
        complete: false,
    };

    /// Whether there is a reference to go on from.
    pub const fn has_reference(&self) -> bool {
        !self.ranges
    }

    /// Notes how far the rotor is from the reference; the reference of the speed.
    #[inline(always)]
    pub fn deviate(&mut self, trajectory: &Trajectory, rotor: &Tracker) -> i32 {
        let deviation = trajectory.position().to_bits() - coarse(rotor.smoothed()).to_bits();
        self.strain = beyond(Spring::strain(deviation), self.dead);
        trajectory.speed()
    }

    /// Whether the rotor is farther from the reference than it may be.
    #[inline(always)]
    pub const fn is_strained(&self) -> bool {
        self.strain.unsigned_abs() > self.far
    }
}

/// [`Spring::strain`] in one copy, for what a command takes up.
#[inline(never)]
const fn strain(deviation: i64) -> i32 {
    Spring::strain(deviation)
}

/// What of a strain is beyond those that count as none.
#[inline(always)]
fn beyond(strain: i32, [lowest, highest]: [i32; 2]) -> i32 {
    strain - strain.min(highest).max(lowest)
}

impl Drive {
    /// Takes up a spring and a damper. Its memory goes back where it is refused, otherwise that of the one before.
    pub(super) fn follow_impedance(&mut self, impedance: &'static mut Impedance) -> Reply {
        let allowed = self.allows(impedance);
        let unused = if allowed.is_ok() { self.servo.shaft.impedance.replace(impedance) } else { Some(impedance) };
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
        if !impedance.course.is_within(&motion.bounds) {
            return Err(Refusal::OutOfBounds);
        }
        let (at, dead) = match impedance.course {
            Course::Travel { from: Start::At(at), .. } => (at, [0; 2]),
            Course::Within { end: Some(end), dead } => (end, dead),
            _ => return Ok(()),
        };
        let here = coarse(self.record.rotor.position()).to_bits();
        let strain = beyond(strain(at.wrapping_sub(here)), dead);
        let far = strain.unsigned_abs() > self::strain(motion.far).unsigned_abs();
        if far && impedance.spring.stiffness != 0 { Err(Refusal::TooFar) } else { Ok(()) }
    }
}

impl Servo {
    /// The time that the command itself allows.
    pub(super) fn own_timeout(&self) -> Option<u32> {
        match self.demand() {
            Demand::Impedance => self.shaft.impedance.as_deref().map(|impedance| impedance.timeout),
            _ => None,
        }
    }

    /// Begins what the spring and the damper are to do.
    pub(super) fn begin_impedance(&mut self, config: &Config) {
        let Some(impedance) = self.shaft.impedance.as_deref() else { return };
        (self.shaft.spring, self.shaft.forward) = (impedance.spring, impedance.forward);
        (self.shaft.ranges, self.shaft.travels, self.shaft.complete) = (false, false, false);
        self.shaft.dead = [0; 2];
        let far = strain(config.motion.far).unsigned_abs();
        self.shaft.far = if impedance.spring.stiffness == 0 { u32::MAX } else { far };
        self.protection.most_of_demand = impedance.most;
        self.protection.timeout.restart(config, Some(impedance.timeout));
        match impedance.course {
            Course::Travel { from, travel } => {
                let at = if let Start::At(at) = from { Position::from_bits(at) } else { self.trajectory.position() };
                if from != Start::Smoothly {
                    self.trajectory = Trajectory::at(at, travel.speed);
                }
                self.limits_on_way = travel.limits;
                self.shaft.travels = travel.stop.is_none();
                self.goal = if travel.speed != 0 {
                    Position::from_bits(travel.end(&config.motion.bounds))
                } else {
                    self.trajectory.resting_place(&travel.limits)
                };
            }
            Course::Approach { target, limits } => {
                (self.goal, self.limits_on_way) = (Position::from_bits(target), limits)
            }
            Course::Within { end, dead } => {
                self.goal = end.map_or(self.trajectory.position(), Position::from_bits);
                self.trajectory = Trajectory::at(self.goal, 0);
                (self.shaft.ranges, self.shaft.dead) = (true, dead);
            }
        }
        // The same command again goes on as gently.
        self.following.soften_like_before(&mut self.limits_on_way);
        // The largest torque counts at once.
        self.protection.narrow_now(config);
    }

    /// What spring and damper ask for.
    #[inline(always)]
    pub(super) fn current_of_impedance(&self, rotor: &Tracker) -> i32 {
        let Shaft { spring, strain, forward, ranges, .. } = &self.shaft;
        // Within the range, they do not act.
        if *ranges && *strain == 0 {
            return *forward;
        }
        spring.current(*strain, self.speed_reference.wrapping_sub(rotor.speed())) + forward
    }

    /// The current of the spring and the damper: none that makes a rotor faster which is faster than allowed.
    #[inline(always)]
    pub(super) fn impedance_loop(&mut self, with: &Context) {
        self.asked = self.current_of_impedance(with.rotor);
        self.request_current(self.protection.window.cut(self.asked), with);
    }

    /// Whether the reference has arrived: then the next way begins with the acceleration of its command. Whether it may go along
    /// with the rotor.
    #[inline(always)]
    pub(super) fn attend_to_impedance(&mut self, with: &Context) {
        let reached = self.is_at_goal();
        if reached {
            self.following.forget(self.inertia.doubled);
        }
        let (shaft, trajectory) = (&mut self.shaft, &self.trajectory);
        shaft.complete = reached || shaft.travels && trajectory.speed().abs() == self.limits_on_way.speed();
        let is_far = shaft.strain.unsigned_abs() > shaft.far >> 2;
        self.following.look_on_way(!shaft.complete, is_far, with.rotor.speed(), with.config);
    }

    /// The reference of a spring does not run away from a rotor that cannot follow.
    #[inline(always)]
    pub(super) fn go_on_with_rotor(&mut self) {
        let (shaft, limits) = (&self.shaft, &mut self.limits_on_way);
        self.following.look_at_spring(shaft.strain, shaft.far, &self.trajectory, limits);
        // A rotor that a weak spring does not brake as its reference does takes that along, beyond the place, too; not one
        // that is dragged away from where it is held.
        let most = (shaft.far >> 1) as i32;
        if self.following.goes_along() {
            self.trajectory.shift(Spring::deviation(shaft.strain.clamp(-most, most) - shaft.strain));
        }
    }

    /// Where the reference is.
    #[inline(always)]
    pub(super) fn reference_of_impedance(&self) -> Reference {
        let Shaft { strain, complete, .. } = self.shaft;
        Reference { strain, speed: self.speed_reference, complete }
    }
}
