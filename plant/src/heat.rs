//! How warm the windings get: two masses, the copper and the housing about it.

use crate::error::{Error, positive};

/// Rise of copper's resistance per kelvin, of that at the surroundings' temperature.
const COPPER_PER_K: f64 = 0.00393;
/// Time between two looks at the resistance, s: the copper warms by some hundredths of a kelvin meanwhile.
const LOOK_S: f64 = 1e-3;

/// What the copper's warmth meets on its way to the surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatParameters {
    /// From the copper to the housing, K/W.
    pub copper_k_per_w: f64,
    /// Time constant of the copper on that way, s.
    pub copper_time_s: f64,
    /// From the housing to the surroundings, K/W.
    pub housing_k_per_w: f64,
    /// Time constant of the housing on that way, s.
    pub housing_time_s: f64,
}

/// The two masses.
#[derive(Clone, Debug)]
pub(crate) struct Heat {
    parameters: HeatParameters,
    cold_ohm: f64,
    /// Temperatures above the surroundings, K.
    pub copper_k: f64,
    pub housing_k: f64,
    /// Square of the currents over the time since the last look, A²s.
    charge: f64,
    since_s: f64,
}

impl Heat {
    /// As cold as the surroundings, where a phase's copper has this resistance.
    pub fn new(parameters: &HeatParameters, cold_ohm: f64) -> Result<Self, Error> {
        positive(parameters.copper_k_per_w, "motor.heat.copper_k_per_w")?;
        positive(parameters.copper_time_s, "motor.heat.copper_time_s")?;
        positive(parameters.housing_k_per_w, "motor.heat.housing_k_per_w")?;
        positive(parameters.housing_time_s, "motor.heat.housing_time_s")?;
        Ok(Self { parameters: *parameters, cold_ohm, copper_k: 0.0, housing_k: 0.0, charge: 0.0, since_s: 0.0 })
    }

    /// Resistance of a phase's copper now, Ω.
    pub fn resistance_ohm(&self) -> f64 {
        self.cold_ohm * (1.0 + COPPER_PER_K * self.copper_k)
    }

    /// Takes up what a span of mean currents heats; the copper's resistance where it is looked at again.
    pub fn take(&mut self, currents_a: &[f64; 3], span_s: f64) -> Option<f64> {
        self.charge += currents_a.iter().map(|current| current * current).sum::<f64>() * span_s;
        self.since_s += span_s;
        if self.since_s < LOOK_S {
            return None;
        }
        let HeatParameters { copper_k_per_w, copper_time_s, housing_k_per_w, housing_time_s } = self.parameters;
        let into_copper_w = self.resistance_ohm() * self.charge / self.since_s;
        let into_housing_w = (self.copper_k - self.housing_k) / copper_k_per_w;
        let out_w = self.housing_k / housing_k_per_w;
        self.copper_k += (into_copper_w - into_housing_w) * copper_k_per_w / copper_time_s * self.since_s;
        self.housing_k += (into_housing_w - out_w) * housing_k_per_w / housing_time_s * self.since_s;
        (self.charge, self.since_s) = (0.0, 0.0);
        Some(self.resistance_ohm())
    }
}
