//! The local feedback of Simpkins and Todorov, Fig. 7: a PID on one current, with the back-EMF fed forward.

use crate::control::{Motor, Scale, fixed};
use crate::math::{clamp, high};
use crate::settings::Feedback;
use core::f32::consts::TAU;

/// Bits of the fraction of a voltage within the local feedback.
const FRACTION: u32 = 8;
/// Bits by which a speed may be shifted: the fastest is a twentieth of a turn a step, and its noise may double it.
const SPEED_BITS: i32 = 2;

/// Gains of the local feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LocalGains {
    feed_forward: i32,
    proportional: i32,
    integral: i32,
    derivative: i32,
    back: i32,
    flux: i32,
}

impl LocalGains {
    /// For a bandwidth in hertz. `None` when they are beyond the range of the integers.
    pub fn new(motor: &Motor, feedback: Feedback, bandwidth_hz: f32, scale: &Scale) -> Option<Self> {
        let omega = TAU * bandwidth_hz;
        // The current of two phases sees both inductances in turn.
        let mean_h = motor.inductances_h().iter().sum::<f32>() / 2.0;
        let proportional = omega * mean_h / scale.conductance();
        let integral = omega * motor.resistance_ohm / scale.conductance() / scale.step_hz;
        let flux = TAU * scale.step_hz * motor.flux_linkage_wb / scale.volts;
        let integrates = matches!(feedback, Feedback::Pi | Feedback::Pid);
        let derives = matches!(feedback, Feedback::Pd | Feedback::Pid);
        Some(Self {
            feed_forward: if integrates { 0 } else { fixed(motor.resistance_ohm / scale.conductance(), 26)? },
            proportional: fixed(proportional, 26)?,
            integral: if integrates { fixed(integral, 26)?.max(1) } else { 0 },
            // Half of 1.5 steps.
            derivative: if derives { fixed(0.75 * proportional, 26)? } else { 0 },
            back: fixed((integral / proportional).min(0.49), 32)?,
            flux: fixed(flux, 15 + FRACTION as i32 - SPEED_BITS)?,
        })
    }
}

/// The local feedback: a current in, a voltage out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Local {
    integral: i32,
    last: i32,
}

impl Local {
    /// Nothing.
    pub const ZERO: Self = Self { integral: 0, last: 0 };

    /// One step: the voltage that makes the `measured` current the `reference` one, up to ± `most`.
    ///
    /// The voltage that the back-EMF is expected to take is fed forward; to a feedback without an integral also that of
    /// the resistance, so that it has to make up for the rest only.
    pub const fn step(&mut self, gains: &LocalGains, reference: i32, measured: i32, speed: i32, most: i32) -> i32 {
        let error = (reference - measured) << 14;
        let change = (measured - self.last) << 14;
        self.last = measured;
        let forward = high(reference << 14, gains.feed_forward) + high(speed << SPEED_BITS, gains.flux);
        let asked =
            (high(error, gains.proportional) + self.integral + forward - high(change, gains.derivative)) >> FRACTION;
        let voltage = clamp(asked, most);
        if gains.integral != 0 {
            let over = (voltage - asked) << FRACTION;
            self.integral =
                clamp(self.integral + high(error, gains.integral) + high(over, gains.back), most << FRACTION);
        }
        voltage
    }
}
