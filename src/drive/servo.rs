//! Control with currents, beside the current control itself: the outer loops, the reference of the current, what is
//! measured, the protection and the schedule. Shared by [local feedback](super::local_feedback) and [field
//! orientation](super::field_oriented).
//!
//! On its way from a command to the bridge a current has three names: it is *asked* for by a loop or a command, whatever the
//! limits; the *request* is what their limits leave of it; the *reference*, which the current control follows, has the
//! current against the cogging as well, and is within all limits.

mod follow;

use super::following::Following;
use super::impedance::Shaft;
use super::inertia::Inertia;
use super::protection::Protection;
use super::schedule::Schedule;
use super::set_points::SetPoints;
use super::supervision::{self, Supervision};
use super::{FieldOriented, Idle, Sample};
use crate::angle::{ElectricalAngle, Position};
use crate::commutation::frames::{Clarke, Dq, Rotation};
use crate::control::cogging;
use crate::control::config::{Config, Motion};
use crate::control::current::PARK_BITS;
use crate::control::trajectory::{self, Trajectory};
use crate::control::velocity::Integrator;
use crate::control::weakening::Weakening;
use crate::control::{Current, Speed};
use crate::fault::{Fault, Limits};
use crate::hall::track::Tracker;
use crate::math::{clamp, high};
use crate::schedule::coarse;
use crate::telemetry::Measurement;
pub use crate::telemetry::State;
#[cfg(not(feature = "small"))]
use crate::turn::FRACTION;
use crate::turn::Live;

/// What a running drive follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Demand {
    /// A voltage, open loop.
    #[default]
    Voltage,
    /// A current along q.
    Current(Current),
    /// A speed.
    Speed(Speed),
    /// A position.
    Position(Position),
    /// A spring and a damper.
    Impedance,
}

/// Reference of the current, as the field-oriented step works with it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference {
    /// In 2⁻²⁸ of the full scale.
    pub current: Dq,
    /// The one along q for the compensation of the dead time, in the unit of
    /// [`Modulator::compare`](crate::commutation::svpwm::Modulator::compare).
    pub in_ramps: i32,
}

/// What a slot of the schedule works with.
pub(super) struct Context<'a> {
    pub config: &'a Config,
    pub rotor: &'a Tracker,
    pub sample: &'a Sample,
}

/// The state of the outer loops, and what all control with currents shares.
pub(super) struct Servo {
    pub protection: Protection,
    clarke: Clarke,
    pub reference: Reference,
    /// Currents of the last step in the frame of the rotor, in 2⁻²⁸ of the full scale.
    current: Dq,
    demand: Demand,
    set_points: SetPoints,
    pub(super) trajectory: Trajectory,
    /// Where the trajectory to a position ends, in the unit of the outer loops, and its limits.
    pub(super) goal: Position,
    pub(super) limits_on_way: trajectory::Limits,
    pub(super) following: Following,
    pub(super) inertia: Inertia,
    pub shaft: Shaft,
    /// The way, −1 or 1, on which the rotor must not go on because of a bound of the position; 0: neither.
    pub(super) outward: i32,
    /// Speed reference ω*, from the position loop or the trajectory, in 2⁻³² electrical turns a step.
    pub(super) speed_reference: i32,
    /// Current along q that the speed loop or the command asks for, in 2⁻¹⁵ of the full scale, and what their limits leave
    /// of it.
    pub(super) asked: i32,
    pub(super) current_request: i32,
    speed_integrator: Integrator,
    /// Anti-cogging current over the electrical angle, if it is on.
    pub cogging: Option<&'static mut cogging::Table>,
    /// What of it differs from pole to pole.
    #[cfg(not(feature = "small"))]
    pub cogging_by_pole: Option<&'static Live>,
    /// The current against it.
    #[cfg(not(feature = "small"))]
    current_by_pole: i32,
    /// Whether braking was burnt 64 steps before the alignment may be trimmed.
    pub has_burnt: bool,
    /// Whether the motion is supervised: something is followed, and not checked before.
    pub supervised: bool,
    /// Grows by two with each check that found the rotor turning faster than it may, and falls by one with the others.
    pub too_fast: u8,
    /// What limits the control at the moment.
    pub limits: Limits,
    /// For the tasks, noted every [`CYCLE`](super::CYCLE) steps.
    pub measurement: Measurement,
    pub schedule: Schedule,
    pub supervision: Supervision,
}

impl Servo {
    /// Reasons for which a current is cut.
    const CUTS: Limits = Limits::CURRENT.with(Limits::HEAT).with(Limits::SUPPLY);

    pub const fn new() -> Self {
        Self {
            protection: Protection::none(),
            supervision: Supervision::NONE,
            clarke: Clarke::new(0, [0; 3], false),
            reference: Reference { current: Dq::ZERO, in_ramps: 0 },
            current: Dq::ZERO,
            demand: Demand::Voltage,
            set_points: SetPoints::NONE,
            trajectory: Trajectory::at(Position::from_bits(0), 0),
            goal: Position::from_bits(0),
            limits_on_way: trajectory::Limits::SLOWEST,
            following: Following::NEW,
            inertia: Inertia::NEW,
            shaft: Shaft::NONE,
            outward: 0,
            has_burnt: false,
            supervised: false,
            too_fast: 0,
            speed_reference: 0,
            current_request: 0,
            asked: 0,
            speed_integrator: Integrator::ZERO,
            cogging: None,
            #[cfg(not(feature = "small"))]
            cogging_by_pole: None,
            #[cfg(not(feature = "small"))]
            current_by_pole: 0,
            limits: Limits::NONE,
            measurement: Measurement::NONE,
            schedule: Schedule::new(),
        }
    }

    /// Everything at rest, following nothing; the amplifiers' zeros are those of now.
    pub fn reset(&mut self, config: &Config, zeros: &Idle) {
        self.protection.currents.set_zeros(config, zeros.zeros());
        self.clarke = Clarke::new(config.shift.into(), zeros.zeros(), config.modulator.is_reversed());
        // One by one: a whole new servo on its way over the stack would take as long as all the rest of the step.
        self.current = Dq::ZERO;
        self.demand = Demand::Voltage;
        self.trajectory = Trajectory::at(Position::from_bits(0), 0);
        (self.speed_reference, self.current_request, self.asked) = (0, 0, 0);
        self.speed_integrator = Integrator::ZERO;
        self.inertia = Inertia::NEW;
        self.limits = Limits::NONE;
        self.reference.current.d = 0;
        self.protection.weakening = Weakening::NONE;
        self.set_reference(config, 0);
    }

    /// The demand that is followed.
    pub const fn demand(&self) -> Demand {
        self.demand
    }

    /// Follows nothing any more: no voltage.
    pub fn release(&mut self) {
        self.demand = Demand::Voltage;
    }

    /// Whether a current, a speed or a position is followed.
    pub fn follows(&self) -> bool {
        !matches!(self.demand, Demand::Voltage)
    }

    /// Whether a speed or a position is followed.
    pub const fn moves(&self) -> bool {
        matches!(self.demand, Demand::Speed(_) | Demand::Position(_))
    }

    /// Restarts the command time-out.
    pub fn command_received(&mut self, config: Option<&Config>) {
        if let Some(config) = config {
            self.protection.timeout.restart(config, self.own_timeout());
        }
        self.limits = self.limits.without(Limits::TIMEOUT);
    }

    /// Plans the trajectory for the distance that is left to a commanded position. A current may make a light rotor so fast
    /// before the next look at its position that it could not be braked any more.
    #[inline(always)]
    pub fn plan_trajectory(&mut self, with: &Context) {
        match self.demand {
            Demand::Position(_) | Demand::Impedance => {
                self.trajectory.plan(self.goal, &self.limits_on_way, with.config.full_braking);
            }
            Demand::Current(_) => self.look_ahead_of_rotor(0, with),
            Demand::Voltage | Demand::Speed(_) => {}
        }
    }

    /// One step of the outer loops along the trajectory.
    #[inline(always)]
    pub fn advance_trajectory(&mut self, with: &Context) {
        match self.demand {
            Demand::Voltage | Demand::Current(_) => {}
            Demand::Speed(Speed(speed)) => {
                let target = if self.following.waits { self.trajectory.speed() } else { self.allowed(speed) };
                self.trajectory.towards_speed(target, &with.config.trajectory);
            }
            Demand::Position(_) | Demand::Impedance => self.trajectory.advance(&self.limits_on_way),
        }
    }

    /// A commanded speed, or none where it leads out of the bounds of the position.
    #[inline(always)]
    const fn allowed(&self, speed: i32) -> i32 {
        if self.outward != 0 && (speed < 0) == (self.outward < 0) { 0 } else { speed }
    }

    /// The position loop: the reference of the speed.
    #[inline(always)]
    pub fn position_loop(&mut self, with: &Context) {
        if self.following.waits && !matches!(self.demand, Demand::Speed(_)) {
            self.wait_for_rotor(with);
        }
        self.speed_reference = match self.demand {
            Demand::Position(_) => {
                let (reference, measured) = (self.trajectory.position(), coarse(with.rotor.smoothed()));
                let Config { position, max_speed_reference, .. } = with.config;
                let gain = position.halved(self.inertia.doubled);
                gain.speed(reference, measured, self.trajectory.speed(), *max_speed_reference)
            }
            Demand::Impedance => self.shaft.deviate(&self.trajectory, with.rotor),
            _ => self.trajectory.speed(),
        };
    }

    /// A reference of the position that the rotor cannot follow goes on as fast as the rotor turns. If it stopped dead, a
    /// rotor that is fast would be braked.
    #[inline(always)]
    fn wait_for_rotor(&mut self, with: &Context) {
        let speed = with.rotor.speed();
        let turns = speed.saturating_abs() > with.config.motion.turning_speed;
        self.trajectory.wait_for(if turns { speed } else { 0 });
    }

    /// The speed loop: the current that is asked for. A commanded current fades out about the largest speed, and brakes
    /// before the bounds of the position.
    #[inline(always)]
    pub fn speed_loop(&mut self, with: &Context) {
        if self.moves() {
            let gains = &with.config.velocity;
            let (reference, measured) = (self.speed_reference, with.rotor.speed());
            let forward = gains.feed_forward(self.trajectory.acceleration());
            let window = &self.protection.window;
            let request = self.speed_integrator.step(gains, reference, measured, forward, window);
            (self.asked, self.current_request) = (request.asked, request.current);
        } else if let Demand::Current(Current(current)) = self.demand {
            self.asked = current;
            self.request_current(current, with);
        } else if matches!(self.demand, Demand::Impedance) {
            self.impedance_loop(with);
        }
    }

    /// A commanded current within the largest speed. Where the rotor must not go on, it brakes as the speed loop would, and
    /// asks for the current that burns what is returned.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub(super) fn request_current(&mut self, current: i32, with: &Context) {
        self.current_request = within_speed(current, with);
        if self.outward != 0 {
            let braking = high(-with.rotor.speed(), with.config.torque_gain);
            let outward = self.outward > 0;
            let most = if outward { self.current_request.min(braking) } else { self.current_request.max(braking) };
            (self.asked, self.current_request) = (most, most);
        }
    }

    /// A commanded speed waits for a rotor that cannot follow: it grows no further than this from the rotor's. A
    /// position that is reached is held. The reference of a spring does not run away. Then, whether the rotor has left its
    /// bounds.
    #[inline(always)]
    pub fn attend_to_motion(&mut self, with: &Context) -> Option<Fault> {
        let motion = &with.config.motion;
        match self.demand {
            Demand::Voltage | Demand::Current(_) => {}
            Demand::Impedance => self.go_on_with_rotor(),
            Demand::Speed(Speed(speed)) => {
                let reference = self.trajectory.speed();
                let ahead = reference.wrapping_sub(with.rotor.speed());
                let far = ahead.saturating_abs() > motion.far_speed >> 1;
                self.following.waits = far && (ahead < 0) == (self.allowed(speed) < reference);
            }
            Demand::Position(_) => {
                if self.following.joins(&self.trajectory, with.rotor.speed()) {
                    self.trajectory.take_along(coarse(with.rotor.position()), with.rotor.speed());
                    // What it has asked for beyond the current that flows does not count.
                    self.speed_integrator = Integrator::holding(self.current.q >> PARK_BITS);
                }
                self.following.adapt(&mut self.limits_on_way);
                self.protection.most_of_demand =
                    if self.trajectory.speed() == 0 { motion.hold.into() } else { i32::MAX };
            }
        }
        (self.supervised && supervision::is_outside(motion, with.rotor)).then_some(Fault::PositionBounds)
    }

    /// Whether a rotor that turns so fast, back or forward, must not go on: it is outside of the bounds of its position, or
    /// could hardly be braked before.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn look_ahead(&mut self, back: bool, fast: i32, with: &Context) {
        let Motion { bounds: [least, most], reserve, .. } = with.config.motion;
        let here = coarse(with.rotor.position()).to_bits();
        let (left, way) = if back { (here - least, -1) } else { (most - here, 1) };
        let left = left - i64::from(fast) * (i64::from(reserve) << 3);
        self.outward = if trajectory::stops_within(left, fast, with.config.deceleration) { 0 } else { way };
    }

    /// The same of the rotor as it turns; at rest it may be outside. One that is hardly faster than the reference that leads it
    /// stops with that.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn look_ahead_of_rotor(&mut self, led: i32, with: &Context) {
        let (speed, motion) = (with.rotor.speed(), &with.config.motion);
        let fast = speed.wrapping_abs();
        let fast = if fast - led > fast >> 2 { fast } else { 0 };
        let below = coarse(with.rotor.position()).to_bits() < motion.bounds[0];
        self.look_ahead(if fast > motion.turning_speed { speed < 0 } else { below }, fast, with);
    }

    /// How far the trajectory's position is ahead of the rotor's.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn distance(&self, with: &Context) -> i64 {
        self.trajectory.position().to_bits().wrapping_sub(coarse(with.rotor.position()).to_bits())
    }

    /// What the rotor's position allows: the trajectory does not run away from a rotor that cannot follow, but waits.
    /// Anything else ends before a bound of the position.
    #[inline(always)]
    pub fn attend_to_position(&mut self, with: &Context) {
        match self.demand {
            Demand::Voltage | Demand::Current(_) => {}
            Demand::Impedance if self.schedule.is_odd_part() => {
                self.look_ahead_of_rotor(self.trajectory.speed().wrapping_abs(), with);
            }
            Demand::Impedance => self.attend_to_impedance(with),
            // A heavy rotor may be faster than its reference.
            Demand::Speed(Speed(speed)) => {
                let fast = self.trajectory.speed().wrapping_abs().max(with.rotor.speed().wrapping_abs());
                self.look_ahead(speed < 0, fast, with);
            }
            Demand::Position(_) => {
                let ahead = self.distance(with);
                self.following.look(ahead, &self.trajectory, with.rotor.speed(), with.config, &self.protection.window);
            }
        }
    }

    /// Whether the reference has arrived.
    #[inline(always)]
    pub(super) fn is_at_goal(&self) -> bool {
        self.trajectory.position() == self.goal && self.trajectory.speed() == 0
    }

    /// Whether the rotor turns against the torque.
    #[inline(always)]
    pub fn turns_against(&mut self, with: &Context) -> Option<Fault> {
        let current = self.current_reference();
        self.supervision.turns_against(&with.config.motion, current, with.rotor.speed())
    }

    /// Looks for a swing that the position control keeps up.
    #[inline(always)]
    pub fn look_for_swing(&mut self, with: &Context) {
        self.inertia.look(self.current_reference(), with.rotor.speed(), with.config);
    }

    /// The next part of the supervision: the check of voltages against currents, and what the rotor does.
    #[inline(always)]
    pub fn supervise(&mut self, with: &Context) -> Option<Fault> {
        let Motion { model, .. } = &with.config.motion;
        let motion = &with.config.motion;
        let supervision = &mut self.supervision;
        match supervision.next_part() {
            0 => supervision.note(&self.measurement.state, with.rotor.speed()),
            1 => supervision.note_emf(model),
            2 => supervision.note_motor(model),
            3 => supervision.explain(model),
            4 => supervision.compare(model),
            5 => supervision.sum_up(model),
            6 => match self.demand {
                Demand::Voltage | Demand::Current(_) => supervision.is_in_time(),
                Demand::Impedance => {
                    supervision.is_in_time();
                    return self.shaft.is_strained().then_some(Fault::FollowingError);
                }
                Demand::Speed(_) => {
                    return supervision.is_late(motion, self.speed_reference.wrapping_sub(with.rotor.speed()));
                }
                Demand::Position(_) => {
                    supervision.is_in_time();
                    let ahead = self.distance(with);
                    self.following.note_lag(ahead, with.rotor.speed(), motion);
                    let far = ahead.unsigned_abs() > motion.far as u64;
                    return far.then_some(Fault::FollowingError);
                }
            },
            _ => {
                let stopping = self.limits.contains(Limits::TIMEOUT);
                let stops = supervision.stops(motion, stopping, with.rotor.speed());
                return supervision.judge(model).or(stops);
            }
        }
        None
    }

    /// Notes the current before the reference changes that is in effect at the next measurement, for [`Self::supervise`].
    #[inline(always)]
    pub const fn note_current(&mut self) {
        self.supervision.before = self.current;
    }

    /// A part of the protection against heat, or what is told of the limits.
    #[inline(always)]
    pub fn heat(&mut self, part: u32, field: &FieldOriented, with: &Context) -> Option<Fault> {
        if part % 8 == 2 {
            let reasons = self.protection.window.reasons(self.asked);
            self.limits = self.limits.without(Self::CUTS).with(reasons).set(Limits::DUTY, field.is_limited());
            return None;
        }
        let square = || self.clarke.of(with.sample.currents).square();
        self.protection.heat(part, square, with.config, with.sample)
    }

    /// The current along d: the larger of those that burn what braking returns, and weaken the magnets' field or have a
    /// share in the torque.
    #[inline(always)]
    pub fn burn(&mut self, config: &Config, bus: i32, controls_field: bool) {
        let burns = self.protection.burn(config, bus, self.asked, controls_field);
        self.reference.current.d = burns.min(-self.protection.weakening.current());
    }

    /// Whether the rotor is stalled: at rest with the largest current.
    #[inline(always)]
    pub fn is_stalled(&mut self, with: &Context) -> bool {
        let limited = self.moves() && self.protection.window.is_end(self.current_request);
        self.protection.stall.is_stalled(with.config, limited, with.rotor.speed())
    }

    /// The current against what of the cogging differs from pole to pole, for [`Self::update_reference`]: in a slot of its
    /// own, as the look-up of a map in the same one would make the longest step longer.
    #[cfg(not(feature = "small"))]
    #[inline(always)]
    pub fn look_up_cogging(&mut self, with: &Context) {
        if let Some(table) = self.cogging_by_pole {
            self.current_by_pole = table.value(with.rotor.position()) >> FRACTION;
        }
    }

    /// The same as looked up.
    #[inline(always)]
    const fn current_by_pole(&self) -> i32 {
        #[cfg(not(feature = "small"))]
        return self.current_by_pole;
        #[cfg(feature = "small")]
        0
    }

    /// What of the cogging differs from pole to pole, where there may be a table of it.
    #[inline(always)]
    pub const fn cogging_by_pole(&self) -> Option<&'static Live> {
        #[cfg(not(feature = "small"))]
        return self.cogging_by_pole;
        #[cfg(feature = "small")]
        None
    }

    /// The current reference: what is asked for and the anti-cogging current.
    #[inline(always)]
    pub fn update_reference(&mut self, with: &Context) {
        let anti_cogging = self.cogging.as_deref().map_or(0, |table| table.current(with.rotor.angle()));
        self.set_reference(with.config, self.current_request + anti_cogging + self.current_by_pole());
    }

    /// Sets the current reference, within its limit, and the dead time's compensation for it.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    fn set_reference(&mut self, config: &Config, request: i32) {
        let limited = self.protection.window.cut(request);
        self.measurement.state.current_reference = limited;
        self.reference.current.q = limited << PARK_BITS;
        self.reference.in_ramps = clamp(limited, config.dead_time_saturation) * config.ramp;
    }

    /// Reference of the current along q, in 2⁻¹⁵ of the full scale.
    pub const fn current_reference(&self) -> i32 {
        self.measurement.state.current_reference
    }

    /// Currents in the frame of a rotor at an angle at the sampling instant, in 2⁻²⁸ of the full scale.
    #[inline(always)]
    pub fn measure_current(&mut self, angle: ElectricalAngle, sample: &Sample) -> Dq {
        self.current = Rotation::at(angle).park(self.clarke.of(sample.currents));
        self.current
    }

    /// No current is measured any more.
    pub const fn forget_current(&mut self) {
        self.current = Dq::ZERO;
    }

    /// Currents of the last step in the frame of the rotor, in 2⁻²⁸ of the full scale.
    #[inline(always)]
    pub const fn current(&self) -> Dq {
        self.current
    }

    /// Notes rotor, currents and voltages for the tasks.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub fn note(&mut self, with: &Context, field: &FieldOriented, zeros: &Idle, sequence: u32) {
        let state = State {
            phases: zeros.phases(with.config, with.sample),
            current: Dq { d: self.current.d >> PARK_BITS, q: self.current.q >> PARK_BITS },
            current_reference: self.current_reference(),
            voltage: field.voltage(with.config),
            bus: field.bus() as u16,
            field_reference: (self.reference.current.d >> PARK_BITS) as i16,
        };
        self.measurement = Measurement { rotor: *with.rotor, sequence, state, trim: field.trim() };
    }
}

/// A current that makes a rotor no faster than where a torque ends, a little beyond the largest speed: on the way there no
/// more than the speed loop would ask for, lest a light rotor shoots past it. Beyond, it brakes as the speed loop would:
/// what an error of the sensing leaves of a current turns a rotor of little friction ever faster.
#[inline(always)]
fn within_speed(current: i32, with: &Context) -> i32 {
    let (speed, config) = (with.rotor.speed(), with.config);
    let most = |end: i32| high(end - speed, config.torque_gain);
    current.min(most(config.torque_ends)).max(most(-config.torque_ends))
}
