//! Anti-cogging as a procedure: the drive turns its motor slowly both ways, learns a [table](cogging::Table) and uses
//! it.
//!
//! Each pass turns whole turns forward and backward and puts the table of what it took to work; the next pass, with the
//! first table in use, wavers less and finds what is left. Whoever stores the table has it from [`Learning::table`];
//! after a power-up, [`Service::set_anti_cogging`] puts it to work again.

use super::procedure::{Error, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::commutation::Commutation;
use crate::config::Config;
use crate::control::Speed;
use crate::control::cogging::{self, Learner};
use crate::telemetry::Measurement;
use core::f32::consts::TAU;

/// How to learn.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// Mechanical speed, above 0, rad/s. Slower wavers less and takes longer.
    pub speed_rad_s: f32,
    /// Mechanical turns in each direction, 1 to 100.
    pub turns: u32,
    /// How often both directions are turned, 1 to 4.
    pub passes: u8,
    /// Harmonics of the electrical turn to keep, 1 to 63.
    pub harmonics: u8,
    /// What to commutate by in the end.
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
/// Longest time to learn all points of a direction, in times of that at the speed asked for.
const PATIENCE: f32 = 3.0;
/// On top of it, ms.
const PATIENCE_MS: f32 = 2000.0;

/// The procedure.
#[derive(Clone, Debug)]
pub struct Learning {
    sequence: Sequence,
    plan: Plan,
    learner: Learner,
    table: Option<cogging::Table>,
    speed: Speed,
    /// Directions turned or being turned.
    leg: u32,
    leg_began_ms: Option<u32>,
    /// Electrical turns to make in a leg, in bits, and where the learning began.
    way: i64,
    from: Option<i64>,
    there: i64,
    /// Largest share of the way made in this leg.
    made: f32,
    patience_ms: u32,
}

impl Learning {
    /// To be begun by the first [`Self::step`], with the drive ready and its bridge off.
    ///
    /// # Errors
    /// What of the plan cannot be.
    // Called, it fills what its caller has for it; inlined, it would be another two on the stack.
    #[inline(never)]
    pub fn new(config: &Config, plan: &Plan) -> Result<Self, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        let fields = [
            ("speed_rad_s", plan.speed_rad_s > 0.0),
            ("turns", (1..=100).contains(&plan.turns)),
            ("passes", (1..=4).contains(&plan.passes)),
            ("harmonics", (1..cogging::POINTS as u8 / 2).contains(&plan.harmonics)),
        ];
        if let Some((field, _)) = fields.into_iter().find(|(_, right)| !right) {
            return Err(Error::Plan { field });
        }
        let leg_ms = 1000.0 * plan.turns as f32 * TAU / plan.speed_rad_s;
        let sequence = Sequence::new(config, plan.commutation)?;
        let speed = control.speed(plan.speed_rad_s).map_err(Error::Demand)?;
        Ok(Self {
            sequence,
            plan: *plan,
            learner: Learner::default(),
            table: None,
            speed,
            leg: 0,
            leg_began_ms: None,
            way: (i64::from(plan.turns) * i64::from(config.pole_pairs.get())) << 32,
            from: None,
            there: 0,
            made: 0.0,
            patience_ms: (PATIENCE * leg_ms + PATIENCE_MS) as u32,
        })
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
        if elapsed_ms > self.patience_ms {
            return self.sequence.cancel(Error::NotReached);
        }
        match self.from {
            None if elapsed_ms >= SETTLING_MS => self.from = Some(self.there),
            Some(_) if self.made >= 1.0 => self.next_leg(service),
            _ => {}
        }
    }

    fn next_leg(&mut self, service: &mut Service) {
        self.leg += 1;
        (self.leg_began_ms, self.from, self.made) = (None, None, 0.0);
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

    /// The table of the last whole pass, which the drive uses.
    pub const fn table(&self) -> Option<&cogging::Table> {
        self.table.as_ref()
    }
}

impl Procedure for Learning {
    fn event(&mut self, event: &Event) {
        self.sequence.event(event);
    }

    fn measurement(&mut self, measurement: &Measurement) {
        self.there = measurement.rotor.position().to_bits();
        if let Some(from) = self.from {
            self.made = self.made.max(self.there.wrapping_sub(from) as f32 / self.way as f32 * self.sign());
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
        ((self.leg as f32 + self.made.min(1.0)) / (2.0 * f32::from(self.plan.passes))).min(1.0)
    }
}
