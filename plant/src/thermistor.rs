//! A thermistor at the converter.

use libm::exp;

/// What has happened to a thermistor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThermistorFault {
    /// A broken wire.
    Open,
    /// A short circuit.
    Shorted,
}

/// An NTC between the converter's input and ground, pulled up to its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thermistor {
    /// Pull-up, Ω.
    pub pull_up_ohm: f64,
    /// Resistance at 25 °C, Ω.
    pub nominal_ohm: f64,
    /// B, K.
    pub beta_k: f64,
    /// What is wrong with it.
    pub fault: Option<ThermistorFault>,
}

impl Thermistor {
    /// The converter's input relative to its reference, 0 to 1, at a temperature.
    #[must_use]
    pub fn ratio(&self, celsius: f64) -> f64 {
        match self.fault {
            Some(ThermistorFault::Open) => 1.0,
            Some(ThermistorFault::Shorted) => 0.0,
            None => {
                let relative = exp(self.beta_k * (1.0 / (celsius + 273.15) - 1.0 / 298.15));
                let ohm = self.nominal_ohm * relative;
                ohm / (ohm + self.pull_up_ohm)
            }
        }
    }
}
