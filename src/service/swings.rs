//! Flux linkage and inertia, roughly, of a motor that is calibrated and of which R is known: as a procedure.
//!
//! A current along q speeds the rotor up to a modest back-EMF, then it is reversed, to and fro. From reversal to
//! reversal the rotor goes from one speed to the opposite one, so friction cancels in the first order:
//! `J = K_t ∫i dt / ΔΩ`. One that takes half of the current makes J a third too large. What the voltage exceeds `R i`
//! by is `λ ω`; what the dead time leaves cancels in the same way. The current begins small and is fitted to the rotor:
//! less where it is fast, more where it does not move.
//!
//! It needs neither a speed loop nor a flux linkage, which are made of what it finds.

use super::procedure::{Error, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::config::Config;
use crate::control::{Current, Motor, Scale};
use crate::telemetry::Measurement;

/// What was found: against twenty simulated motors, flux linkage within 3 %, inertia up to 40 % too large.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Rough {
    /// Flux linkage, Wb.
    pub flux_linkage_wb: f32,
    /// Inertia, kg·m².
    pub inertia_kgm2: f32,
}

/// Share of the largest voltage that the back-EMF may reach.
const EMF: f32 = 0.4;
/// Share of the largest speed that the rotor may reach.
const FASTEST: f32 = 0.8;
/// First, and largest, share of the largest current.
const FIRST: f32 = 0.06;
const LARGEST: f32 = 0.5;
/// Shortest time from reversal to reversal, and longest, ms.
const SHORTEST_MS: u32 = 80;
const LONGEST_MS: u32 = 1500;
/// Swings that count.
const SWINGS: u8 = 6;

/// The procedure.
#[derive(Clone, Debug)]
pub struct Swings {
    sequence: Sequence,
    scale: Scale,
    motor: Motor,
    most: f32,
    fastest: f32,
    current: f32,
    sign: f32,
    began_ms: Option<u32>,
    swings: u8,
    /// The last measurement: its number, electrical speed in rad/s, back-EMF in V, and its limit.
    last: u32,
    speed: f32,
    emf_v: f32,
    most_emf_v: f32,
    /// Of this swing: speed at its begin, ∫ i dt.
    from: f32,
    impulse: f32,
    /// Of all swings that count: ∫|i| dt, |Δω|, Σ e ω and Σ ω².
    impulses: f32,
    changes: f32,
    induced: f32,
    squares: f32,
    report: Option<Rough>,
}

impl Swings {
    /// To be begun by the first step, with the drive ready and its bridge off.
    ///
    /// # Errors
    /// [`Error::NoControl`], [`Error::FewRecords`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        let control = config.control.as_ref().ok_or(Error::NoControl)?;
        let most = control.max_current as f32;
        Ok(Self {
            sequence: Sequence::new(config, config.commutation)?,
            scale: control.scale,
            motor: control.motor,
            most,
            fastest: FASTEST * control.trajectory.speed().min(config.fastest / 2) as f32,
            current: FIRST * most,
            sign: 1.0,
            began_ms: None,
            swings: 0,
            last: 0,
            speed: 0.0,
            emf_v: 0.0,
            most_emf_v: f32::INFINITY,
            from: 0.0,
            impulse: 0.0,
            impulses: 0.0,
            changes: 0.0,
            induced: 0.0,
            squares: 0.0,
            report: None,
        })
    }

    /// What was found, from the end on.
    pub const fn report(&self) -> Option<&Rough> {
        self.report.as_ref()
    }

    fn turn(&mut self) {
        let now_ms = self.sequence.now_ms();
        let began_ms = *self.began_ms.get_or_insert(now_ms);
        let elapsed_ms = now_ms.wrapping_sub(began_ms);
        self.sequence.follow(Demand::Current(Current((self.sign * self.current) as i32)));
        let speed = self.sign * self.sequence.speed() as f32;
        if self.swings > SWINGS {
            // The last one only takes the rotor to rest.
            if speed >= 0.0 || elapsed_ms > LONGEST_MS {
                self.finish();
            }
            return;
        }
        let reached = speed >= self.fastest || self.sign * self.emf_v >= self.most_emf_v;
        if !reached && elapsed_ms < LONGEST_MS {
            return;
        }
        let change = self.sign * (self.speed - self.from);
        let (fast, weak) = (reached && elapsed_ms < SHORTEST_MS, !reached && self.current < LARGEST * self.most);
        if fast {
            self.current *= 0.6;
        } else if weak {
            self.current = (2.0 * self.current).min(LARGEST * self.most);
        } else if change > 0.0 {
            // The first good one begins where a different current has ended.
            if self.swings > 0 {
                self.impulses += self.sign * self.impulse;
                self.changes += change;
            }
            self.swings += 1;
        } else {
            return self.sequence.cancel(Error::NotReached);
        }
        if fast && self.current < 0.004 * self.most {
            return self.sequence.cancel(Error::Inconclusive);
        }
        if fast || weak {
            (self.swings, self.impulses, self.changes) = (0, 0.0, 0.0);
        }
        self.sign = -self.sign;
        self.began_ms = Some(now_ms);
        (self.from, self.impulse) = (self.speed, 0.0);
    }

    fn finish(&mut self) {
        let pairs = self.scale.pole_pairs;
        let flux_linkage_wb = self.induced / self.squares;
        let inertia_kgm2 = 1.5 * pairs * pairs * flux_linkage_wb * self.impulses / self.changes;
        let sane = flux_linkage_wb > 0.0 && inertia_kgm2 > 0.0;
        if !sane {
            return self.sequence.cancel(Error::Inconclusive);
        }
        self.report = Some(Rough { flux_linkage_wb, inertia_kgm2 });
        self.sequence.release();
    }
}

impl Procedure for Swings {
    fn event(&mut self, event: &Event) {
        self.sequence.event(event);
    }

    fn measurement(&mut self, measurement: &Measurement) {
        let state = &measurement.state;
        let volts = self.scale.volts / 32_768.0;
        let current_a = state.current.q as f32 / self.scale.per_ampere();
        let elapsed_s = measurement.sequence.wrapping_sub(self.last) as f32 / self.scale.step_hz;
        self.last = measurement.sequence;
        self.speed = measurement.rotor.speed() as f32 / self.scale.per_radian_s() * self.scale.pole_pairs;
        self.emf_v = state.voltage.q as f32 * volts - self.motor.resistance_ohm * current_a;
        self.most_emf_v = EMF * 0.577 * state.bus as f32 * volts;
        if self.began_ms.is_some() {
            self.impulse += current_a * elapsed_s;
            self.induced += self.emf_v * self.speed;
            self.squares += self.speed * self.speed;
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
        f32::from(self.swings) / f32::from(SWINGS + 1)
    }
}
