//! The brake chopper in the units of the interrupt.

use crate::control::Scale;
use crate::settings::Control;

/// Bus voltage below `chopper_v` at which it goes off again, as a share of that: 0.8 V of 26 V. The measured voltage has
/// a noise of a few hundredths of that and steps by the current through the wires to the capacitor; what the resistor
/// takes out of 470 µF in the time from one decision to the next is about as much. A smaller one would have it switch
/// with every decision, a much larger one would draw on the supply.
pub const HYSTERESIS: f32 = 1.0 / 32.0;

/// Of the time on that is counted, so that the smallest share is a whole number.
const UNIT: f32 = 1024.0;

/// Bus voltages in 2⁻¹⁵ of the full scale; the resistor's heat in 2⁻¹⁰ of the time from one decision to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Chopper {
    /// It goes on above, and off at or below.
    pub on: i32,
    pub off: i32,
    /// What heats while it is on, and cools while it is off.
    pub heats: i32,
    pub cools: i32,
    /// Heat that is too much.
    pub most: i32,
}

impl Chopper {
    /// There is none: no voltage switches it on.
    pub const NONE: Self = Self { on: i32::MAX, off: i32::MAX, heats: 0, cools: 1, most: 0 };

    /// Of settings that are in their ranges; `loop_hz` is how often it is decided.
    pub fn new(settings: &Control, loop_hz: f32, scale: &Scale) -> Self {
        let guard = &settings.guard;
        if guard.chopper_v <= 0.0 {
            return Self::NONE;
        }
        let on = guard.chopper_v * 32_768.0 / scale.volts;
        // Never less heat and never more cooling than there is.
        let cools = (guard.chopper_share * UNIT) as i32;
        let heats = UNIT as i32 - cools;
        Self {
            on: on as i32,
            off: (on - HYSTERESIS * on) as i32,
            heats,
            cools,
            most: (guard.chopper_on_s * loop_hz) as i32 * heats,
        }
    }
}
