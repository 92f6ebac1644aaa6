//! What a person sets for currents, torque, speed and position, in SI units, and what the interrupt makes of it.

mod guard;

use crate::angle::Position;
use crate::commutation::svpwm;
use crate::control::current::{self, Feedback, LocalGains};
use crate::control::{Current, Motor, Scale, Speed, position, trajectory, velocity};
use crate::drive::{CYCLE, OUTER};
use crate::pwm;
use crate::settings::{Check, Error};
use core::f32::consts::TAU;
use core::fmt;
pub(crate) use guard::Guard;
pub use guard::{GuardSettings, OnTimeout, Thermistor};

/// Current and bus sensing, the motor, the loops and their limits. The default is the motor of Simpkins and Todorov on 24 V, with
/// amplifiers of 0.2 V/A about the middle of 3.3 V, and a divider of eleven.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// Current from the middle of the ADC's range to its end, 0.1 to 1000 A.
    pub current_full_scale_a: f32,
    /// Bus voltage at the end of the ADC's range, 5 to 1000 V.
    pub bus_full_scale_v: f32,
    /// Resistance of a phase, 1 mΩ to 100 Ω.
    pub resistance_ohm: f32,
    /// Inductance of a phase, 1 µH to 0.1 H.
    pub inductance_h: f32,
    /// Flux linkage of a phase, 10 µWb to 1 Wb.
    pub flux_linkage_wb: f32,
    /// Inertia of all that turns, 1e-9 to 1 kg·m².
    pub inertia_kgm2: f32,
    /// Bandwidth of the current control, 10 Hz to a twentieth of the PWM frequency.
    pub current_bandwidth_hz: f32,
    /// Parts of the local feedback with block and sinusoidal commutation.
    pub feedback: Feedback,
    /// Bandwidth of the speed control, 0.5 Hz to a quarter of that of the current.
    pub speed_bandwidth_hz: f32,
    /// Bandwidth of the position control, 0.1 Hz to half of that of the speed.
    pub position_bandwidth_hz: f32,
    /// Current below which the dead time acts in part only, 1 mA to the full scale.
    pub dead_time_ramp_a: f32,
    /// Largest current, up to nine tenths of the full scale; more is cut.
    pub max_current_a: f32,
    /// Largest mechanical speed of a command, 0.1 rad/s to what `max_electrical_hz` allows.
    pub max_speed_rad_s: f32,
    /// Largest acceleration of a trajectory, 1 to 1e6 rad/s².
    pub max_acceleration_rad_s2: f32,
    /// Faults.
    pub guard: GuardSettings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            current_full_scale_a: 8.25,
            bus_full_scale_v: 36.3,
            resistance_ohm: 3.75,
            inductance_h: 0.36e-3,
            flux_linkage_wb: 5e-3,
            inertia_kgm2: 1e-5,
            current_bandwidth_hz: 1000.0,
            feedback: Feedback::Pi,
            speed_bandwidth_hz: 60.0,
            position_bandwidth_hz: 15.0,
            dead_time_ramp_a: 0.05,
            max_current_a: 3.0,
            max_speed_rad_s: 500.0,
            max_acceleration_rad_s2: 5000.0,
            guard: GuardSettings::default(),
        }
    }
}

/// [`Settings`] in the units of the interrupt.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    pub(crate) gains: current::Gains,
    pub(crate) local: LocalGains,
    pub(crate) velocity: velocity::Gains,
    pub(crate) position: position::Gain,
    pub(crate) trajectory: trajectory::Limits,
    /// Largest speed to catch up with the trajectory: an eighth more than its largest.
    pub(crate) catching_up: i32,
    pub(crate) max_current: i32,
    /// To a code for a full scale of 2¹⁶.
    pub(crate) shift: u32,
    pub(crate) modulator: svpwm::Modulator,
    /// Voltage in 2⁻¹⁵ of its full scale per voltage of the current control and bus, in 2⁻³⁸.
    pub(crate) volts: i32,
    /// Slope of the dead time's correction: current of the [modulator](svpwm::Modulator::compare)'s unit per current.
    pub(crate) ramp: i32,
    /// Current from which on the correction hardly changes any more.
    pub(crate) steep: i32,
    /// Whether phases B and C are exchanged.
    pub(crate) reversed: bool,
    /// Speed from which on the back-EMF tells the alignment.
    pub(crate) trim_from: i32,
    /// What the alignment is moved by, each [`CYCLE`](crate::drive::CYCLE) steps, per voltage along d; in 2⁻⁵⁶ turns.
    pub(crate) trim_gain: i32,
    pub(crate) guard: Guard,
    pub(crate) scale: Scale,
    pub(crate) motor: Motor,
}

/// What the control shares with the rest of a drive.
pub(crate) struct Frame {
    pub adc_bits: u8,
    pub pole_pairs: u8,
    pub pwm_hz: f32,
    pub period: u16,
    pub dead_time: u16,
    pub limits: pwm::Limits,
    pub max_electrical_hz: f32,
    pub reversed: bool,
}

impl Settings {
    /// Checks every field.
    pub(crate) fn validate(&self, frame: &Frame, check: &mut Check) -> Result<Config, Error> {
        let amperes = check.within("current_full_scale_a", self.current_full_scale_a, 0.1, 1000.0);
        let volts = check.within("bus_full_scale_v", self.bus_full_scale_v, 5.0, 1000.0);
        let scale = Scale { step_hz: frame.pwm_hz, amperes, volts, pole_pairs: frame.pole_pairs.into() };
        let motor = Motor {
            resistance_ohm: check.within("resistance_ohm", self.resistance_ohm, 1e-3, 100.0),
            inductance_h: check.within("inductance_h", self.inductance_h, 1e-6, 0.1),
            flux_linkage_wb: check.within("flux_linkage_wb", self.flux_linkage_wb, 1e-5, 1.0),
            inertia_kgm2: check.within("inertia_kgm2", self.inertia_kgm2, 1e-9, 1.0),
        };
        let current_hz = check.within("current_bandwidth_hz", self.current_bandwidth_hz, 10.0, frame.pwm_hz / 20.0);
        let speed_hz = check.within("speed_bandwidth_hz", self.speed_bandwidth_hz, 0.5, current_hz / 4.0);
        let position_hz = check.within("position_bandwidth_hz", self.position_bandwidth_hz, 0.1, speed_hz / 2.0);
        let ramp = check.within("dead_time_ramp_a", self.dead_time_ramp_a, 1e-3, amperes) * scale.per_ampere();
        let max_current = check.within("max_current_a", self.max_current_a, 0.0, 0.9 * amperes) * scale.per_ampere();
        let fastest_hz = frame.max_electrical_hz;
        let fastest = TAU * fastest_hz / scale.pole_pairs;
        let speed = check.within("max_speed_rad_s", self.max_speed_rad_s, 0.1, fastest) * scale.per_radian_s();
        let acceleration = check.within("max_acceleration_rad_s2", self.max_acceleration_rad_s2, 1.0, 1e6);
        let loop_hz = scale.step_hz / OUTER as f32;
        let acceleration = acceleration * scale.per_radian_s() / loop_hz;
        let gain = |field, gain: f32| Error::OutOfRange { field, value: gain, min: 0.0, max: 0.0 };
        let least_bus = self.guard.under_voltage_v / volts;
        let longest = svpwm::Modulator::longest(frame.period, frame.dead_time, &frame.limits);
        let guard = self.guard.validate(frame.adc_bits, loop_hz, &scale, check);
        check.done()?;
        Ok(Config {
            guard,
            gains: current::Gains::new(&motor, current_hz, fastest_hz, &scale, least_bus, longest as f32)
                .map_err(|max| Error::OutOfRange { field: "current_bandwidth_hz", value: current_hz, min: 0.0, max })?,
            local: LocalGains::new(&motor, self.feedback, current_hz, &scale)
                .ok_or(gain("current_bandwidth_hz", current_hz))?,
            velocity: velocity::Gains::new(&motor, speed_hz, loop_hz, &scale)
                .ok_or(gain("speed_bandwidth_hz", speed_hz))?,
            position: position::Gain::new(position_hz, loop_hz).ok_or(gain("position_bandwidth_hz", position_hz))?,
            trajectory: trajectory::Limits::new((acceleration as i32).max(1), speed as i32)
                .ok_or(gain("max_acceleration_rad_s2", self.max_acceleration_rad_s2))?,
            catching_up: (1.125 * speed) as i32,
            max_current: libm::roundf(max_current) as i32,
            shift: 16 - u32::from(frame.adc_bits),
            volts: (longest * 65_536.0 * 4_194_304.0 / f64::from(svpwm::LONGEST)) as i32,
            modulator: svpwm::Modulator::new(frame.period, frame.dead_time, &frame.limits, frame.reversed),
            ramp: (svpwm::RAMP as f32 / ramp.max(1.0)) as i32,
            steep: (RAMPS as f32 * ramp.max(1.0)) as i32,
            reversed: frame.reversed,
            // A back-EMF of a fiftieth of the bus divider's full scale.
            trim_from: (volts / 50.0 / motor.flux_linkage_wb / TAU / scale.step_hz * 4_294_967_296.0).min(536_870_912.0)
                as i32,
            // There, a time constant of half a second on a bus of the full scale: an electrical radian over that voltage and the
            // corrections of the time.
            trim_gain: (4_294_967_296.0
                / TAU
                / (svpwm::LONGEST as f32 / longest as f32 / 50.0)
                / (0.5 * scale.step_hz / CYCLE as f32)
                * 16_777_216.0)
                .clamp(1.0, 2_147_483_520.0) as i32,
            scale,
            motor,
        })
    }
}

/// A command that is no number or beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BadDemand {
    /// What was asked for.
    pub value: f64,
    /// Largest magnitude allowed.
    pub most: f64,
}

impl fmt::Display for BadDemand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the command is {}, but must be a number from {} to {}", self.value, -self.most, self.most)
    }
}

impl core::error::Error for BadDemand {}

/// Multiple of the current below which the dead time acts in part, from which on its correction is the same.
const RAMPS: i32 = 64;

impl Config {
    /// A bus voltage in 2⁻¹⁵ of its full scale.
    #[inline(always)]
    pub(crate) const fn bus(&self, code: u16) -> i32 {
        ((code as i32) << self.shift) >> 1
    }

    /// Least bus voltage that is no fault, in volts.
    pub(crate) fn under_voltage_v(&self) -> f32 {
        self.bus(self.guard.under as u16) as f32 / 32_768.0 * self.scale.volts
    }

    /// Largest acceleration of a trajectory, in rad/s².
    pub(crate) fn acceleration_rad_s2(&self) -> f32 {
        self.trajectory.acceleration() as f32 / self.scale.per_radian_s() * self.scale.step_hz / OUTER as f32
    }

    /// Time from the largest speed to rest, in seconds.
    pub(crate) fn braking_s(&self) -> f32 {
        self.trajectory.speed() as f32 / self.scale.per_radian_s() / self.acceleration_rad_s2()
    }

    /// A current along q, in amperes.
    ///
    /// # Errors
    /// Not a number, or beyond `max_current_a`.
    pub fn current(&self, amperes: f32) -> Result<Current, BadDemand> {
        let most = self.max_current as f32 / self.scale.per_ampere();
        demand(amperes.into(), most.into())?;
        Ok(Current((libm::roundf(amperes * self.scale.per_ampere()) as i32).clamp(-self.max_current, self.max_current)))
    }

    /// Current below which the dead time acts in part only, in amperes.
    pub(crate) fn dead_time_ramp_a(&self) -> f32 {
        self.steep as f32 / RAMPS as f32 / self.scale.per_ampere()
    }

    /// The current of a torque in newton metres, by the flux linkage.
    ///
    /// # Errors
    /// Not a number, or beyond the torque of `max_current_a`.
    pub fn torque(&self, newton_metres: f32) -> Result<Current, BadDemand> {
        let constant = self.motor.torque_constant(self.scale.pole_pairs);
        let most = self.max_current as f32 / self.scale.per_ampere() * constant;
        demand(newton_metres.into(), most.into())?;
        self.current(newton_metres / constant)
    }

    /// A mechanical speed in radians a second.
    ///
    /// # Errors
    /// Not a number, or beyond `max_speed_rad_s`.
    pub fn speed(&self, radians_s: f32) -> Result<Speed, BadDemand> {
        let most = self.trajectory.speed() as f32 / self.scale.per_radian_s();
        demand(radians_s.into(), most.into())?;
        let most = self.trajectory.speed();
        Ok(Speed(((radians_s * self.scale.per_radian_s()) as i32).clamp(-most, most)))
    }

    /// A mechanical position in turns.
    ///
    /// # Errors
    /// Not a number, or beyond a quarter of the range of a [`Position`].
    pub fn position(&self, turns: f64) -> Result<Position, BadDemand> {
        let pairs = f64::from(self.scale.pole_pairs);
        demand(turns, f64::from(1 << 29) / pairs)?;
        Ok(Position::from_bits(libm::round(turns * pairs * 4_294_967_296.0) as i64))
    }
}

fn demand(value: f64, most: f64) -> Result<(), BadDemand> {
    // The limit itself has been rounded.
    if value.abs() <= most * 1.000_1 { Ok(()) } else { Err(BadDemand { value, most }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Change = fn(&mut Settings);

    fn validate(settings: &Settings) -> Result<crate::settings::Config, Error> {
        crate::settings::Settings { control: Some(*settings), ..Default::default() }.validate()
    }

    #[test]
    fn every_field_out_of_range_is_named() {
        assert!(validate(&Settings::default()).is_ok());
        let cases: [(&str, Change); 24] = [
            ("current_full_scale_a", |s| s.current_full_scale_a = 0.0),
            ("bus_full_scale_v", |s| s.bus_full_scale_v = f32::NAN),
            ("resistance_ohm", |s| s.resistance_ohm = 0.0),
            ("inductance_h", |s| s.inductance_h = -1.0),
            ("flux_linkage_wb", |s| s.flux_linkage_wb = f32::NAN),
            ("inertia_kgm2", |s| s.inertia_kgm2 = 0.0),
            ("current_bandwidth_hz", |s| s.current_bandwidth_hz = 2001.0),
            ("speed_bandwidth_hz", |s| s.speed_bandwidth_hz = 251.0),
            ("position_bandwidth_hz", |s| s.position_bandwidth_hz = 31.0),
            ("dead_time_ramp_a", |s| s.dead_time_ramp_a = 0.0),
            ("max_current_a", |s| s.max_current_a = 7.5),
            ("max_speed_rad_s", |s| s.max_speed_rad_s = 1e5),
            ("max_acceleration_rad_s2", |s| s.max_acceleration_rad_s2 = 0.0),
            ("under_voltage_v", |s| s.guard.under_voltage_v = 0.0),
            ("over_voltage_v", |s| s.guard.over_voltage_v = 11.0),
            ("over_current_a", |s| s.guard.over_current_a = 8.25),
            ("imbalance_a", |s| s.guard.imbalance_a = f32::NAN),
            ("offset_a", |s| s.guard.offset_a = -1.0),
            ("pull_up_ohm", |s| s.guard.bridge.pull_up_ohm = 0.0),
            ("nominal_ohm", |s| s.guard.motor.nominal_ohm = f32::INFINITY),
            ("beta_k", |s| s.guard.motor.beta_k = 10.0),
            ("max_c", |s| s.guard.bridge.max_c = 80.0),
            ("stall_s", |s| s.guard.stall_s = 0.0),
            ("command_timeout_s", |s| s.guard.command_timeout_s = f32::NAN),
        ];
        for (name, change) in cases {
            let mut settings = Settings::default();
            change(&mut settings);
            match validate(&settings) {
                Err(Error::OutOfRange { field, .. }) => assert_eq!(field, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    }

    #[test]
    fn commands_that_are_no_number_or_too_large_are_refused() {
        let config = validate(&Settings::default()).unwrap().control.unwrap();
        for bad in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e9, -1e9] {
            assert!(config.current(bad).is_err() && config.speed(bad).is_err() && config.torque(bad).is_err());
            assert!(config.position(f64::from(bad)).is_err());
        }
        assert_eq!(config.current(3.0).unwrap().0, config.max_current);
        assert_eq!(config.torque(0.09).unwrap().0, config.max_current);
        assert!(config.current(3.01).is_err());
        assert_eq!(config.position(1.25).unwrap().to_bits(), 5 << 32);
        // 100 rad/s are 63.66 Hz electrical.
        let hz = f64::from(config.speed(100.0).unwrap().0) * 40e3 / 4_294_967_296.0;
        assert!((hz - 63.662).abs() < 1e-3, "{hz}");
    }
}
