//! The voltage path: a commanded modulation, turned with the rotor, without any current control.

use crate::angle::ElectricalAngle;
use crate::board::{Legs, Output};
use crate::commutation::block::Sextant;
use crate::commutation::sinusoidal::{self, Axes};
use crate::commutation::{Commutation, Modulation};
use crate::config::Config;
use crate::pwm::Amplitude;

/// A voltage vector at a fixed angle ahead of the rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub(super) struct Voltage {
    /// From the rotor to the voltage vector: a quarter turn and the phase advance.
    lead: ElectricalAngle,
    /// The amplitude as the sinusoidal commutation needs it.
    axes: Axes,
    /// The amplitude, for block commutation.
    amplitude: Amplitude,
    /// The step of block commutation.
    sextant: Sextant,
}

impl Voltage {
    /// No voltage.
    pub const fn new(config: &Config) -> Self {
        Self {
            lead: ElectricalAngle::QUARTER,
            axes: Axes::new(Amplitude::ZERO, config.order(), config.limits.half()),
            amplitude: Amplitude::ZERO,
            sextant: Sextant::First,
        }
    }

    /// Takes up a command. A negative one turns the vector by half a turn; its advance is in the direction of the command, too.
    pub fn command(&mut self, modulation: Modulation, config: &Config) {
        self.set_amplitude(config.limits.amplitude(modulation), config);
        let advance = if modulation.is_negative() { -config.advance } else { config.advance };
        self.lead = ElectricalAngle::QUARTER + advance;
    }

    /// No voltage from now on.
    pub fn release(&mut self, config: &Config) {
        self.set_amplitude(Amplitude::ZERO, config);
    }

    fn set_amplitude(&mut self, amplitude: Amplitude, config: &Config) {
        self.amplitude = amplitude;
        self.axes = Axes::new(amplitude, config.order(), config.limits.half());
    }

    /// Compare values for a rotor at an angle, by sinusoidal commutation.
    #[inline(always)]
    pub fn sinusoidal(&self, rotor: ElectricalAngle) -> Output {
        Output { compare: sinusoidal::compare(rotor + self.lead, &self.axes), legs: Legs::ALL }
    }

    /// What the legs do for a rotor at an angle.
    pub fn output(&mut self, rotor: ElectricalAngle, config: &Config) -> Output {
        match config.commutation {
            Commutation::Sinusoidal | Commutation::FieldOriented => self.sinusoidal(rotor),
            Commutation::Block => {
                self.sextant = self.sextant.follow(rotor + self.lead);
                self.sextant.output(config.order(), self.amplitude, config.limits.half())
            }
        }
    }
}
