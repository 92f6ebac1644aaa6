//! Gains, limits and scales of the current, speed and position control, computed from their settings.

mod arming;
#[cfg(not(feature = "no-chopper"))]
mod chopper;
#[cfg(not(feature = "small"))]
mod copper;
mod guard;
mod motion;
mod overload;
mod supply;

use super::current::{self, LocalGains};
use super::{Current, Motor, Scale, Speed, bounded, position, trajectory, velocity, weakening};
use crate::angle::{Position, TURN};
use crate::commutation::svpwm;
use crate::double;
use crate::float::nearest;
use crate::math::clamp;
use crate::pwm;
use crate::schedule::{LONG, OUTER};
use crate::settings::{Control, Error};
pub(crate) use arming::{ArmingCheck, EVERY as ARMING_EVERY};
#[cfg(not(feature = "no-chopper"))]
pub(crate) use chopper::{Chopper, HYSTERESIS};
#[cfg(not(feature = "small"))]
pub(crate) use copper::{COPPER_PER_K, Copper};
use core::f32::consts::TAU;
use core::fmt;
pub(crate) use guard::Guard;
pub(crate) use motion::{Model, Motion};
pub(crate) use overload::{Heating, Overload};
pub(crate) use supply::Supply;

/// [`Control`] in the units of the interrupt.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Gains of the d/q current controller.
    pub(crate) gains: current::Gains,
    /// Gains of the local current feedback.
    pub(crate) local: LocalGains,
    pub(crate) velocity: velocity::Gains,
    pub(crate) position: position::Gain,
    pub(crate) trajectory: trajectory::Limits,
    /// Speed above which the supply leaves less to brake with than the trajectory's acceleration takes.
    pub(crate) full_braking: i32,
    /// A deceleration that always brakes from the largest speed to rest.
    pub(crate) deceleration: i32,
    /// Largest speed reference of the position loop, in 2⁻³² electrical turns a step: 9/8 of the trajectory's largest
    /// speed, so that the rotor can catch up with it.
    pub(crate) max_speed_reference: i32,
    /// Speed at which a commanded torque ends, in 2⁻³² electrical turns a step: a tenth beyond the largest or, where that is
    /// little, up to 5 Hz electrical. And the torque that each unit of speed less allows, in 2⁻³² of a unit of current: the
    /// speed loop's gain, or up to three times as much for all torque at half the largest speed.
    pub(crate) torque_ends: i32,
    pub(crate) torque_gain: i32,
    /// Largest current along q (`max_current_a`), in 2⁻¹⁵ of the full scale.
    pub(crate) max_current: i32,
    /// Bits by which an ADC code is shifted left for a full scale of 2¹⁶.
    pub(crate) shift: u8,
    pub(crate) modulator: svpwm::Modulator,
    /// Scale of the d/q voltages for the tasks: voltage in 2⁻¹⁵ of the full scale of the bus, per unit of the current
    /// control's voltage ([`svpwm::LONGEST`]) and of the bus voltage; in 2⁻³⁸.
    pub(crate) volts: i32,
    /// Slope of the dead time's compensation over the current: units of the
    /// [modulator](svpwm::Modulator::compare) per 2⁻¹⁵ of the full scale.
    pub(crate) ramp: i32,
    /// Current from which on the dead time's compensation stays the same, in 2⁻¹⁵ of the full scale.
    pub(crate) dead_time_saturation: i32,
    /// Least speed at which the alignment is trimmed, in 2⁻³² electrical turns a step.
    pub(crate) trim_from: i32,
    /// Delay of the Halls' signals, in 2⁻⁸ steps.
    pub(crate) hall_delay: i16,
    /// What a current along q turns the Halls' angle by, in 2⁻³² turns per 2⁻¹⁵ of the full scale.
    pub(crate) hall_coil: i32,
    /// Gain of the alignment's trim: 2⁻⁵⁶ turns per unit of voltage along d, every 128
    /// steps.
    pub(crate) trim_gain: i32,
    pub(crate) guard: Guard,
    pub(crate) overload: Overload,
    pub(crate) supply: Supply,
    pub(crate) weakening: weakening::Gains,
    #[cfg(not(feature = "no-chopper"))]
    pub(crate) chopper: Chopper,
    pub(crate) arming: ArmingCheck,
    pub(crate) motion: Motion,
    pub(crate) scale: Scale,
    pub(crate) motor: Motor,
    /// Bandwidth of the current control in rad/s.
    pub(crate) current_rad_s: f32,
}

/// The settings that the control shares with the rest of a drive.
pub(crate) struct Frame {
    pub adc_bits: u8,
    pub pole_pairs: u8,
    pub pwm_hz: f32,
    pub period: u16,
    pub dead_time: u16,
    pub dead_time_s: f32,
    pub limits: pwm::Limits,
    pub max_electrical_hz: f32,
    pub tracking_hz: f32,
    pub reversed: bool,
}

/// Least bandwidth of the speed control.
pub(crate) const SLOWEST_SPEED_HZ: f32 = 0.5;

/// What the noise of the measured speed may add to it, electrical, before it is too fast.
pub(crate) const SPEED_NOISE_HZ: f32 = 10.0;

impl Config {
    /// Makes one of settings that are in their ranges, in its place: the compiler would gather the many numbers on the
    /// stack, to copy each from there, which is 600 bytes of flash.
    #[inline(never)]
    pub(crate) fn make(place: &mut Option<Self>, settings: &Control, frame: &Frame) -> Result<(), Error<'static>> {
        let Control { current_bandwidth_hz: current_hz, speed_bandwidth_hz: speed_hz, .. } = *settings;
        let Control { position_bandwidth_hz: position_hz, max_acceleration_rad_s2, .. } = *settings;
        let (amperes, volts) = (settings.current_full_scale_a, settings.bus_full_scale_v);
        let scale = Scale { step_hz: frame.pwm_hz, amperes, volts, pole_pairs: frame.pole_pairs.into() };
        let motor = Motor::of(settings);
        let ramp = settings.dead_time_ramp_a * scale.per_ampere();
        let max_current = settings.max_current_a * scale.per_ampere();
        let fastest_hz = frame.max_electrical_hz;
        let speed = settings.max_speed_rad_s * scale.per_radian_s();
        let loop_hz = scale.step_hz / OUTER as f32;
        let acceleration = max_acceleration_rad_s2 * scale.per_radian_s() / loop_hz;
        let gain = |field, gain: f32| Error::OutOfRange { field, value: gain, min: 0.0, max: 0.0 };
        let least_bus = settings.guard.under_voltage_v / volts;
        let longest = svpwm::Modulator::longest(frame.period, frame.dead_time, &frame.limits);
        let config = place.insert(Self {
            gains: current::Gains::new(&motor, current_hz, fastest_hz, &scale, least_bus, longest)
                .map_err(|max| Error::OutOfRange { field: "current_bandwidth_hz", value: current_hz, min: 0.0, max })?,
            local: LocalGains::new(&motor, settings.feedback, current_hz, &scale)
                .ok_or(gain("current_bandwidth_hz", current_hz))?,
            velocity: velocity::Gains::new(&motor, speed_hz, loop_hz, &scale)
                .map_err(|max| too_heavy(settings, max))?,
            position: position::Gain::new(position_hz, loop_hz).ok_or(gain("position_bandwidth_hz", position_hz))?,
            trajectory: trajectory::Limits::new((acceleration as i32).max(1), speed as i32)
                .ok_or(gain("max_acceleration_rad_s2", max_acceleration_rad_s2))?,
            full_braking: i32::MAX,
            deceleration: 1,
            max_speed_reference: (1.125 * speed) as i32,
            torque_ends: (1.1 * speed) as i32,
            torque_gain: (TURN * max_current / (0.6 * speed.max(1.0))) as i32,
            max_current: nearest(max_current),
            shift: 16 - frame.adc_bits,
            volts: (longest * 65_536.0 * 4_194_304.0 / svpwm::LONGEST as f32) as i32,
            modulator: svpwm::Modulator::new(frame.period, frame.dead_time, &frame.limits, longest, frame.reversed),
            ramp: (svpwm::RAMP as f32 / ramp.max(1.0)) as i32,
            dead_time_saturation: (RAMPS as f32 * ramp.max(1.0)) as i32,
            trim_from: trim_from(&motor, &scale),
            trim_gain: trim_gain(longest, &scale),
            hall_delay: nearest(settings.hall_delay_us * 256e-6 * scale.step_hz).clamp(-32_768, 32_767) as i16,
            hall_coil: nearest(settings.hall_coil_deg_a / scale.per_ampere() * (TURN / 360.0)),
            scale,
            motor,
            current_rad_s: TAU * current_hz,
            motion: Motion::default(),
            arming: ArmingCheck::default(),
            overload: Overload::default(),
            supply: Supply::default(),
            weakening: weakening::Gains::new(
                settings.field_weakening_a / amperes,
                settings.flux_linkage_wb / settings.inductance_h / amperes,
                motor.reluctance_per_a() * amperes,
                max_current,
            ),
            #[cfg(not(feature = "no-chopper"))]
            chopper: Chopper::NONE,
            guard: Guard::default(),
        });
        config.fade_torque(max_current, speed);
        config.motion.fill(settings, frame, &motor, &scale);
        config.arming = ArmingCheck::new(settings, frame, &scale);
        config.overload = Overload::new(settings, &scale);
        #[cfg(not(feature = "small"))]
        {
            config.overload.copper = Copper::new(settings, frame, &scale, config.overload.winding.fault as f32);
        }
        config.supply = Supply::new(settings, &motor, &scale);
        config.full_braking = Supply::full_braking(settings, &scale);
        config.deceleration = config.trajectory.deceleration(config.full_braking);
        #[cfg(not(feature = "no-chopper"))]
        {
            config.chopper = Chopper::new(settings, loop_hz, &scale);
        }
        config.guard = Guard::new(settings, frame.adc_bits, loop_hz, &scale, &motor);
        Ok(())
    }

    /// How a commanded torque ends about the largest speed.
    #[inline(always)]
    fn fade_torque(&mut self, max_current: f32, speed: f32) {
        // A much larger gain than the speed loop's, where the largest speed is small, would make a current of the speed's
        // noise.
        let own = self.velocity.proportional();
        self.torque_gain = self.torque_gain.min(own.saturating_mul(3)).max(own);
        // All torque at half the largest speed still, or what of it is left half way to where the speed is a fault.
        let fade = max_current * TURN / self.torque_gain as f32;
        let farthest = 1.15 * speed + SPEED_NOISE_HZ / 2.0 / self.scale.step_hz * TURN;
        self.torque_ends = self.torque_ends.max((0.5 * speed + fade).min(farthest) as i32);
    }
}

/// What is at fault where the gains of the speed control allow no more than this bandwidth: it, or an inertia with which even
/// the least one is too much.
#[inline(always)]
const fn too_heavy(settings: &Control, most_hz: f32) -> Error<'static> {
    let Control { speed_bandwidth_hz, inertia_kgm2, .. } = *settings;
    let (field, value, max) = if most_hz < SLOWEST_SPEED_HZ {
        ("inertia_kgm2", inertia_kgm2, 0.999 * inertia_kgm2 * most_hz / SLOWEST_SPEED_HZ)
    } else {
        ("speed_bandwidth_hz", speed_bandwidth_hz, most_hz)
    };
    Error::OutOfRange { field, value, min: 0.0, max }
}

/// Speed of a back-EMF of a fiftieth of the bus divider's full scale.
#[inline(always)]
fn trim_from(motor: &Motor, scale: &Scale) -> i32 {
    (scale.volts / 50.0 / motor.flux_linkage_wb / TAU / scale.step_hz * TURN).min(536_870_912.0) as i32
}

/// There, a time constant of half a second on a bus of the full scale: an electrical radian over that voltage and the
/// corrections of the time.
#[inline(always)]
fn trim_gain(longest: f32, scale: &Scale) -> i32 {
    let corrections = 0.5 * scale.step_hz / (2 * LONG) as f32;
    let gain = TURN / TAU / (svpwm::LONGEST as f32 / longest / 50.0) / corrections * 16_777_216.0;
    (gain as i32).max(1)
}

impl Motor {
    const fn of(settings: &Control) -> Self {
        Self {
            resistance_ohm: settings.resistance_ohm,
            inductance_h: settings.inductance_h,
            saliency: settings.saliency,
            flux_linkage_wb: settings.flux_linkage_wb,
            inertia_kgm2: settings.inertia_kgm2,
        }
    }
}

/// A command that is no number or beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BadDemand {
    /// What was asked for.
    pub value: f32,
    /// Largest magnitude allowed.
    pub most: f32,
}

impl fmt::Display for BadDemand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the command is {}, but must be a number from {} to {}", self.value, -self.most, self.most)
    }
}

impl core::error::Error for BadDemand {}

/// From this multiple of `dead_time_ramp_a` on, the dead time's compensation stays the same.
const RAMPS: i32 = 64;

impl Config {
    /// Takes over what follows from the bandwidths of the loops.
    pub(crate) const fn retune(&mut self, other: &Self) {
        (self.gains, self.local) = (other.gains, other.local);
        (self.velocity, self.position, self.current_rad_s) = (other.velocity, other.position, other.current_rad_s);
        self.torque_gain = other.torque_gain;
        self.motion.model.proportional = other.motion.model.proportional;
        (self.arming.averages, self.arming.lag) = (other.arming.averages, other.arming.lag);
        self.motion.reserve = other.motion.reserve;
    }

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
        demand(amperes, most)?;
        Ok(Current(clamp(nearest(amperes * self.scale.per_ampere()), self.max_current)))
    }

    /// Largest current, in amperes.
    pub fn largest_current_a(&self) -> f32 {
        self.max_current as f32 / self.scale.per_ampere()
    }

    /// Largest mechanical speed of a command, in rad/s.
    pub fn largest_speed_rad_s(&self) -> f32 {
        self.trajectory.speed() as f32 / self.scale.per_radian_s()
    }

    /// Delay of the Halls' signals, µs.
    pub(crate) fn hall_delay_us(&self) -> f32 {
        self.hall_delay as f32 / 256e-6 / self.scale.step_hz
    }

    /// Current below which the dead time acts in part only, in amperes.
    pub(crate) fn dead_time_ramp_a(&self) -> f32 {
        self.dead_time_saturation as f32 / RAMPS as f32 / self.scale.per_ampere()
    }

    /// Current, in 2⁻¹⁵ of the full scale, that changes the rotor's speed by 2⁻³² electrical turns a step in a step, by
    /// the inertia.
    pub(crate) fn current_per_speed_change(&self) -> f32 {
        let Self { scale, motor, .. } = self;
        let current_per_nm = scale.per_ampere() / motor.torque_constant(scale.pole_pairs);
        motor.inertia_kgm2 * current_per_nm / scale.per_radian_s() * scale.step_hz
    }

    /// The current of a torque in newton metres, by the flux linkage.
    ///
    /// # Errors
    /// Not a number, or beyond the torque of `max_current_a`.
    pub fn torque(&self, newton_metres: f32) -> Result<Current, BadDemand> {
        let constant = self.motor.torque_constant(self.scale.pole_pairs);
        let most = self.max_current as f32 / self.scale.per_ampere() * constant;
        demand(newton_metres, most)?;
        self.current(newton_metres / constant)
    }

    /// A mechanical speed in radians a second.
    ///
    /// # Errors
    /// Not a number, or beyond `max_speed_rad_s`.
    pub fn speed(&self, radians_s: f32) -> Result<Speed, BadDemand> {
        let most = self.trajectory.speed() as f32 / self.scale.per_radian_s();
        demand(radians_s, most)?;
        let most = self.trajectory.speed();
        Ok(Speed(clamp((radians_s * self.scale.per_radian_s()) as i32, most)))
    }

    /// A mechanical position in turns.
    ///
    /// # Errors
    /// Not a number, or beyond ± 2²⁹ electrical turns: a quarter of the way to either end of the range of a [`Position`].
    pub fn position(&self, turns: f64) -> Result<Position, BadDemand> {
        let most = (1 << 29) as f32 / self.scale.pole_pairs;
        let bad = BadDemand { value: double::narrow(turns), most };
        let mechanical = double::to_fixed(turns).ok_or(bad)?;
        demand(bad.value, most)?;
        Ok(Position::from_bits(mechanical * self.scale.whole_pole_pairs()))
    }
}

fn demand(value: f32, most: f32) -> Result<(), BadDemand> {
    // The limit itself has been rounded.
    if value.abs() <= most * 1.000_1 { Ok(()) } else { Err(BadDemand { value, most }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::settings::Settings;

    #[test]
    fn commands_that_are_no_number_or_too_large_are_refused() {
        let config =
            Settings { control: Some(Control::default()), ..Settings::default() }.validate().unwrap().control.unwrap();
        for bad in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e9, -1e9] {
            assert!(config.current(bad).is_err() && config.speed(bad).is_err() && config.torque(bad).is_err());
            assert!(config.position(f64::from(bad)).is_err());
        }
        assert_eq!(config.current(3.0).unwrap().0, config.max_current);
        assert_eq!(config.torque(0.09).unwrap().0, config.max_current);
        assert!(config.current(3.01).is_err());
        assert_eq!(config.position(1.25).unwrap().to_bits(), 5 << 32);
        // 100 rad/s are 63.66 Hz electrical.
        let hz = f64::from(config.speed(100.0).unwrap().0) * 40e3 / f64::from(TURN);
        assert!((hz - 63.662).abs() < 1e-3, "{hz}");
    }
}
