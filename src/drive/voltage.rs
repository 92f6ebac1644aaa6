//! The voltage path: a commanded modulation, turned with the rotor, without any current control.
//!
//! Where there is current sensing, whose limits hold for what flows then, a modulation of zero shorts the windings: the
//! low sides are on throughout. Half of the period each would short them as well, but for the dead time, whose voltage
//! is as large as the back-EMF of a slow rotor.

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

    /// Takes up a command. A negative one turns the vector by half a turn; its advance is in the direction of the
    /// command, too.
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
        let middle = if self.shorts(config) { 0 } else { config.limits.half() };
        self.axes = Axes::new(amplitude, config.order(), middle);
    }

    /// Whether the windings are shorted.
    const fn shorts(&self, config: &Config) -> bool {
        self.amplitude.to_bits() == 0 && config.control.is_some()
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
            Commutation::Block if self.shorts(config) => self.sinusoidal(rotor),
            Commutation::Block => {
                self.sextant = self.sextant.follow(rotor + self.lead);
                self.sextant.output(config.order(), self.amplitude, config.limits.half())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};

    #[test]
    fn no_voltage_shorts_the_windings_through_the_low_sides_where_currents_are_watched() {
        for control in [None, Some(Control::default())] {
            for commutation in [Commutation::Block, Commutation::Sinusoidal, Commutation::FieldOriented] {
                let settings = Settings { control, commutation, ..Settings::default() };
                // There is no field orientation without currents.
                let Ok(config) = settings.validate() else { continue };
                let half = config.limits.half();
                let mut voltage = Voltage::new(&config);
                for angle in (0..16).map(|k| ElectricalAngle::from_bits(k << 28)) {
                    for modulation in [Modulation::ZERO, Modulation::from_bits(1 << 13)] {
                        voltage.command(modulation, &config);
                        let Output { compare, legs } = voltage.output(angle, &config);
                        let shorted = legs == Legs::ALL && compare == [0; 3];
                        assert_eq!(shorted, control.is_some() && modulation == Modulation::ZERO, "{commutation:?}");
                        assert!(shorted || compare.iter().any(|count| *count >= half), "{commutation:?} {compare:?}");
                    }
                }
            }
        }
    }
}
