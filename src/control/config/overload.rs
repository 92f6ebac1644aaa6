//! What the winding and the bridge stand, in the units of the interrupt.

#[cfg(not(feature = "small"))]
use super::Copper;
use super::bounded;
use crate::control::Scale;
use crate::schedule::LONG;
use crate::settings::Control;

/// Thermal time constant of the bridge's transistors and the copper about them, s; below it, they get no warmer than
/// the continuous current makes them.
const BRIDGE_TIME_S: f32 = 1.0;
/// Share of the square of the continuous current over which the largest current falls to the continuous one.
const BAND: f32 = 0.1;
/// Multiple of that square which is a fault.
const FAULT: f32 = 1.15;
/// The same of the bridge, which is as quick as the rounds in which its limit is looked at.
const BRIDGE_FAULT: f32 = 1.6;

/// A body that the current heats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Heating {
    /// Current that it stands for ever, in 2⁻¹⁵ of the full scale.
    pub current: i32,
    /// The square of that, in 2⁻³⁰ of the full scale's.
    pub square: i32,
    /// Square beyond which is a fault.
    pub fault: i32,
    /// What a count takes of the difference between the present square and the mean, in 2⁻³².
    pub rate: i32,
    /// Largest current per square below that of the continuous current, in 2⁻²⁰.
    pub slope: i32,
}

/// Winding, housing and bridge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Overload {
    pub winding: Heating,
    #[cfg(not(feature = "small"))]
    pub copper: Copper,
    pub housing_rate: i32,
    pub bridge: Heating,
}

impl Overload {
    /// Of settings that are in their ranges.
    pub fn new(settings: &Control, scale: &Scale) -> Self {
        let body = |continuous_a: f32, time_s: f32, fault: f32| {
            // A current beyond what the amplifiers show limits nothing.
            let current = (continuous_a * scale.per_ampere()).clamp(1.0, 43_000.0);
            let square = current * current;
            let largest = settings.max_current_a * scale.per_ampere();
            let slope = (largest - current).max(current / 4.0) / (BAND * square);
            Heating {
                current: current as i32,
                square: square as i32,
                fault: (fault * square) as i32,
                rate: rate(time_s, 16.0, scale),
                slope: (slope * 1_048_576.0).max(1.0) as i32,
            }
        };
        Self {
            winding: body(settings.continuous_current_a, settings.winding_time_s, FAULT),
            #[cfg(not(feature = "small"))]
            copper: Copper::default(),
            housing_rate: rate(settings.housing_time_s, 32.0, scale),
            bridge: body(settings.bridge_continuous_a, BRIDGE_TIME_S, BRIDGE_FAULT),
        }
    }
}

/// The current is counted every so many long cycles.
fn rate(time_s: f32, cycles: f32, scale: &Scale) -> i32 {
    let share = cycles * LONG as f32 / scale.step_hz / time_s;
    bounded(share.min(0.49), 32).max(1)
}
