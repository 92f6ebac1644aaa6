//! A motor that a counted drive turns: winding and rotor in single precision, a step of each for every step of the
//! drive. It is there to bring the drive into every state, not to be exact.

use hallservo::angle::ElectricalAngle;
use hallservo::board::{Output, Sample};
use hallservo::hall::Codes;
use hallservo::trig;

/// 12-bit codes of the sensors.
const MIDDLE: i32 = 2048;
const HALLS: f32 = 1900.0;
const CODES_PER_AMPERE: f32 = 2048.0 / 8.25;
/// The counts of the timer in half a period, and the bus.
const PERIOD: f32 = 2125.0;
const BUS_V: f32 = 24.0;

/// The motor of the default settings at 40 kHz, but lighter, so that it is fast and turns back within a sweep.
const STEP_S: f32 = 25e-6;
const RESISTANCE_OHM: f32 = 3.75;
const INDUCTANCE_H: f32 = 0.36e-3;
const FLUX_WB: f32 = 5e-3;
const POLE_PAIRS: f32 = 4.0;
pub const INERTIA_KGM2: f32 = 2e-6;
/// Half an ampere at 400 rad/s.
const FRICTION_NMS: f32 = 3.75e-5;

pub struct Motor {
    angle: ElectricalAngle,
    /// Along d and q, A.
    current: [f32; 2],
    /// Mechanical, rad/s.
    pub speed: f32,
    /// Compare values that act now: those of the step before the last.
    acting: [u16; 3],
    pub locked: bool,
}

impl Motor {
    pub const fn new() -> Self {
        Self { angle: ElectricalAngle::ZERO, current: [0.0; 2], speed: 0.0, acting: [1062; 3], locked: false }
    }

    /// One period on; `output` acts in the next.
    pub fn step(&mut self, output: &Output) {
        let [a, b, c] = self.acting.map(|compare| f32::from(compare) * (BUS_V / PERIOD));
        self.acting = output.compare;
        let (along, across) = ((2.0 * a - b - c) / 3.0, (b - c) * 0.577_350_26);
        let (sin, cos) = (wave(self.angle), wave(self.angle + ElectricalAngle::QUARTER));
        let (voltage_d, voltage_q) = (along * cos + across * sin, across * cos - along * sin);
        let [d, q] = self.current;
        let omega = POLE_PAIRS * self.speed;
        let rate = STEP_S / INDUCTANCE_H;
        self.current = [
            d + rate * (voltage_d - RESISTANCE_OHM * d + omega * INDUCTANCE_H * q),
            q + rate * (voltage_q - RESISTANCE_OHM * q - omega * (INDUCTANCE_H * d + FLUX_WB)),
        ];
        if self.locked {
            self.speed = 0.0;
            return;
        }
        let torque = 1.5 * POLE_PAIRS * FLUX_WB * q - FRICTION_NMS * self.speed;
        self.speed += torque / INERTIA_KGM2 * STEP_S;
        self.angle += ElectricalAngle::from_bits((omega * (STEP_S / core::f32::consts::TAU * 4_294_967_296.0)) as i32);
    }

    /// What the ADCs make of it.
    pub fn sense(&self, sample: &mut Sample) {
        let [d, q] = self.current;
        let code = |size: f32| (MIDDLE + libm::roundf(size) as i32) as u16;
        let phases = [0, 1, 2].map(|k| {
            let from_axis = self.behind(k);
            d * wave(from_axis + ElectricalAngle::QUARTER) - q * wave(from_axis)
        });
        sample.halls = self.halls();
        sample.currents = phases.map(|amperes| code(amperes * CODES_PER_AMPERE));
    }

    fn halls(&self) -> Codes {
        [0, 1, 2].map(|k| (MIDDLE + libm::roundf(HALLS * wave(self.behind(k))) as i32) as u16)
    }

    /// From the axis of a phase, where its Hall is too, to the rotor.
    fn behind(&self, phase: i32) -> ElectricalAngle {
        self.angle - ElectricalAngle::from_bits(ElectricalAngle::THIRD.to_bits().wrapping_mul(phase))
    }
}

/// Sine.
fn wave(angle: ElectricalAngle) -> f32 {
    trig::sin(angle).to_bits() as f32 / 1_073_741_824.0
}
