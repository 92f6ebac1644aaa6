//! The [map](crate::hall::map) as a procedure: the drive turns its motor both ways, each time first by speed control,
//! and then by the torque that friction takes. That is found by so slow a control of the mean speed that nothing that
//! the Halls show within the turn moves the rotor.
//!
//! The map in use is to be [ended](crate::turn::Live::end) before, and the new one
//! [loaded](crate::turn::Live::load) after it.

use super::procedure::{Error, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::config::Config;
use crate::control::{Current, Speed};
use crate::hall::map::{Learner, Map};
use crate::telemetry::Measurement;
use core::f32::consts::TAU;

/// Plan of the turning.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// Mechanical speed, above 0, rad/s. The faster, the less cogging moves the rotor.
    pub speed_rad_s: f32,
    /// Records in each direction.
    pub samples: u32,
}

impl Plan {
    /// Half of the largest speed, but at least sixteen records in an electrical turn, and not a whole number.
    ///
    /// # Errors
    /// [`Error::NoControl`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        let fastest = control.trajectory.speed() as f32 / control.scale.per_radian_s();
        let record_hz = control.scale.step_hz / config.record_every as f32;
        let finest = TAU * record_hz / RECORDS_IN_A_TURN / control.scale.pole_pairs;
        Ok(Self { speed_rad_s: finest.min(0.5 * fastest), samples: Learner::samples_for(config.pole_pairs) / 2 })
    }
}

/// Most that a map may leave over of single records, degrees RMS: beyond it the rotor was moved by something else. The
/// speed of a slow direct drive is never quite steady: with 21 pole pairs that alone makes 1.5°.
const MOST_NOISE_DEG: f32 = 3.0;
/// Records over which the speed is averaged.
const RECORDS_OF_MEAN: i32 = 64;
/// Measurements over which the speed control's current is averaged, some 0.2 s: what friction takes, to begin with.
const MEASUREMENTS_OF_MEAN: f32 = 256.0;
/// Records in an electrical turn: the golden ratio spreads them evenly over those to come.
const RECORDS_IN_A_TURN: f32 = 16.618;
/// Time for the speed to settle, and to find what torque that takes, ms.
const SETTLING_MS: u32 = 600;
const WEIGHING_MS: u32 = 3000;
/// Bandwidth of the control of the mean speed meanwhile, and while the map is learnt, rad/s.
const WEIGHING: f32 = 5.0;
const FREE: f32 = 1.0;
/// Longest time for a direction beside twice that of its records, ms.
const MARGIN_MS: u32 = 20_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Speed control, until the speed is steady.
    Settling,
    /// Slow control of the mean speed, until the torque of friction is known.
    Weighing,
    /// The same, far slower: what the Halls show is learnt.
    Free,
}

/// The procedure; 2.4 KiB.
#[derive(Clone, Debug)]
pub struct Mapping {
    sequence: Sequence,
    plan: Plan,
    learner: Learner,
    speed: Speed,
    forward: bool,
    stage: Stage,
    since_ms: Option<u32>,
    leg_ms: Option<u32>,
    longest_ms: u32,
    /// Current in 2⁻¹⁵ of the full scale that changes the speed by 2⁻³² electrical turns a step in a second.
    inertia: f32,
    /// Current that friction takes, in 2⁻¹⁵ of the full scale.
    friction: f32,
    controlled_ms: u32,
    /// Mean over many records, in 2⁻³² electrical turns a step.
    mean_speed: i32,
    done: bool,
}

impl Mapping {
    /// To be begun by the first [`Self::step`], with the drive ready and its bridge off.
    ///
    /// # Errors
    /// A part of the plan is out of its range.
    #[inline(never)]
    pub fn new(config: &Config, plan: &Plan) -> Result<Self, Error> {
        let control = Sequence::possible(config)?;
        if !(plan.speed_rad_s > 0.0) {
            return Err(Error::Plan { field: "speed_rad_s" });
        }
        if plan.samples == 0 {
            return Err(Error::Plan { field: "samples" });
        }
        let record_hz = control.scale.step_hz / config.record_every as f32;
        Ok(Self {
            sequence: Sequence::new(config, control, config.commutation),
            plan: *plan,
            learner: Learner::new(config.pole_pairs, 2 * plan.samples),
            speed: control.speed(plan.speed_rad_s).map_err(Error::Demand)?,
            forward: true,
            stage: Stage::Settling,
            since_ms: None,
            leg_ms: None,
            longest_ms: (2000.0 * plan.samples as f32 / record_hz) as u32 + MARGIN_MS,
            inertia: control.current_per_speed_change() / control.scale.step_hz,
            friction: 0.0,
            controlled_ms: 0,
            mean_speed: 0,
            done: false,
        })
    }

    fn enter(&mut self, stage: Stage) {
        (self.stage, self.since_ms) = (stage, None);
        self.learner.pause();
    }

    fn turn(&mut self) {
        let now_ms = self.sequence.now_ms();
        let elapsed_ms = now_ms.wrapping_sub(*self.since_ms.get_or_insert(now_ms));
        if now_ms.wrapping_sub(*self.leg_ms.get_or_insert(now_ms)) > self.longest_ms {
            return self.sequence.cancel(Error::NotReached);
        }
        let speed = if self.forward { self.speed } else { Speed(-self.speed.0) };
        match self.stage {
            Stage::Settling => {
                self.sequence.follow(Demand::Speed(speed));
                if elapsed_ms >= SETTLING_MS && self.is_near(10) {
                    self.controlled_ms = now_ms;
                    self.enter(Stage::Weighing);
                }
            }
            Stage::Weighing => {
                self.control(speed, WEIGHING);
                if elapsed_ms >= WEIGHING_MS {
                    self.enter(Stage::Free);
                }
            }
            Stage::Free => {
                self.control(speed, FREE);
                if !self.is_near(3) {
                    self.enter(Stage::Settling);
                } else if self.learner.samples() >= self.plan.samples * if self.forward { 1 } else { 2 } {
                    self.end_leg();
                }
            }
        }
    }

    /// Controls the mean speed with a bandwidth, rad/s.
    fn control(&mut self, speed: Speed, bandwidth: f32) {
        let now_ms = self.sequence.now_ms();
        let seconds = now_ms.wrapping_sub(core::mem::replace(&mut self.controlled_ms, now_ms)) as f32 * 1e-3;
        let asked = self.inertia * bandwidth * (speed.0 - self.mean_speed) as f32;
        self.friction += 0.25 * bandwidth * seconds * asked;
        self.sequence.follow(Demand::Current(Current((self.friction + asked) as i32)));
    }

    fn end_leg(&mut self) {
        if self.forward {
            self.forward = false;
            self.leg_ms = None;
            self.enter(Stage::Settling);
        } else {
            self.done = true;
            if self.learner.noise_deg() > MOST_NOISE_DEG {
                return self.sequence.cancel(Error::Inconclusive);
            }
            self.sequence.finish();
        }
    }

    /// Whether the rotor's speed is within this part of the plan's, its swing over the turn left aside.
    fn is_near(&self, part: i32) -> bool {
        let speed = if self.forward { self.mean_speed } else { -self.mean_speed };
        (speed - self.speed.0).abs() <= self.speed.0 / part
    }

    /// The map, when the procedure is done.
    pub fn map(&self) -> Option<Map> {
        (self.done && self.sequence.state() == State::Done).then(|| self.learner.map())
    }

    /// What it leaves over of single samples, degrees RMS: their noise.
    pub fn noise_deg(&self) -> f32 {
        self.learner.noise_deg()
    }
}

impl Procedure for Mapping {
    fn event(&mut self, event: &Event) {
        self.sequence.event(event);
        let Event::Record(record) = event else { return };
        self.mean_speed += (record.rotor.speed() - self.mean_speed) / RECORDS_OF_MEAN;
        if self.stage == Stage::Free && !self.done {
            self.learner.push(record.rotor.position(), self.mean_speed, record.sequence);
        }
    }

    fn measurement(&mut self, measurement: &Measurement) {
        if self.stage == Stage::Settling {
            self.friction += (measurement.state.current_reference as f32 - self.friction) / MEASUREMENTS_OF_MEAN;
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
        (self.learner.samples() as f32 / (2 * self.plan.samples) as f32).min(1.0)
    }
}
