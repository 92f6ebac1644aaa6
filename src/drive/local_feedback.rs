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
    /// Voltage of the last step along q, in 2⁻¹⁵ of the full scale of the bus.
    voltage: i32,
    /// The step of block commutation.
    sextant: Sextant,
}

impl LocalFeedback {
    /// At rest.
    pub const fn new() -> Self {
        Self { controller: Local::ZERO, voltage: 0, sextant: Sextant::First }
    }

    /// Forgets what the controller has integrated.
    pub fn reset(&mut self) {
        self.controller = Local::ZERO;
    }

    /// Voltage of the last step.
    pub const fn voltage(&self) -> Dq {
        Dq { d: 0, q: self.voltage }
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
        let half_bus = control.bus(sample.bus) / 2;
        let reference = servo.current_reference();
        let voltage = self.controller.step(&control.local, reference, measured, rotor.speed(), half_bus);
        self.voltage = voltage;
        let modulation = Modulation::from_bits(clamp((voltage << 15) / half_bus.max(1), 32_767) as i16);
        servo.limits = servo.limits.set(Limits::DUTY, limits.limits(modulation));
        let amplitude = limits.amplitude(modulation);
        let vector = rotor.predicted(&config.tracking) + ElectricalAngle::QUARTER;
        if block {
            self.sextant = self.sextant.follow(vector);
            return self.sextant.output(order, amplitude, limits.half());
        }
        let axes = Axes::new(amplitude, order, limits.half());
        Output { compare: sinusoidal::compare(vector, &axes), legs: Legs::ALL }
    }
}

/// Current that flows in at one leg and out at another, as the length of a vector along q that makes the same mean
/// torque under block commutation: 2/√3 · 3/π = 1.103 times it.
fn between(phases: [i32; 3], (up, down): (usize, usize)) -> i32 {
    // Never out of range, which the compiler does not see.
    let phase = |leg: usize| phases.get(leg).copied().unwrap_or(0);
    (phase(up) - phase(down)) * 1129 / 2048
}
