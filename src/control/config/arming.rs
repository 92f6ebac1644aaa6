//! What the check at arming asks for, in the units of the interrupt.

use super::Frame;
use crate::control::Scale;
use crate::settings::Control;

/// Currents in 2⁻¹⁵ of the full scale, modulations in 2⁻³¹, times in steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct ArmingCheck {
    pub enabled: bool,
    /// Current by which phases and amplifiers are checked.
    pub current: i32,
    /// Largest current of the push.
    pub push: i32,
    /// What the modulation rises by in a step, on a bus of the full scale.
    pub rise: i32,
    /// Modulation to begin with: most of what the dead time takes.
    pub least: i32,
    /// Modulation that the dead time takes at most; beyond it, so many steps of the rise have to make the current.
    pub most: i32,
    pub longest: i32,
    /// Longest push.
    pub longest_push: u32,
    /// Speed below which the rotor rests, in 2⁻³² electrical turns a step.
    pub at_rest: i32,
}

/// Time in which the voltage rises by what drives the current through the resistance.
const RISE_S: f32 = 1e-3;
/// Multiple of that voltage that has to make the current: a resistance may be so much larger than it is set.
const MOST: f32 = 4.0;
/// Longest push, s.
const PUSH_S: f32 = 40e-3;
/// A rotor slower than this rests, electrical Hz, at least and at most: one whose back-EMF drives no more than a share
/// of the current of the check through the shorted windings.
const REST_HZ: core::ops::Range<f32> = 0.5..8.0;
const REST_SHARE: f32 = 0.15;

impl ArmingCheck {
    /// Of settings that are in their ranges.
    pub fn new(settings: &Control, frame: &Frame, scale: &Scale) -> Self {
        let Control { max_current_a: most_a, resistance_ohm, .. } = *settings;
        // Enough to be seen beside the noise, but nothing that would move much.
        let current_a = (0.2 * most_a).max(scale.amperes / 100.0).min(0.5 * most_a);
        let current = current_a * scale.per_ampere();
        let full = 2_147_483_648.0;
        let steps = RISE_S * scale.step_hz;
        // One leg against two: each loses the dead time's share of the bus; in shares of half the bus.
        let dead = 8.0 / 3.0 * frame.dead_time_s * frame.pwm_hz;
        let rest_hz = REST_SHARE * resistance_ohm * current_a / settings.flux_linkage_wb / core::f32::consts::TAU;
        let rest_hz = rest_hz.clamp(REST_HZ.start, REST_HZ.end);
        // Never so slow that it would take long to get over the dead time.
        let rise = (2.0 * resistance_ohm * current_a / scale.volts / steps).max(1e-3 / steps);
        Self {
            enabled: settings.guard.arming_check && current >= 16.0,
            current: current as i32,
            push: (0.6 * most_a * scale.per_ampere()).max(current) as i32,
            rise: (rise * full).clamp(1.0, 2_147_483_520.0) as i32,
            least: (0.7 * dead * full).min(0.5 * full) as i32,
            most: ((1.6 * dead + 0.02) * full).min(0.9 * full) as i32,
            longest: (MOST * steps) as i32,
            longest_push: (PUSH_S * scale.step_hz) as u32,
            at_rest: (rest_hz / scale.step_hz * crate::angle::TURN) as i32,
        }
    }
}
