//! What the check at arming asks for, in the units of the interrupt.

use super::Frame;
use crate::control::Scale;
use crate::float::{whole_i16, whole_u16};
use crate::settings::Control;

/// Currents in 2⁻¹⁵ of the full scale, modulations in 2⁻³¹, times in steps of the check: one every [`EVERY`] control steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct ArmingCheck {
    pub enabled: bool,
    /// Current by which phases and amplifiers are checked.
    pub current: i16,
    /// Largest current of the push.
    pub push: i16,
    /// What the modulation rises by in a step, on a bus of the full scale.
    pub rise: i32,
    /// Modulation to begin with: most of what the dead time takes.
    pub least: i32,
    /// Modulation that the dead time takes at most; beyond it, so many steps of the rise have to make the current.
    pub most: i32,
    pub longest: u16,
    /// Longest push.
    pub longest_push: u16,
    /// Speed of a rotor that the push turns, in 2⁻³² electrical turns a control step.
    pub turning: i32,
    /// Farthest from where it was pushed that a rotor is checked once more, in 2⁻²⁶ electrical turns.
    pub carried: u32,
    /// The tracked speed is averaged over 2^`averages` steps, and lags by so many, averaging included.
    pub averages: u8,
    pub lag: u16,
    /// Steps in which its way tells whether the rotor rests, and the longest way of one that does, in 2⁻³² electrical
    /// turns.
    pub watched: u16,
    pub rests_within: u32,
    /// Speed above which its windings must not be shorted, in 2⁻³² electrical turns a control step.
    pub turns: i32,
}

/// The check takes every second control step, which keeps the longest step short.
pub(crate) const EVERY: u32 = 2;

/// Least current that tells anything, in 2⁻¹⁵ of the full scale: of a smaller one, a phase that is whole, too, shows a tenth more
/// or less by the noise of the amplifiers and the steps of the converter.
const LEAST: f32 = 160.0;
/// Time in which the voltage rises by what drives the current through the resistance.
const RISE_S: f32 = 1e-3;
/// Multiple of that voltage that has to make the current: a resistance may be so much larger than it is set.
const MOST: f32 = 4.0;
/// Longest push, s.
const PUSH_S: f32 = 80e-3;
/// Time by which the tracked speed lags, in time constants of the tracker; one that lags by less than so many steps is
/// noisy and averaged over 16.
const LAGS: f32 = 1.4;
const NOISY: f32 = 12.0;
const AVERAGES: u8 = 4;
/// Speed of the push, electrical Hz.
const PUSH_HZ: f32 = 2.0;
/// Farthest that cogging carries a sound rotor on, electrical degrees.
const CARRIED_DEG: i32 = 120;
/// A wrong commutation may turn the shaft by so many degrees in all; of these, the second hold takes so many electrical ones.
const SHAFT_DEG: i32 = 30;
const HELD_DEG: i32 = 75;
/// An electrical degree, in 2⁻²⁶ turns.
const DEGREE: i32 = (1 << 26) / 360;
/// A rotor slower than this rests, electrical Hz, at least and at most: one whose back-EMF drives no more than a share
/// of the current of the check through the shorted windings.
const REST_HZ: core::ops::Range<f32> = 0.5..8.0;
const REST_SHARE: f32 = 0.15;
/// Multiple of that speed up to which the windings may be shorted to bring the rotor to rest; more than the noise of the
/// tracked speed at least, electrical Hz.
const SHORTED: f32 = 2.0;
const NOISE_HZ: f32 = 4.0;
/// Whether a rotor rests is told by its way in so many seconds: noise moves it by 0.1°, half a hertz by 1.8°.
const WATCHED_S: f32 = 10e-3;

impl ArmingCheck {
    /// Of settings that are in their ranges.
    pub fn new(settings: &Control, frame: &Frame, scale: &Scale) -> Self {
        let Control { max_current_a: most_a, resistance_ohm, .. } = *settings;
        // Enough to be seen beside the noise, but nothing that would move much.
        let current_a = (0.2 * most_a).max(scale.amperes / 100.0).min(most_a);
        let current = current_a * scale.per_ampere();
        let full = 2_147_483_648.0;
        let step_hz = scale.step_hz / EVERY as f32;
        let steps = RISE_S * step_hz;
        // One leg against two: each loses the dead time's share of the bus; in shares of half the bus.
        let dead = 8.0 / 3.0 * frame.dead_time_s * frame.pwm_hz;
        let rest_hz = REST_SHARE * resistance_ohm * current_a / settings.flux_linkage_wb / core::f32::consts::TAU;
        let rest_hz = rest_hz.clamp(REST_HZ.start, REST_HZ.end);
        // Never so slow that it would take long to get over the dead time.
        let rise = (2.0 * resistance_ohm * current_a / scale.volts / steps).max(1e-3 / steps);
        let lag = LAGS * step_hz / (core::f32::consts::TAU * frame.tracking_hz);
        let averages = if lag < NOISY { AVERAGES } else { 0 };
        let averaged = if averages > 0 { (1 << averages) as f32 } else { 0.0 };
        let speed = |hz: f32| (hz / scale.step_hz * crate::angle::TURN) as i32;
        Self {
            enabled: settings.guard.arming_check && current >= LEAST,
            current: whole_i16(current),
            push: whole_i16(0.6 * most_a * scale.per_ampere()),
            rise: ((rise * full) as i32).max(1),
            least: (0.7 * dead * full).min(0.5 * full) as i32,
            most: ((1.6 * dead + 0.02) * full).min(0.9 * full) as i32,
            longest: whole_u16(MOST * steps),
            longest_push: whole_u16(PUSH_S * step_hz),
            turning: speed(PUSH_HZ),
            carried: ((SHAFT_DEG * scale.pole_pairs as i32 - HELD_DEG).clamp(0, CARRIED_DEG) * DEGREE) as u32,
            averages,
            lag: whole_u16(lag + averaged),
            watched: whole_u16(WATCHED_S * step_hz),
            rests_within: (WATCHED_S * rest_hz * crate::angle::TURN) as u32,
            turns: speed((SHORTED * rest_hz).max(rest_hz + NOISE_HZ)),
        }
    }
}
