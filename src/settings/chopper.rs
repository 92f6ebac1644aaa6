//! Where the bus voltage that switches the brake resistor on may be.

use super::Control;
use crate::control::config::HYSTERESIS;

/// Above the least bus voltage by the hysteresis and a tenth, or the resistor would draw on the supply until that is too
/// low; 0 where there is none.
pub(super) fn least(control: &Control) -> f32 {
    let guard = &control.guard;
    if guard.chopper_v > 0.0 { 1.1 * guard.under_voltage_v / (1.0 - HYSTERESIS) } else { 0.0 }
}

/// Below the range in which over-voltage limits the braking
/// ([`Supply`](crate::control::config::Config)), or the resistor would be of no use to a drive that brakes.
pub(super) fn most(control: &Control) -> f32 {
    let guard = &control.guard;
    guard.over_voltage_v - LIMITED * (guard.over_voltage_v - guard.under_voltage_v)
}

/// Share of the range of the bus voltage in which over-voltage limits the braking.
const LIMITED: f32 = 3.0 / 16.0;
