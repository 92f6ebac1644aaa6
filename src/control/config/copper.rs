//! How warm the winding is by its resistance: what the tasks need to measure it, in the units of the interrupt.

use super::Frame;
use crate::angle::TURN;
use crate::control::Scale;
use crate::settings::{Control, DEAD_TIMES};
use core::f32::consts::TAU;

/// Rise of copper's resistance per kelvin, of the resistance at 25 °C.
pub(crate) const COPPER_PER_K: f32 = 0.00386;
/// Multiple of the largest rise that a measurement tells at most.
const MEASURED: f32 = 1.25;
/// Share of the continuous current below which the winding's resistance is not looked at: a current that warms the
/// winding too much is larger.
const WARMING: f32 = 1.0 / 3.0;
/// The same of the amplifiers' full scale, in 2⁻¹⁵: against what their zeros have drifted by.
const LEAST: f32 = 2048.0;

/// Currents, voltages and speeds as they are noted for the tasks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Copper {
    /// What stands for a resistance that has doubled, as the square of the current that would warm it as much; 0: it is not
    /// measured.
    pub doubled: f32,
    /// Largest square to tell: what cannot be must not keep a drive from arming for long.
    pub most: f32,
    /// Resistance when cold: voltage per current.
    pub cold: f32,
    /// Back-EMF: voltage per speed.
    pub flux: f32,
    /// Least current to measure by; and the least per bus voltage.
    pub least: f32,
    pub least_per_bus: f32,
}

impl Copper {
    /// `rise` is the square that stands for the largest rise.
    pub fn new(settings: &Control, frame: &Frame, scale: &Scale, rise: f32) -> Self {
        let most_k = settings.guard.max_winding_rise_k;
        let cold = settings.resistance_ohm * scale.amperes / scale.volts;
        Self {
            doubled: if most_k > 0.0 { rise / (most_k * COPPER_PER_K) } else { 0.0 },
            most: MEASURED * rise,
            cold,
            flux: settings.flux_linkage_wb * TAU * scale.step_hz * 32_768.0 / scale.volts / TURN,
            least: (WARMING * settings.continuous_current_a * scale.per_ampere()).max(LEAST),
            least_per_bus: DEAD_TIMES * frame.dead_time_s * frame.pwm_hz / cold,
        }
    }
}
