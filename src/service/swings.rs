//! Flux linkage and inertia, roughly, of a motor that is calibrated and of which R is known: as a procedure.
//!
//! A current along q speeds the rotor up to a modest back-EMF, then it is reversed, to and fro. From reversal to
//! reversal the rotor goes from one speed to the opposite one, so friction cancels in the first order:
//! `J = K_t ∫i dt / ΔΩ`. One that takes half of the current makes J a third too large. What the voltage along q exceeds
//! `R i_q + ω L i_d` by is `λ ω` and what the dead time leaves, which is along the current: a least-squares fit tells
//! them apart. The current begins small and is fitted to the rotor: less where it is fast, more where it does not move.
//!
//! It needs neither a speed loop nor a flux linkage, which are made of what it finds. But where the settings' flux
//! linkage is far too small, what braking returns is not burnt: then a rotor that stores more than the bus capacitors take goes
//! only so fast that its braking current returns next to no power, `1.5 (e - R i) i`.

use super::procedure::{Error, Procedure, State};
use super::sequence::{Demand, Sequence};
use super::{Event, Service};
use crate::config::Config;
use crate::control::{Current, Motor, Scale};
use crate::float::sign_of;
use crate::telemetry::Measurement;

/// What was found: against twenty simulated motors, flux linkage within 6 %, inertia up to 50 % too large.
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
/// Largest power that braking may return, W, where it is not burnt because the back-EMF is more than so many times that
/// of the settings, and where the rotor stores more than this energy, J, which raises 100 µF from 12 V to 15.6 V.
const RETURNS_W: f32 = 2.0;
const KNOWN: f32 = 2.0;
const STORES_J: f32 = 5e-3;
/// That power is for dead times that take one part of so many of a period at least. Shorter ones lose less of it in the
/// diodes, and half of it is allowed.
const DEAD: u32 = 50;
/// Share of the largest speed that the rotor may reach.
const FASTEST: f32 = 0.8;
/// First, and largest, share of the largest current.
const FIRST: f32 = 0.06;
const LARGEST: f32 = 0.5;
/// Shortest time from reversal to reversal, ms; the same for a rotor limited by what it returns, for which a smaller
/// current would not make it longer; the longest; and the longest of a rotor so heavy that its back-EMF is not this
/// share of its limit by then, but that has become faster by this, in electrical rad/s.
const SHORTEST_MS: u32 = 80;
const SHORTEST_HEAVY_MS: u32 = 20;
const LONGEST_MS: u32 = 1500;
const LONGEST_HEAVY_MS: u32 = 6000;
const HEAVY_EMF: f32 = 0.4;
const FASTER_RAD_S: f32 = 3.0;
/// Share of a measurement in the averaged speed.
const AVERAGED: f32 = 0.02;
/// Swings that count.
const SWINGS: u8 = 6;

/// The procedure.
#[derive(Clone, Debug)]
pub struct Swings {
    sequence: Sequence,
    scale: Scale,
    motor: Motor,
    most: f32,
    returns_w: f32,
    fastest: f32,
    current: f32,
    sign: f32,
    began_ms: Option<u32>,
    swings: u8,
    /// The last measurement: its number, electrical speed in rad/s, back-EMF in V, and its limit.
    last: u32,
    speed: f32,
    averaged: f32,
    emf_v: f32,
    most_emf_v: f32,
    /// Of this swing: speed at its begin, and the averaged one, ∫ i dt, and the energy of the rotor in J.
    from: f32,
    averaged_from: f32,
    impulse: f32,
    energy_j: f32,
    /// Of all swings that count: ∫|i| dt and |Δω|.
    impulses: f32,
    changes: f32,
    fit: Fit,
    report: Option<Rough>,
}

impl Swings {
    /// To be begun by the first step, with the drive ready and its bridge off.
    ///
    /// # Errors
    /// [`Error::NoControl`], [`Error::FewRecords`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        let control = Sequence::possible(config)?;
        let most = control.max_current as f32;
        let dead = DEAD * u32::from(config.dead_time) >= 2 * u32::from(config.period);
        Ok(Self {
            sequence: Sequence::new(config, control, config.commutation),
            scale: control.scale,
            motor: control.motor,
            most,
            returns_w: if dead { RETURNS_W } else { 0.5 * RETURNS_W },
            fastest: FASTEST * control.trajectory.speed().min(config.fastest / 2) as f32,
            current: FIRST * most,
            sign: 1.0,
            began_ms: None,
            swings: 0,
            last: 0,
            speed: 0.0,
            averaged: 0.0,
            emf_v: 0.0,
            most_emf_v: f32::INFINITY,
            from: 0.0,
            averaged_from: 0.0,
            impulse: 0.0,
            energy_j: 0.0,
            impulses: 0.0,
            changes: 0.0,
            fit: Fit::default(),
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
            if speed >= 0.0 || elapsed_ms > LONGEST_HEAVY_MS {
                self.finish();
            }
            return;
        }
        let heavy = self.returns();
        let reached = heavy || speed >= self.fastest || self.sign * self.emf_v >= self.most_emf_v;
        let weak = !reached && self.current < LARGEST * self.most;
        let change = self.sign * (self.speed - self.from);
        let is_faster = self.sign * (self.averaged - self.averaged_from) > FASTER_RAD_S;
        let is_slow = is_faster && self.sign * self.emf_v < HEAVY_EMF * self.most_emf_v;
        let longest_ms = if !weak && is_slow { LONGEST_HEAVY_MS } else { LONGEST_MS };
        if !reached && elapsed_ms < longest_ms {
            return;
        }
        let shortest_ms = if heavy { SHORTEST_HEAVY_MS } else { SHORTEST_MS };
        let fast = reached && elapsed_ms < shortest_ms;
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
            self.fit = Fit::default();
        }
        self.sign = -self.sign;
        self.began_ms = Some(now_ms);
        (self.from, self.averaged_from, self.impulse) = (self.speed, self.averaged, 0.0);
    }

    /// Whether a faster rotor would return more by braking than the bus capacitors take.
    fn returns(&self) -> bool {
        let current_a = self.current / self.scale.per_ampere();
        let emf_v = self.sign * self.emf_v;
        let returned_w = 1.5 * (emf_v - self.motor.resistance_ohm * current_a) * current_a;
        let known_v = KNOWN * self.motor.flux_linkage_wb * self.speed.abs();
        // There is no larger current to brake with, should the bus be full.
        let most_w = self.returns_w * (1.0 - 1.2 * self.current / (LARGEST * self.most));
        self.energy_j > STORES_J && emf_v >= known_v && returned_w > most_w
    }

    fn finish(&mut self) {
        let pairs = self.scale.pole_pairs;
        let flux_linkage_wb = self.fit.slope();
        let inertia_kgm2 = 1.5 * pairs * pairs * flux_linkage_wb * self.impulses / self.changes;
        let sane = flux_linkage_wb > 0.0 && inertia_kgm2 > 0.0;
        if !sane {
            return self.sequence.cancel(Error::Inconclusive);
        }
        self.report = Some(Rough { flux_linkage_wb, inertia_kgm2 });
        self.sequence.release();
    }
}

/// Least squares of `y = a x + b s`.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    xx: f32,
    xs: f32,
    ss: f32,
    xy: f32,
    sy: f32,
}

impl Fit {
    fn add(&mut self, x: f32, s: f32, y: f32) {
        self.xx += x * x;
        self.xs += x * s;
        self.ss += s * s;
        self.xy += x * y;
        self.sy += s * y;
    }

    /// a, or NaN where nothing was added.
    fn slope(&self) -> f32 {
        (self.xy * self.ss - self.sy * self.xs) / (self.xx * self.ss - self.xs * self.xs)
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
        self.averaged += AVERAGED * (self.speed - self.averaged);
        let field_a = state.current.d as f32 / self.scale.per_ampere();
        // The voltage that turns a current round is no back-EMF.
        let reference = state.current_reference;
        let follows = (reference - state.current.q).abs() < reference.abs() / 4;
        if follows {
            self.emf_v = state.voltage.q as f32 * volts
                - self.motor.resistance_ohm * current_a
                - self.speed * self.motor.inductance_h * field_a;
        }
        self.most_emf_v = EMF * 0.577 * f32::from(state.bus) * volts;
        if self.began_ms.is_some() {
            self.impulse += current_a * elapsed_s;
            let brakes = self.sign * self.speed < 0.0;
            self.energy_j = if brakes { 0.0 } else { self.energy_j + 1.5 * self.emf_v * current_a * elapsed_s };
            // A current along d turns what the dead time takes away from q.
            if follows && 4.0 * field_a.abs() < current_a.abs() {
                self.fit.add(self.speed, sign_of(current_a), self.emf_v);
            }
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
