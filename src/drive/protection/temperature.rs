//! Temperatures of bridge and motor, as their thermistors tell: a warm one gets less current, a hot one is a fault, and
//! so is a thermistor that is open or shorted.

use crate::board::{Sample, TemperatureCode};
use crate::control::config::Config;
use crate::fault::Fault;

/// Largest current that a temperature allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Temperature {
    /// In 2⁻¹⁵ of the full scale.
    pub most: i32,
}

impl Temperature {
    /// None known yet.
    pub const NONE: Self = Self { most: 0 };

    /// Takes up the temperature of bridge (0) or motor (1).
    #[cfg_attr(not(feature = "small"), inline(always))]
    #[cfg_attr(feature = "small", inline(never))]
    pub fn derate(&mut self, config: &Config, sample: &Sample, place: usize) {
        let heat = &config.guard.heat[place];
        let above = (code(config, sample, place) - heat.fault).max(0);
        let share = if above < heat.room { (above * heat.slope) >> 8 } else { 1 << 16 };
        // 0.9 · 2¹⁵ and 2¹⁶.
        self.most = (config.max_current * share) >> 16;
    }
}

/// The fault of the temperature of bridge (0) or motor (1), or of its thermistor.
#[cfg_attr(not(feature = "small"), inline(always))]
#[cfg_attr(feature = "small", inline(never))]
pub fn fault(config: &Config, sample: &Sample, place: usize) -> Option<Fault> {
    let heat = &config.guard.heat[place];
    let code = code(config, sample, place);
    if code >= heat.fault && code <= heat.open {
        return None;
    }
    if sample.temperatures[place] == TemperatureCode::MISSING {
        return None;
    }
    let faults = if code < heat.shorted || code > heat.open {
        [Fault::BridgeThermistor, Fault::MotorThermistor]
    } else {
        [Fault::BridgeHot, Fault::MotorHot]
    };
    Some(faults[place % 2])
}

/// For a full scale of 2¹⁶.
#[inline(always)]
fn code(config: &Config, sample: &Sample, place: usize) -> i32 {
    i32::from(sample.temperatures[place].to_bits()) << config.shift
}
