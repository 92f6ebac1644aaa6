//! What becomes of a reference that the rotor cannot follow. It waits for one that lags, goes on from where one is that
//! overtakes it, and the rest of the way it asks for less acceleration.

use crate::control::Window;
use crate::control::config::{Config, Motion};
use crate::control::trajectory::{Limits, Trajectory};
use crate::fault;

/// The reference has not been taken along by a rotor in front of it, on the way to a position.
const NEVER: i16 = i16::MAX;
/// It has been, but the rotor is behind it again. NEVER | NOT_NOW is NEVER, any speed | NOT_NOW this.
const NOT_NOW: i16 = i16::MAX - 1;
/// How often the acceleration of a motion is halved at most.
const SOFTEST: u8 = 4;

/// How well the rotor follows.
pub(super) struct Following {
    /// How often the acceleration was halved on this way.
    softened: u8,
    /// Whether the reference waits for a rotor that cannot follow.
    pub waits: bool,
    /// Whether the rotor is on its way to a position, and has not been at rest there.
    arrives: bool,
    /// Whether the way to a position is to go on with less acceleration.
    gentler: bool,
    /// Whether the rotor lags behind its reference by more than a sixteenth of the largest distance.
    lags: bool,
    /// Whether its reference is to go on from where the rotor is.
    joins: bool,
    /// Speed of the rotor, in even multiples of 2⁻¹⁶ electrical turns a step, when its reference was last taken along while
    /// the rotor was in front of it; or [`NEVER`] or [`NOT_NOW`], which are above any speed.
    braked_from: i16,
}

impl Following {
    /// As it should.
    pub const NEW: Self = Self {
        softened: 0,
        waits: false,
        arrives: false,
        gentler: false,
        lags: false,
        joins: false,
        braked_from: NEVER,
    };

    /// The reference begins where the rotor is.
    #[inline(always)]
    pub const fn begin(&mut self, doubled: u8) {
        (self.waits, self.joins) = (false, false);
        self.forget(doubled);
    }

    /// A way begins with the acceleration of its command, for an inertia that is so often `doubled`.
    #[inline(always)]
    pub const fn forget(&mut self, doubled: u8) {
        (self.softened, self.braked_from) = (doubled, NEVER);
    }

    /// The limits of a new command, on a way that the rotor could not follow.
    #[inline(always)]
    pub const fn soften_like_before(&self, limits: &mut Limits) {
        limits.soften(self.softened);
    }

    /// Halves the acceleration of the way that the rotor could not follow.
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    const fn soften(&mut self, limits: &mut Limits) {
        if self.softened < SOFTEST {
            self.softened += 1;
            limits.soften(1);
        }
    }

    /// Looks at a reference that is `ahead` of a rotor with a speed, on the way to a position. `window`: what is left to the
    /// current.
    #[inline(always)]
    pub fn look(&mut self, ahead: i64, reference: &Trajectory, rotor: i32, config: &Config, window: &Window) {
        let motion = &config.motion;
        let (speed, led) = (rotor.wrapping_abs(), reference.speed().wrapping_abs());
        let overtakes = (ahead < 0) == (rotor > 0);
        self.waits = false;
        self.arrives = led != 0 || self.arrives && speed > motion.turning_speed;
        self.lags &= !overtakes;
        if !overtakes {
            self.braked_from |= NOT_NOW;
        }
        if ahead.unsigned_abs() <= motion.far as u64 / 4 {
            return;
        }
        // A rotor that cannot brake as its reference does takes that along, beyond the goal, too: if it gets slower, or the
        // supply limits the braking. Not one that is dragged away from where it is held, or on to more than the largest speed.
        let supply_limits = || window.narrowed[usize::from(ahead >= 0)].contains(fault::Limits::SUPPLY);
        let arrives = self.arrives && speed < config.max_speed_reference;
        if arrives && overtakes && (shortened(speed) < self.braked_from || supply_limits()) {
            // From the second time on: the first may be a little friction or resistance that is told wrong.
            self.gentler = self.braked_from == NOT_NOW;
            (self.joins, self.braked_from) = (true, shortened(speed));
        } else {
            self.waits = ((ahead >> 32) as i32 ^ reference.direction()) >= 0;
            // What speeds up with much less than its reference brakes with less, too.
            self.gentler = speed < led - (led >> 2);
        }
    }

    /// Looks at the reference of a spring, whose strain may be so `far`. What lags behind is asked for less acceleration, as
    /// far as it still stops in time: it cannot brake as fast, either. What runs ahead, too, but once, for that leads past
    /// the place.
    #[inline(always)]
    pub const fn look_at_spring(&mut self, strain: i32, far: u32, reference: &Trajectory, limits: &mut Limits) {
        let far = strain.unsigned_abs() > far >> 2;
        self.waits = far && (strain ^ reference.direction()) >= 0;
        let may = self.softened < SOFTEST;
        let gentler = if self.waits { may && reference.stops_gently() } else { far && self.softened == 0 };
        if gentler {
            self.softened += 1;
            limits.soften(1);
        }
    }

    /// Looks whether the reference of a spring may go along with a rotor that is `on_way` to its place, but not braked as fast as
    /// planned: while that gets no faster, from the largest speed on.
    #[inline(always)]
    pub fn look_on_way(&mut self, on_way: bool, is_far: bool, rotor: i32, config: &Config) {
        let speed = (rotor.wrapping_abs() >> 16) as i16;
        if !is_far {
            self.braked_from = (config.max_speed_reference >> 16) as i16;
        }
        self.joins = on_way && speed <= self.braked_from;
        if self.joins {
            self.braked_from = speed;
        }
    }

    /// Whether the reference of a spring goes along.
    #[inline(always)]
    pub const fn goes_along(&self) -> bool {
        self.joins
    }

    /// Notes whether a reference that is `ahead` has left its rotor behind.
    #[inline(always)]
    pub fn note_lag(&mut self, ahead: i64, rotor: i32, motion: &Motion) {
        self.lags = ahead.unsigned_abs() > motion.far as u64 / 16 && (ahead < 0) == (rotor < 0);
    }

    /// Whether the reference has to go on from where the rotor is. A rotor that lags would go on as fast, while its reference
    /// brakes, until it has caught up, and be too fast then: the reference brakes from there.
    #[inline(always)]
    pub fn joins(&mut self, reference: &Trajectory, rotor: i32) -> bool {
        let speed = reference.speed();
        let slows = (reference.acceleration() ^ speed) < 0;
        let lags = self.lags && slows && speed.wrapping_abs() < rotor.wrapping_abs();
        core::mem::take(&mut self.joins) || lags
    }

    /// Asks for less acceleration where the last look has found that.
    #[inline(always)]
    pub const fn adapt(&mut self, limits: &mut Limits) {
        if self.gentler {
            self.gentler = false;
            self.soften(limits);
        }
    }
}

/// A speed in even multiples of 2⁻¹⁶ electrical turns a step.
#[inline(always)]
const fn shortened(speed: i32) -> i16 {
    (speed >> 16) as i16 & !1
}
