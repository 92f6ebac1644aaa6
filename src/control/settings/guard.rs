//! When currents, voltage, temperatures, a standstill or silence are a fault.

use crate::control::Scale;
use crate::drive::CYCLE;
use crate::settings::Check;

/// Thresholds of the faults.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GuardSettings {
    /// Least bus voltage, at least a twentieth of the full scale.
    pub under_voltage_v: f32,
    /// Largest bus voltage, up to the full scale.
    pub over_voltage_v: f32,
    /// Largest current of a phase, up to the full scale.
    pub over_current_a: f32,
    /// Largest sum of the three currents: beyond at two looks, eight steps apart, an amplifier is wrong.
    pub imbalance_a: f32,
    /// Largest current that an amplifier may show while none flows.
    pub offset_a: f32,
    /// Thermistor of the bridge.
    pub bridge: Thermistor,
    /// Thermistor of the motor.
    pub motor: Thermistor,
    /// How long the current may be at its limit while the rotor does not turn under speed or position control, 0.01 to 100 s.
    pub stall_s: f32,
    /// How long a command holds, 0.001 to 1000 s; infinity: for ever.
    pub command_timeout_s: f32,
    /// What happens then.
    pub on_timeout: OnTimeout,
}

/// What a drive does whose commands stay away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OnTimeout {
    /// A fault: bridge off.
    #[default]
    Fault,
    /// Brakes to rest under speed control and stays there.
    Stop,
}

/// An NTC between the ADC's pin and ground, pulled up to the reference: `R = R₂₅ · exp(B (1/T − 1/298.15 K))`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Thermistor {
    /// Pull-up, 10 Ω to 10 MΩ.
    pub pull_up_ohm: f32,
    /// Resistance at 25 °C, 10 Ω to 10 MΩ.
    pub nominal_ohm: f32,
    /// B, 1000 to 10000 K.
    pub beta_k: f32,
    /// Above, the largest current is reduced, linearly down to nothing at `max_c`; −40 to 200 °C.
    pub warn_c: f32,
    /// Above, a fault; at least 1 °C above `warn_c`, up to 200 °C.
    pub max_c: f32,
}

impl Thermistor {
    /// 10 kΩ at a pull-up of 10 kΩ, B = 3380 K.
    pub const fn ntc_10k(warn_c: f32, max_c: f32) -> Self {
        Self { pull_up_ohm: 10e3, nominal_ohm: 10e3, beta_k: 3380.0, warn_c, max_c }
    }

    /// What the ADC reads at a temperature, for a full scale of 2¹⁶.
    pub fn code(&self, celsius: f32) -> f32 {
        let resistance = self.nominal_ohm * libm::expf(self.beta_k * (1.0 / (celsius + 273.15) - 1.0 / 298.15));
        65_536.0 * resistance / (resistance + self.pull_up_ohm)
    }

    fn validate(&self, check: &mut Check) -> Heat {
        check.within("pull_up_ohm", self.pull_up_ohm, 10.0, 1e7);
        check.within("nominal_ohm", self.nominal_ohm, 10.0, 1e7);
        check.within("beta_k", self.beta_k, 1e3, 1e4);
        let warn_c = check.within("warn_c", self.warn_c, -40.0, 199.0);
        let max_c = check.within("max_c", self.max_c, warn_c + 1.0, 200.0);
        let (fault, warn) = (self.code(max_c), self.code(warn_c));
        let room = (warn - fault).max(1.0);
        Heat { fault: fault as i32, room: room as i32, slope: (16_777_216.0 / room) as i32 }
    }
}

impl Default for GuardSettings {
    fn default() -> Self {
        Self {
            under_voltage_v: 12.0,
            over_voltage_v: 32.0,
            over_current_a: 6.0,
            imbalance_a: 0.5,
            offset_a: 0.5,
            bridge: Thermistor::ntc_10k(80.0, 100.0),
            motor: Thermistor::ntc_10k(100.0, 120.0),
            stall_s: 0.5,
            command_timeout_s: f32::INFINITY,
            on_timeout: OnTimeout::Fault,
        }
    }
}

/// Threshold of a temperature in codes, and the way down to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Heat {
    /// Below, it is too hot.
    pub fault: i32,
    /// Codes above that from which on the current is not reduced.
    pub room: i32,
    /// Share of the current per code, in 2⁻²⁴.
    pub slope: i32,
}

/// Thresholds in the units of the interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Guard {
    /// Least bus voltage and the range above it, in codes.
    pub under: u32,
    pub range: u32,
    /// In codes.
    pub over_current: u32,
    /// In codes.
    pub imbalance: u32,
    pub offset: i32,
    pub heat: [Heat; 2],
    /// Cycles.
    pub stall: u32,
    /// Steps of the outer loops; 0 is for ever.
    pub timeout: u32,
    pub stops: bool,
    /// Slower is at rest, for the stall.
    pub creep: i32,
}

impl GuardSettings {
    pub(super) fn validate(&self, adc_bits: u8, loop_hz: f32, scale: &Scale, check: &mut Check) -> Guard {
        let codes = libm::exp2f(adc_bits.into());
        let per_volt = codes / scale.volts;
        let under = check.within("under_voltage_v", self.under_voltage_v, scale.volts / 20.0, 0.9 * scale.volts);
        let over = check.within("over_voltage_v", self.over_voltage_v, under, scale.volts);
        let most = scale.amperes;
        let per_ampere = codes / 2.0 / most;
        let timeout_s = self.command_timeout_s;
        let timeout =
            if timeout_s == f32::INFINITY { 0.0 } else { check.within("command_timeout_s", timeout_s, 1e-3, 1e3) };
        Guard {
            under: libm::ceilf(under * per_volt) as u32,
            range: ((over - under) * per_volt) as u32,
            over_current: (check.within("over_current_a", self.over_current_a, 0.0, 0.99 * most) * per_ampere) as u32,
            imbalance: (check.within("imbalance_a", self.imbalance_a, 0.0, most) * per_ampere) as u32,
            offset: (check.within("offset_a", self.offset_a, 0.0, most) * scale.per_ampere()) as i32,
            heat: [self.bridge.validate(check), self.motor.validate(check)],
            stall: (check.within("stall_s", self.stall_s, 0.01, 100.0) * scale.step_hz / CYCLE as f32) as u32,
            timeout: libm::ceilf(timeout * loop_hz) as u32,
            stops: self.on_timeout == OnTimeout::Stop,
            creep: scale.per_radian_s() as i32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thermistor_reads_half_at_25_degrees_and_less_when_hot() {
        let ntc = Thermistor::ntc_10k(80.0, 100.0);
        assert!((ntc.code(25.0) - 32_768.0).abs() < 1.0);
        // 10 kΩ · exp(3380 (1/373.15 − 1/298.15)) = 1.024 kΩ.
        assert!((ntc.code(100.0) / 65_536.0 - 0.0929).abs() < 2e-4);
        assert!(ntc.code(80.0) > ntc.code(100.0));
    }
}
