//! Field-oriented control: the currents along d and q controlled in the frame of the rotor, with space-vector
//! modulation.

use super::Sample;
use super::servo::Servo;
use crate::angle::ElectricalAngle;
use crate::commutation::frames::{Dq, Rotation};
use crate::commutation::svpwm::{Circle, Modulator};
use crate::control::config::Config;
use crate::control::current::{Integrators, Inverse, Present};
use crate::hall::track::{self, Tracker};
use crate::math::{clamp, high};
use core::sync::atomic::{Ordering, compiler_fence};

/// Largest correction of the alignment: 30°, in 2⁻³² turns.
const LARGEST_TRIM: i32 = 357_913_941;

/// The current controller and what it works with.
#[derive(Clone, Copy, Debug)]
pub(super) struct FieldOriented {
    /// Correction of the alignment, added to the Halls' angle: ± [`LARGEST_TRIM`].
    trim: ElectricalAngle,
    modulator: Modulator,
    /// Gains for the present bus voltage and speed.
    gains: Present,
    integrators: Integrators,
    /// Voltage of the last step, in the unit of [`LONGEST`](crate::commutation::svpwm::LONGEST).
    voltage: Dq,
    /// Bus voltage of the present gains, in 2⁻¹⁵ of its full scale.
    bus: i32,
}

impl FieldOriented {
    /// Before the first reset.
    pub const fn new() -> Self {
        Self {
            trim: ElectricalAngle::ZERO,
            modulator: Modulator::NONE,
            gains: Present::ZERO,
            integrators: Integrators::ZERO,
            voltage: Dq::ZERO,
            bus: 1,
        }
    }

    /// No voltage; gains for the bus voltage and speed of now. The alignment's trim stays.
    pub fn reset(&mut self, config: &Config, speed: i32, sample: &Sample) {
        self.modulator = config.modulator;
        self.integrators = Integrators::ZERO;
        self.voltage = Dq::ZERO;
        self.bus = config.bus(sample.bus);
        self.take_up_bus(config, sample);
        self.take_up_speed(config, speed);
    }

    /// One step on: compare values of the three legs, and whether the highest is beyond what is sampled.
    #[inline(always)]
    pub fn step(
        &mut self,
        servo: &mut Servo,
        rotor: &Tracker,
        tracking: &track::Config,
        sample: &Sample,
    ) -> ([u16; 3], bool) {
        let current = servo.measure_current(rotor.angle() + self.trim, sample);
        self.voltage = self.integrators.step(&self.gains, servo.reference.current, current);
        // The integrators are done with before the rest: mixed, as the compiler would, they need more registers than there are.
        if cfg!(feature = "small") {
            compiler_fence(Ordering::SeqCst);
        }
        // What is computed now acts in the next period.
        let ahead = Rotation::at(rotor.predicted(tracking) + self.trim);
        self.modulator.compare(ahead, self.voltage, servo.reference.in_ramps)
    }

    /// Gains and integrators for the bus voltage of now.
    #[inline(always)]
    pub fn take_up_bus(&mut self, config: &Config, sample: &Sample) {
        let bus = config.bus(sample.bus);
        let inverse = Inverse::new(bus);
        self.gains.take_up_bus(&config.gains, inverse);
        self.integrators.follow(self.bus, bus, inverse);
        self.bus = bus;
    }

    /// Feed-forward of the back-EMF and of the coupling of the axes, for a speed in 2⁻³² electrical turns a step.
    #[inline(always)]
    pub fn take_up_speed(&mut self, config: &Config, speed: i32) {
        self.gains.take_up_speed(&config.gains, Inverse::new(self.bus), speed);
    }

    /// Whether the voltage is at its limit.
    #[inline(always)]
    pub fn is_limited(&self) -> bool {
        Circle::NEW.touches(self.voltage)
    }

    /// What the voltage leaves of the longest one.
    #[inline(always)]
    pub const fn free(&self) -> i32 {
        Circle::NEW.free(self.voltage)
    }

    /// Back-EMF, in the unit of [`LONGEST`](crate::commutation::svpwm::LONGEST).
    #[inline(always)]
    pub const fn induced(&self) -> i32 {
        self.gains.induced()
    }

    /// Trims the alignment until the integrator holds no voltage along d but the resistance's, for a current `along_d`.
    /// Beyond the feed-forward, a voltage there is back-EMF that an error of the angle has turned from q to d. Only above
    /// the speed [`trim_from`](Config::trim_from), where that is well above the noise, and with a voltage of which
    /// something is left `free`.
    #[inline(always)]
    pub fn trim_alignment(&mut self, config: &Config, speed: i32, along_d: i32, free: i32) {
        let fast = speed.wrapping_add(config.trim_from) as u32 > 2 * config.trim_from as u32;
        if fast && free > 0 {
            // With the sign of the speed.
            let induced = self.integrators.d() - self.gains.resistive(&config.gains, along_d);
            let along = (induced ^ speed >> 31) - (speed >> 31);
            let trim = self.trim.to_bits() - high(along << 8, config.trim_gain);
            self.trim = ElectricalAngle::from_bits(clamp(trim, LARGEST_TRIM));
        }
    }

    /// Another alignment has nothing to do with what corrected the last one.
    pub const fn forget_trim(&mut self) {
        self.trim = ElectricalAngle::ZERO;
    }

    /// Correction of the alignment.
    pub const fn trim(&self) -> ElectricalAngle {
        self.trim
    }

    /// Bus voltage of the present gains, in 2⁻¹⁵ of its full scale.
    pub const fn bus(&self) -> i32 {
        self.bus
    }

    /// Voltage of the last step, in 2⁻¹⁵ of the full scale of the bus.
    #[inline(always)]
    pub const fn voltage(&self, config: &Config) -> Dq {
        let volts = self.bus.wrapping_mul(config.volts) >> 6;
        Dq { d: high(self.voltage.d, volts), q: high(self.voltage.q, volts) }
    }
}
