//! What the supply gives and takes back, in the units of the interrupt.

use super::bounded;
use crate::control::{Motor, Scale};
use crate::settings::Control;

/// How much more than by the settings braking may return: a flux linkage 20 % larger and a resistance 25 % smaller.
const MARGIN: f32 = 1.2 / 0.75;

/// Share of the largest current along d that burns, squared, with the power that nobody notices: see
/// [`protection::supply`](crate::drive).
const BURNT: f32 = 0.894;
/// Share of the power that it takes to brake which the plan of a move counts on. An inertia is known to some 40 %.
const PLANNED: f32 = 0.7;

/// Powers are squares of currents here, over 1.5 of the phase resistance, in 2⁻²⁶ of the full scale's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Supply {
    /// Current that the back-EMF would drive through the resistance, in 2⁻¹³ of the full scale, per speed in 2⁻³².
    pub short: i32,
    /// Power that may go back, per bus voltage in 2⁻¹⁶.
    pub returns: i32,
    /// Power that may be drawn, per bus voltage in 2⁻¹⁶.
    pub gives: i32,
    /// Bus voltage, in 2⁻¹⁵ of its full scale, from which on no current brakes, and the range below in which less does.
    pub end: i32,
    pub band: i32,
    /// Share of the braking current per bus voltage in that range, in 2⁻¹⁶.
    pub slope: i32,
}

impl Supply {
    /// Of settings that are in their ranges.
    pub fn new(settings: &Control, motor: &Motor, scale: &Scale) -> Self {
        let per_ampere = scale.per_ampere() / 4.0;
        let resistance = motor.resistance_ohm;
        let radians_s = core::f32::consts::TAU * scale.step_hz;
        let short = MARGIN * motor.flux_linkage_wb * radians_s / resistance * per_ampere;
        let power = |amperes: f32, resistance: f32| {
            let per_bus = scale.volts / 32_768.0 * amperes / (1.5 * resistance) * per_ampere * per_ampere;
            // Up to what the largest current can make of the largest back-EMF.
            bounded(per_bus, 16)
        };
        let guard = &settings.guard;
        let per_volt = 32_768.0 / scale.volts;
        let room = (guard.over_voltage_v - guard.under_voltage_v) / 16.0 * per_volt;
        // Both so that all may brake where the bus is below the range, but for less than a thousandth: a rounding must not look
        // like a limit of the supply.
        let slope = ((32_768.0 / room.max(0.5)) as i32).max(1);
        let band = (65_535 + slope) / slope;
        Self {
            short: bounded(short, 0),
            returns: power(settings.max_regeneration_a, resistance),
            // A winding that is hot takes more, and so does the bridge.
            gives: power(settings.max_supply_a, 1.4 * resistance),
            end: (guard.over_voltage_v * per_volt - room) as i32,
            band,
            slope,
        }
    }

    /// Speed above which the supply leaves less to brake with than an acceleration takes; 10 Hz at 40 kHz or more, as a
    /// slow rotor brakes with any current. The back-EMF does not matter: the power of the motion is burnt in the windings,
    /// or goes back.
    pub fn full_braking(settings: &Control, scale: &Scale) -> i32 {
        let Control { resistance_ohm, max_current_a, max_regeneration_a, inertia_kgm2, .. } = *settings;
        let burnt = 1.5 * BURNT * resistance_ohm * max_current_a * max_current_a;
        let power = burnt + settings.guard.under_voltage_v * max_regeneration_a;
        let force = inertia_kgm2 * settings.max_acceleration_rad_s2;
        (PLANNED / MARGIN * scale.per_radian_s() * power / force).max(1_048_576.0) as i32
    }
}
