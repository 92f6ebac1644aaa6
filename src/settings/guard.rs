//! What bounds the settings beside their ranges: the board's ceilings, and thresholds that follow from its parts.

use super::{Control, Error, GuardSettings, Settings, find};
use crate::pwm::SQRT_3;
use core::f32::consts::TAU;

/// Largest value that a setting may have on a board: its name and the value.
pub type Ceiling = (&'static str, f32);

/// Noise of the sum of three amplifiers, share of the full scale: six times √3 · 2 codes of 12 bit.
pub(super) const NOISE: f32 = 0.01;
/// Zero of an amplifier, share of the full scale: 2 % of half the reference by two resistors of 1 %, and 4 mV of input
/// offset amplified sixteen times.
pub(super) const OFFSET: f32 = 0.06;

/// A winding's voltage of which that of the dead time is an eighth may be off by 4 % after the dead time's compensation,
/// which is 10 K. With less voltage the resistance tells nothing of the temperature.
#[cfg(not(feature = "small"))]
pub(crate) const DEAD_TIMES: f32 = 8.0;

/// Largest `max_winding_rise_k`: none where even the largest current on the lowest bus voltage measures nothing.
#[cfg(not(feature = "small"))]
pub(super) fn largest_rise_k(settings: &Settings, control: &Control) -> f32 {
    let dead_v = settings.dead_time_s * settings.pwm_hz * control.guard.under_voltage_v;
    if control.max_current_a * control.resistance_ohm >= DEAD_TIMES * dead_v { 500.0 } else { 0.0 }
}

/// Largest `max_speed_rad_s`: that of the largest electrical frequency, and with field weakening the one at which the
/// voltage of an idle motor, at a tenth more, is that of a fault.
pub(super) fn largest_speed_rad_s(settings: &Settings, control: &Control) -> f32 {
    let pole_pairs = f32::from(settings.pole_pairs);
    let followed = TAU * settings.max_electrical_hz / pole_pairs;
    if control.field_weakening_a > 0.0 {
        followed.min(control.guard.over_voltage_v / (1.1 * SQRT_3 * control.flux_linkage_wb * pole_pairs))
    } else {
        followed
    }
}

impl GuardSettings {
    /// The default, with the thresholds of the current sensing for amplifiers of this full scale, A.
    ///
    /// The sum of the currents is not zero, first, by the amplifiers' noise, which is `imbalance_a`: 1 % of the full
    /// scale, six standard deviations where each has two codes of 12 bit. Second, by their gains, each off by up to 2 %
    /// (a shunt and an amplifier of 1 %): currents I, −I/2, −I/2 with gains of +2 %, −2 %, −2 % come to 4 % of I. That
    /// is added for the largest current. An amplifier without a current is off by up to 6 % of the full scale, `offset_a`.
    pub const fn for_full_scale(current_a: f32) -> Self {
        Self { imbalance_a: NOISE * current_a, offset_a: OFFSET * current_a, ..Self::DEFAULT }
    }
}

impl Settings {
    /// The board's ceiling of a setting; infinite without.
    #[inline(never)]
    pub(super) fn ceiling(&self, name: &str) -> f32 {
        self.ceilings.iter().find(|(field, _)| *field == name).map_or(f32::INFINITY, |(_, most)| *most)
    }

    /// Checks the board's ceilings. One for a setting that does not exist is an error, too, for the test of the board.
    pub(super) fn check_ceilings(&self) -> Result<(), Error<'static>> {
        self.ceilings.iter().try_for_each(|&(field, most)| {
            let value = find(field).ok_or(Error::Unknown)?.get(self);
            match value.filter(|&value| value > most) {
                Some(value) => Err(Error::Ceiling { field, value, most }),
                None => Ok(()),
            }
        })
    }
}
