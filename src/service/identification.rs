//! The drive measures its motor, as a procedure: swings at several currents, then steady speeds both ways, from each of
//! which the rotor coasts for a while.
//!
//! Takes some twenty seconds, in which the shaft must be free to turn in both directions. See
//! [`identify`](crate::service::identify) for what becomes of the measurements.

use super::procedure::{Error, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::commutation::Commutation;
use crate::config::Config;
use crate::control::{self, Current, Speed};
use crate::float::sign_of;
use crate::service::identify::{Identifier, Report, Stage};
use crate::telemetry::Measurement;

/// Longest time to reach the fastest speed.
const SPEEDING_UP_S: f32 = 12.0;

/// Plan of the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// Largest mechanical speed, above 0, rad/s.
    pub speed_rad_s: f32,
    /// Largest current, above 0, A.
    pub current_a: f32,
    /// Commutation to return to at the end.
    pub commutation: Commutation,
}

impl Plan {
    /// At most four fifths of the allowed speed and of the one that the least allowed voltage reaches, and what the allowed
    /// acceleration reaches in twelve seconds; at most half the allowed current and the one that the motor of the settings
    /// takes for the allowed acceleration.
    ///
    /// # Errors
    /// [`Error::NoControl`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        let scale = &control.scale;
        let fastest = control.trajectory.speed() as f32 / scale.per_radian_s();
        let reached = control.under_voltage_v() / 1.732 / (control.motor.flux_linkage_wb * scale.pole_pairs);
        let needed = control.acceleration_rad_s2() * control.motor.inertia_kgm2
            / control.motor.torque_constant(scale.pole_pairs);
        let most = control.max_current as f32 / scale.per_ampere();
        Ok(Self {
            speed_rad_s: (0.8 * fastest.min(reached)).min(SPEEDING_UP_S * control.acceleration_rad_s2()),
            current_a: needed.min(0.5 * most),
            commutation: config.commutation,
        })
    }
}

/// Swings: shares of the current, each forward and backward to this share of the speed. A rotor that is light for its
/// current is there within some windows of the [`Identifier`], so it swings again.
const SWINGS: [f32; 6] = [1.0, 0.5, 1.0, 0.5, 1.0, 0.5];
const SWING_TO: f32 = 0.7;
/// Longest swing, ms; it need not reach that speed. That of a rotor so heavy that it has not reached this share of it by
/// then, but has become faster by that share.
const SWING_MS: u32 = 1000;
const HEAVY_SWING_MS: u32 = 5000;
const HEAVY_TO: f32 = 0.2;
const FASTER_BY: f32 = 0.02;
/// Time from a new current on until it is constant, ms.
const CHANGING_MS: u32 = 10;
/// Shares of the speed to keep, each forward and backward.
const SPEEDS: [f32; 4] = [1.0, 0.6, 0.3, 0.15];
/// Time after the speed is reached, to settle and to measure; ms.
const SETTLING_MS: u32 = 200;
const MEASURING_MS: u32 = 1000;
/// Time to coast then.
const COASTING_MS: u32 = 200;
/// Time between two marks there, ms.
const MARK_MS: u32 = 100;
/// Largest error at which a speed counts as reached, in shares of the fastest.
const NEAR: f32 = 0.03;
/// Longest time without coming nearer to a speed by a fiftieth of the fastest, ms: a heavy rotor brakes slowly on a supply
/// that takes nothing back.
const REACHING_MS: u32 = 4000;
const NEARER: f32 = 0.02;

const LEGS: usize = 2 * (SWINGS.len() + SPEEDS.len());

/// What is done in a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Leg {
    Swing(f32),
    Speed(f32),
}

/// The legs, in their order.
fn leg(number: usize) -> Option<Leg> {
    let sign = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
    let pair = number / 2;
    match SWINGS.get(pair) {
        Some(share) => Some(Leg::Swing(sign * share)),
        None => SPEEDS.get(pair - SWINGS.len()).map(|share| Leg::Speed(sign * share)),
    }
}

/// The procedure.
#[derive(Clone, Debug)]
pub struct Identification {
    sequence: Sequence,
    identifier: Identifier,
    report: Option<Report>,
    number: usize,
    fastest: Speed,
    largest: Current,
    began_ms: Option<u32>,
    /// Speed at the begin of the leg.
    from: i32,
    /// How far from the speed it was last, and when; when it was reached, and when the last mark was made.
    far: f32,
    far_ms: u32,
    reached_ms: Option<u32>,
    marked_ms: u32,
    /// When coasting began.
    coasting_ms: Option<u32>,
}

/// What a plan comes to, which is small.
#[derive(Clone, Copy, Debug)]
pub struct Outset<'a> {
    config: &'a Config,
    control: &'a control::Config,
    commutation: Commutation,
    fastest: Speed,
    largest: Current,
}

impl<'a> Outset<'a> {
    /// Looks at a plan.
    ///
    /// # Errors
    /// A part of the plan is out of its range.
    pub fn new(config: &'a Config, plan: &Plan) -> Result<Self, Error> {
        let control = Sequence::possible(config)?;
        if !(plan.speed_rad_s > 0.0) {
            return Err(Error::Plan { field: "speed_rad_s" });
        }
        if !(plan.current_a > 0.0) {
            return Err(Error::Plan { field: "current_a" });
        }
        let fastest = control.speed(plan.speed_rad_s).map_err(Error::Demand)?;
        let largest = control.current(plan.current_a).map_err(Error::Demand)?;
        Ok(Self { config, control, commutation: plan.commutation, fastest, largest })
    }
}

impl Identification {
    /// To be begun by the first [`Self::step`], with the drive ready and its bridge off.
    ///
    /// # Errors
    /// A part of the plan is out of its range.
    pub fn new(config: &Config, plan: &Plan) -> Result<Self, Error> {
        Outset::new(config, plan).map(Self::of)
    }

    /// The same of what [`Outset::new`] has found.
    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub fn of(outset: Outset<'_>) -> Self {
        let Outset { config, control, commutation, fastest, largest } = outset;
        Self {
            sequence: Sequence::new(config, control, commutation),
            identifier: Identifier::of(config, control),
            report: None,
            number: 0,
            fastest,
            largest,
            began_ms: None,
            from: 0,
            far: f32::INFINITY,
            far_ms: 0,
            reached_ms: None,
            marked_ms: 0,
            coasting_ms: None,
        }
    }

    fn turn(&mut self) {
        let Some(leg) = leg(self.number) else {
            self.report = self.identifier.report();
            return if self.report.is_some() {
                self.sequence.finish()
            } else {
                self.sequence.cancel(Error::Inconclusive)
            };
        };
        let now_ms = self.sequence.now_ms();
        let began_ms = *self.began_ms.get_or_insert(now_ms);
        let elapsed_ms = now_ms.wrapping_sub(began_ms);
        match leg {
            Leg::Swing(share) => self.swing(share, elapsed_ms),
            Leg::Speed(share) => self.keep(share, now_ms),
        }
    }

    fn swing(&mut self, share: f32, elapsed_ms: u32) {
        self.sequence.follow(Demand::Current(Current((share * self.largest.0 as f32) as i32)));
        if elapsed_ms >= CHANGING_MS {
            self.identifier.enter(Stage::Swings);
        }
        let (speed, most) = (self.sequence.speed(), SWING_TO * sign_of(share) * self.fastest.0 as f32);
        let [reached, faster] = [speed, speed.wrapping_sub(self.from)].map(|speed| speed as f32 / most);
        let heavy = reached < HEAVY_TO && faster > FASTER_BY;
        if reached >= 1.0 || elapsed_ms > if heavy { HEAVY_SWING_MS } else { SWING_MS } {
            self.next();
        }
    }

    fn keep(&mut self, share: f32, now_ms: u32) {
        if let Some(coasting_ms) = self.coasting_ms {
            self.sequence.follow(Demand::Current(Current(0)));
            let coasted_ms = now_ms.wrapping_sub(coasting_ms);
            if coasted_ms >= CHANGING_MS {
                self.identifier.enter(Stage::Coasts);
            }
            if coasted_ms >= COASTING_MS {
                self.next();
            }
            return;
        }
        let reference = share * self.fastest.0 as f32;
        self.sequence.follow(Demand::Speed(Speed(reference as i32)));
        let error = (self.sequence.speed() as f32 - reference).abs() / self.fastest.0 as f32;
        if error < self.far - NEARER {
            (self.far, self.far_ms) = (error, now_ms);
        }
        match self.reached_ms {
            None if error <= NEAR => self.reached_ms = Some(now_ms),
            None if now_ms.wrapping_sub(self.far_ms) > REACHING_MS => self.sequence.cancel(Error::NotReached),
            None => {}
            Some(reached_ms) => {
                let kept_ms = now_ms.wrapping_sub(reached_ms);
                if kept_ms >= SETTLING_MS && now_ms.wrapping_sub(self.marked_ms) >= MARK_MS {
                    self.marked_ms = now_ms;
                    self.identifier.mark();
                }
                if kept_ms >= SETTLING_MS + MEASURING_MS {
                    self.coasting_ms = Some(now_ms);
                }
            }
        }
    }

    fn next(&mut self) {
        self.number += 1;
        self.from = self.sequence.speed();
        self.began_ms = self.began_ms.map(|_| self.sequence.now_ms());
        (self.reached_ms, self.coasting_ms) = (None, None);
        self.identifier.enter(Stage::Steered);
        self.far = f32::INFINITY;
    }

    /// What was found, from the last measurement on.
    pub const fn report(&self) -> Option<&Report> {
        self.report.as_ref()
    }
}

impl Procedure for Identification {
    fn event(&mut self, event: &Event) {
        self.sequence.event(event);
    }

    fn measurement(&mut self, measurement: &Measurement) {
        if self.began_ms.is_some() {
            self.identifier.push(measurement);
        }
    }

    fn step(&mut self, service: &mut Service, now_ms: u32) -> State {
        if self.sequence.step(service, now_ms) {
            self.turn();
        }
        self.sequence.state()
    }

    fn cancel(&mut self) {
        self.sequence.cancel(Error::Cancelled);
    }

    fn progress(&self) -> f32 {
        self.number as f32 / LEGS as f32
    }
}
