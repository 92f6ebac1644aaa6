//! The local feedback of Simpkins and Todorov, Fig. 7: one current controlled by one voltage, with block or sinusoidal
//! commutation.

use super::servo::Servo;
use super::{Idle, Sample};
use crate::angle::ElectricalAngle;
use crate::board::{Legs, Output};
use crate::commutation::block::Sextant;
use crate::commutation::frames::Dq;
use crate::commutation::sinusoidal::{self, Axes};
use crate::commutation::{Commutation, Modulation};
use crate::config::Config;
use crate::control::config::Config as Control;
use crate::control::current::{Local, PARK_BITS};
use crate::fault::Limits;
use crate::hall::track::Tracker;
use crate::math::clamp;

/// The current between two legs, or the one along q, is made the reference.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalFeedback {
    controller: Local,
    /// The step of block commutation.
    sextant: Sextant,
    /// Factor on the reference, in 2⁻¹⁶. What flows along d is not controlled and makes the vector longer than the reference;
    /// then the factor falls until it is as long.
    share: i32,
}

/// Steps in which a vector of twice the square that it may have, or more, takes all of the reference.
const SLOWNESS: i32 = 512;
/// Part of the square of the reference by which that of the vector may be larger: 4.4 % of its length, and with block
/// commutation a vector is 4.7 % longer than one along q of the same torque.
const TOLERANCE: i32 = 11;

impl LocalFeedback {
    /// At rest.
    pub const fn new() -> Self {
        Self { controller: Local::ZERO, sextant: Sextant::First, share: 1 << 16 }
    }

    /// Forgets what the controller has integrated.
    pub fn reset(&mut self) {
        self.controller = Local::ZERO;
        self.share = 1 << 16;
    }

    /// One step on.
    pub fn step(
        &mut self,
        config: &Config,
        control: &Control,
        servo: &mut Servo,
        zeros: &Idle,
        rotor: &Tracker,
        sample: &Sample,
    ) -> Output {
        let (order, limits) = (config.order(), &config.limits);
        let block = config.commutation == Commutation::Block;
        let current = servo.measure_current(rotor.angle(), sample);
        let measured = if block {
            between(zeros.phases(control, sample), self.sextant.conducting(order))
        } else {
            current.q >> PARK_BITS
        };
        let bus = control.bus(sample.bus);
        let half_bus = bus / 2;
        let (asked, speed, left) = (servo.reference.current.q >> PARK_BITS, rotor.speed(), control.supply.end - bus);
        // Limited by the bus voltage; none where it is full and the bridge has to open.
        let full = left < control.supply.band;
        let room =
            if full { servo.protection.room_for(control, left, asked, speed, servo.moves()) } else { Some(asked) };
        if room.is_none() {
            // Or the integrator would wind up while no current is controlled.
            self.controller = Local::ZERO;
        }
        let reference = room.unwrap_or(0);
        servo.measurement.state.current_reference = reference;
        self.limit_vector(current, reference, control.max_current);
        let voltage = self.controller.step(&control.local, (reference * self.share) >> 16, measured, speed, half_bus);
        // What was noted for the tasks is the field-oriented control's, which is not at work. Where a full bus has room for no
        // current, the bridge opens again and again, and this voltage is not what drives it.
        let opens = full && reference == 0;
        servo.measurement.state.voltage = Dq { d: 0, q: if opens { 0 } else { voltage } };
        servo.measurement.trim = ElectricalAngle::ZERO;
        let modulation = Modulation::from_bits(clamp((voltage << 15) / half_bus.max(1), 32_767) as i16);
        servo.limits = servo.limits.set(Limits::DUTY, limits.limits(modulation));
        let amplitude = limits.amplitude(modulation);
        if room.is_none() {
            return Output::OFF;
        }
        let vector = rotor.predicted(&config.tracking) + ElectricalAngle::QUARTER;
        if block {
            self.sextant = self.sextant.follow(vector);
            return self.sextant.output(order, amplitude, limits.half());
        }
        let axes = Axes::new(amplitude, order, limits.half());
        Output { compare: sinusoidal::compare(vector, &axes), legs: Legs::ALL }
    }
}

impl LocalFeedback {
    /// Takes up how much longer the current's vector is than its reference.
    fn limit_vector(&mut self, current: Dq, reference: i32, max_current: i32) {
        // In 2⁻¹⁴ of the full scale: squares of the largest fit.
        let square = |current: i32| current * current;
        let allowed = square(reference.abs().max(max_current / 16) / 2);
        let allowed = allowed + allowed / TOLERANCE + 1;
        let length = square(current.d >> (PARK_BITS + 1)) + square(current.q >> (PARK_BITS + 1));
        let excess = clamp(length - allowed, allowed);
        // Both to 14 bits, for the division.
        let shift = 18_u32.saturating_sub(allowed.leading_zeros());
        let excess = ((excess >> shift) << 16) / ((allowed >> shift) + 1).max(1);
        self.share = (self.share - excess / SLOWNESS).clamp(0, 1 << 16);
    }
}

/// Current that flows in at one leg and out at another, as the length of a vector along q that makes the same mean
/// torque under block commutation: 2/√3 · 3/π = 1.103 times it. The difference of the two phases is twice that current.
fn between(phases: [i32; 3], (up, down): (usize, usize)) -> i32 {
    // Never out of range, which the compiler does not see.
    let phase = |leg: usize| phases.get(leg).copied().unwrap_or(0);
    (phase(up) - phase(down)) * 1129 / 2048
}
