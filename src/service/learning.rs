//! Anti-cogging as a procedure: the drive turns its motor slowly both ways, learns a [table](cogging::Table) and uses
//! it.
//!
//! Each pass turns whole turns forward and backward, learns a table of the current that this took, and lets the drive
//! use it. With it the speed is steadier in the next pass, which so finds what is left. [`Learning::table`] is the
//! table to store; after a power-up, [`Service::set_anti_cogging`] lets the drive use it again. Meanwhile
//! [`ByPole`](super::by_pole::ByPole) learns what differs from pole to pole, where there is room for that.

use super::procedure::{Error, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::commutation::Commutation;
use crate::config::Config;
use crate::control::Speed;
use crate::control::cogging::{self, Learner};
use crate::telemetry::Measurement;
use core::f32::consts::TAU;

/// Plan of the learning.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// Mechanical speed, above 0, rad/s. A lower speed is steadier and takes longer.
    pub speed_rad_s: f32,
    /// Mechanical turns in each direction, 1 to 100.
    pub turns: u32,
    /// Passes, each of both directions, 1 to 4.
    pub passes: u8,
    /// Harmonics of the electrical turn to keep, 1 to 63.
    pub harmonics: u8,
    /// Commutation to return to at the end.
    pub commutation: Commutation,
}

impl Plan {
    /// Two passes of two turns at two electrical turns a second, twelve harmonics.
    ///
    /// # Errors
    /// [`Error::NoControl`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        let fastest = control.trajectory.speed() as f32 / control.scale.per_radian_s();
        Ok(Self {
            speed_rad_s: (2.0 * TAU / control.scale.pole_pairs).min(fastest),
            turns: 2,
            passes: 2,
            harmonics: 12,
            commutation: config.commutation,
        })
    }
}

/// Time for the speed to settle, ms.
const SETTLING_MS: u32 = 300;
/// Longest time for a direction, in multiples of the time at the speed of the plan.
const LONGEST_LEG: f32 = 3.0;
/// Time that is added to it, ms.
const MARGIN_MS: f32 = 2000.0;

/// What a plan comes to, which is small.
#[derive(Clone, Debug)]
pub struct Outset {
    sequence: Sequence,
    plan: Plan,
    speed: Speed,
    distance: i64,
    timeout_ms: u32,
}

impl Outset {
    /// Looks at a plan.
    ///
    /// # Errors
    /// A part of the plan is out of its range.
    #[inline(never)]
    pub fn new(config: &Config, plan: &Plan) -> Result<Self, Error> {
        let control = Sequence::possible(config)?;
        let wrong = match plan {
            _ if !(plan.speed_rad_s > 0.0) => Some("speed_rad_s"),
            _ if !(1..=100).contains(&plan.turns) => Some("turns"),
            _ if !(1..=4).contains(&plan.passes) => Some("passes"),
            _ if !(1..cogging::POINTS as u8 / 2).contains(&plan.harmonics) => Some("harmonics"),
            _ => None,
        };
        if let Some(field) = wrong {
            return Err(Error::Plan { field });
        }
        let speed = control.speed(plan.speed_rad_s).map_err(Error::Demand)?;
        let leg_ms = 1000.0 * plan.turns as f32 * TAU / plan.speed_rad_s;
        Ok(Self {
            sequence: Sequence::new(config, control, plan.commutation),
            plan: *plan,
            speed,
            distance: (i64::from(plan.turns) * i64::from(config.pole_pairs.get())) << 32,
            timeout_ms: (LONGEST_LEG * leg_ms + MARGIN_MS) as u32,
        })
    }
}

/// The procedure. The learner stands between parts that always hold something: beside what is not filled at first, the
/// compiler would clear it on the stack and copy it.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Learning {
    sequence: Sequence,
    plan: Plan,
    /// Distance of a leg, in 2⁻³² electrical turns.
    distance: i64,
    timeout_ms: u32,
    speed: Speed,
    learner: Learner,
    /// Number of the leg, counted from 0: even ones forward, odd ones backward.
    leg: u32,
    leg_began_ms: Option<u32>,
    /// Position at which the learning of this leg began, in 2⁻³² electrical turns.
    start: Option<i64>,
    /// Position of the last measurement, in 2⁻³² electrical turns.
    position: i64,
    /// Largest share of the distance covered in this leg.
    covered: f32,
    table: Option<cogging::Table>,
}

impl Learning {
    /// To be begun by the first [`Self::step`], with the drive ready and its bridge off.
    ///
    /// # Errors
    /// A part of the plan is out of its range.
    pub fn new(config: &Config, plan: &Plan) -> Result<Self, Error> {
        Ok(Self::of(Outset::new(config, plan)?))
    }

    /// The same of what [`Outset::new`] has found.
    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub fn of(outset: Outset) -> Self {
        let Outset { sequence, plan, speed, distance, timeout_ms } = outset;
        Self {
            sequence,
            plan,
            learner: Learner::default(),
            table: None,
            speed,
            leg: 0,
            leg_began_ms: None,
            distance,
            start: None,
            position: 0,
            covered: 0.0,
            timeout_ms,
        }
    }

    fn forward(&self) -> bool {
        self.leg.is_multiple_of(2)
    }

    fn sign(&self) -> f32 {
        if self.forward() { 1.0 } else { -1.0 }
    }

    fn turn(&mut self, service: &mut Service) {
        let now_ms = self.sequence.now_ms();
        let began_ms = *self.leg_began_ms.get_or_insert(now_ms);
        let speed = if self.forward() { self.speed } else { Speed(-self.speed.0) };
        self.sequence.follow(Demand::Speed(speed));
        let elapsed_ms = now_ms.wrapping_sub(began_ms);
        if elapsed_ms > self.timeout_ms {
            return self.sequence.cancel(Error::NotReached);
        }
        match self.start {
            None if elapsed_ms >= SETTLING_MS => self.start = Some(self.position),
            Some(_) if self.covered >= 1.0 => self.next_leg(service),
            _ => {}
        }
    }

    fn next_leg(&mut self, service: &mut Service) {
        self.leg += 1;
        (self.leg_began_ms, self.start, self.covered) = (None, None, 0.0);
        if !self.forward() {
            return;
        }
        let Some(table) = self.learner.table(self.plan.harmonics.into()) else {
            return self.sequence.cancel(Error::Inconclusive);
        };
        self.learner = Learner::default();
        self.table = Some(table);
        if service.set_anti_cogging(Some(&table)).is_err() {
            return self.sequence.cancel(Error::NoTable);
        }
        if self.leg == 2 * u32::from(self.plan.passes) {
            self.sequence.finish();
        }
    }

    /// Whether the rotor turns forward, while what it takes is learnt.
    pub fn direction(&self) -> Option<bool> {
        self.start.map(|_| self.forward())
    }

    /// The table of the last whole pass, which the drive uses.
    pub const fn table(&self) -> Option<&cogging::Table> {
        self.table.as_ref()
    }
}

/// A distance in 2⁻¹⁶ turns.
fn coarse(distance: i64) -> f32 {
    (distance >> 16) as i32 as f32
}

impl Procedure for Learning {
    fn event(&mut self, event: &Event) {
        self.sequence.event(event);
    }

    fn measurement(&mut self, measurement: &Measurement) {
        self.position = measurement.rotor.position().to_bits();
        if let Some(start) = self.start {
            let share = coarse(self.position.wrapping_sub(start)) / coarse(self.distance) * self.sign();
            self.covered = self.covered.max(share);
            self.learner.push(self.forward(), measurement.rotor.angle(), measurement.state.current_reference);
        }
    }

    fn step(&mut self, service: &mut Service, now_ms: u32) -> State {
        if self.sequence.step(service, now_ms) {
            self.turn(service);
        }
        self.sequence.state()
    }

    fn cancel(&mut self) {
        self.sequence.cancel(Error::Cancelled);
    }

    fn progress(&self) -> f32 {
        ((self.leg as f32 + self.covered.min(1.0)) / (2.0 * f32::from(self.plan.passes))).min(1.0)
    }
}
