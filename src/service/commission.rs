//! The order in which a motor of which nothing is known is commissioned, for a drive with current sensing.
//!
//! R and L at standstill; the calibration by a current that fits the motor, at a speed that the rotor follows; flux
//! linkage and inertia roughly; then by the whole identification. After each step, the settings that follow from it.
//!
//! It is a sequence of decisions only: who owns it does what [`Commission::action`] says with the settings of
//! [`Commission::settings`], and hands over the result. So a tool can do it over a line, and the chip need not.

use super::identify::Report;
use super::standstill::Electrical;
use super::swings::Rough;
use crate::control::config::SLOWEST_SPEED_HZ;
use crate::fault::Fault;
use crate::hall::calibrate::{self, report::Report as Sensors};
use crate::settings::{Control, Error, Settings};
use core::f32::consts::TAU;

/// What is to be done next, with the settings as they are by then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Measure R and L: [`Standstill`](super::standstill::Standstill).
    Measure,
    /// Calibrate the sensors.
    Calibrate,
    /// Measure flux linkage and inertia roughly: [`Swings`](super::swings::Swings).
    Swing,
    /// Measure the motor: [`Identification`](super::identification::Identification).
    Identify,
    /// Nothing is left; the settings are to be kept.
    Done,
}

impl Action {
    /// Whether it is worth to be done once more, [more gently](Commission::be_gentle), after this fault: a load that swings on its
    /// shaft, or a speed that uneven magnets make swing, comes to nothing like this where the speed control answers it.
    pub const fn may_be_gentler(self, fault: Fault) -> bool {
        let swung = matches!(
            fault,
            Fault::OverVoltage | Fault::OverSpeed | Fault::FollowingError | Fault::Commutation | Fault::OverCurrent
        );
        swung && matches!(self, Self::Identify)
    }
}

/// So often the measurement of the motor is tried more gently.
pub const GENTLER: u32 = 2;

/// Faults that pass by waiting with the bridge off; and so long a wait, in ms, so often at most.
pub const HOT: [Fault; 2] = [Fault::WindingHot, Fault::BridgeOverload];
/// See [`HOT`].
pub const COOLING_MS: u32 = 20_000;
/// See [`HOT`].
pub const COOLINGS: u32 = 15;

/// A way to calibrate.
struct Sweep {
    /// Speed of the field, electrical.
    speed_hz: f32,
    /// Its current, as a share of the largest.
    share: f32,
    /// Time to raise it. A heavy rotor swings about a field that rises fast, and hardly stops.
    align_s: f32,
}

/// In the order in which they are tried. The last one takes a minute, and is for a rotor that has followed none of the others.
const SWEEPS: [Sweep; 5] = [
    Sweep { speed_hz: 10.0, share: 0.33, align_s: 0.3 },
    Sweep { speed_hz: 4.0, share: 0.45, align_s: 6.0 },
    Sweep { speed_hz: 20.0, share: 0.45, align_s: 1.0 },
    Sweep { speed_hz: 2.0, share: 0.45, align_s: 6.0 },
    Sweep { speed_hz: 0.5, share: 0.6, align_s: 10.0 },
];
/// Lag and swing of the rotor in degrees up to which another one is not tried, and the share of the signals in per cent
/// that no turning magnet explains: cheap magnets leave up to 2.8 %, but a rotor that swings in another rhythm than the
/// field turns is smeared over the sums, and leaves more.
const GOOD_LAG: f32 = 40.0;
const GOOD_SWING: f32 = 4.5;
const GOOD_RESIDUAL: f32 = 2.9;
/// Share of the largest current that the noise of the speed may make.
const NOISE: f32 = 0.03;
/// Least bandwidth of the speed control that is chosen for the sake of the noise, and of the tracker.
const QUIETEST_HZ: f32 = 0.6;
const SLOWEST_TRACKER_HZ: f32 = 40.0;

/// Share by which an inertia may be off that is better than the one by [`Swings`](super::swings::Swings).
const ROUGHLY: f32 = 0.4;

/// A motor on its way.
#[derive(Clone, Debug)]
pub struct Commission {
    settings: Settings,
    action: Action,
    electrical: Option<Electrical>,
    /// How often the calibration has been tried, and the best so far: its number in [`SWEEPS`], and how bad it was.
    tries: usize,
    best: Option<(usize, f32)>,
    /// Noise of the angle, electrical radians.
    noise: f32,
}

impl Commission {
    /// From the drive's settings; `max_current_a` takes the place of theirs, and the over-current and the continuous
    /// current follow it.
    ///
    /// # Errors
    /// [`Error::NoControl`], or a current out of its range.
    pub fn new(mut settings: Settings, max_current_a: Option<f32>) -> Result<Self, Error<'static>> {
        let control = settings.control.as_mut().ok_or(Error::NoControl)?;
        if let Some(limit_a) = max_current_a {
            control.max_current_a = limit_a;
            control.continuous_current_a = 0.5 * limit_a;
            control.calibration_current_a = 0.0;
            control.guard.over_current_a = (1.5 * limit_a).min(0.98 * control.current_full_scale_a);
        }
        settings.check()?;
        Ok(Self { settings, action: Action::Measure, electrical: None, tries: 0, best: None, noise: 0.01 })
    }

    /// What is to be done.
    pub const fn action(&self) -> Action {
        self.action
    }

    /// The settings for it.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// R and L are known.
    ///
    /// # Errors
    /// The settings have no room for the motor.
    pub fn measured(&mut self, found: &Electrical) -> Result<(), Error<'static>> {
        self.electrical = Some(*found);
        let dead_time_s = self.settings.dead_time_s;
        let pairs = f32::from(self.settings.pole_pairs);
        let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
        set_electrical(control, found);
        // No current along d has a share in the torque until the flux linkage is known.
        control.saliency = 1.0;
        // Where a current dies within the dead time: at two thirds of the bus across the inductance.
        control.dead_time_ramp_a =
            (dead_time_s * found.bus_v / 1.5 / control.inductance_h).clamp(1e-3, 0.1 * control.current_full_scale_a);
        // Nothing is fed forward that is not known, and there is no speed loop yet to speak of.
        control.flux_linkage_wb = 1e-5;
        control.inertia_kgm2 = 1e-4 * 1.5 * pairs * control.flux_linkage_wb;
        let noise_a = control.current_full_scale_a / 1000.0;
        let largest_h = control.inductance_h * found.known_saliency().max(1.0);
        let bandwidth_hz = (0.02 * found.bus_v / (TAU * largest_h * noise_a)).min(1000.0);
        self.action = Action::Calibrate;
        self.choose_sweep(0);
        self.set_bandwidths(bandwidth_hz, 20.0)
    }

    fn choose_sweep(&mut self, number: usize) {
        if let (Some(sweep), Some(control)) = (SWEEPS.get(number), &mut self.settings.control) {
            self.settings.calibration_hz = sweep.speed_hz;
            self.settings.calibration_align_s = sweep.align_s;
            control.calibration_current_a = sweep.share * control.max_current_a;
        }
    }

    /// How many there are to try, as far as it is known.
    fn sweeps(&self) -> usize {
        let followed = self.best.is_some_and(|(number, _)| number < SWEEPS.len() - 1);
        SWEEPS.len() - usize::from(followed)
    }

    /// The calibration has ended.
    ///
    /// # Errors
    /// It has failed at every speed, last by this.
    pub fn calibrated(&mut self, result: Result<&Sensors, calibrate::Error>) -> Result<(), calibrate::Error> {
        let number = self.tries;
        self.tries += 1;
        if let Ok(report) = result {
            self.noise = report.angle_noise_deg.to_radians();
            let (lag, swing) = (report.lag.to_degrees().abs(), report.hunting_deg);
            let residual = report.residual_pct;
            let bad = swing / GOOD_SWING + lag / GOOD_LAG + residual / GOOD_RESIDUAL;
            let good = swing <= GOOD_SWING && lag <= GOOD_LAG && residual <= GOOD_RESIDUAL;
            // After all were tried, this was the best one again.
            if good || number >= self.sweeps() {
                self.action = Action::Swing;
                return Ok(());
            }
            if self.best.is_none_or(|(_, least)| bad < least) {
                self.best = Some((number, bad));
            }
        }
        // Nothing ends the search early: of two Halls, one may look dead twice where a heavy rotor only rocks.
        match (self.best, result) {
            _ if self.tries < self.sweeps() => self.choose_sweep(self.tries),
            // The last one was the best: its calibration is in use.
            (Some((best, _)), Ok(_)) if best == number => self.action = Action::Swing,
            (Some((best, _)), _) if self.tries == self.sweeps() => self.choose_sweep(best),
            (_, Err(error)) => return Err(error),
            (_, Ok(_)) => self.action = Action::Swing,
        }
        Ok(())
    }

    /// Flux linkage and inertia are roughly known.
    ///
    /// # Errors
    /// The settings have no room for the motor.
    pub fn swung(&mut self, found: &Rough) -> Result<(), Error<'static>> {
        let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
        control.flux_linkage_wb = found.flux_linkage_wb;
        control.inertia_kgm2 = found.inertia_kgm2;
        self.action = Action::Identify;
        self.set_motion()
    }

    /// The motor is known.
    ///
    /// # Errors
    /// The settings have no room for the motor.
    pub fn identified(&mut self, found: &Report) -> Result<(), Error<'static>> {
        let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
        found.apply(control);
        let inertia = found.inertia_kgm2;
        if inertia.error < ROUGHLY * inertia.value {
            control.inertia_kgm2 = inertia.value;
        }
        self.unidentified()
    }

    /// The measurements of the identification do not determine the motor, as where a load on a shaft that twists lets the
    /// rotor leap from speed to speed: flux linkage and inertia stay as roughly known as they are.
    ///
    /// # Errors
    /// The settings have no room for the motor.
    pub fn unidentified(&mut self) -> Result<(), Error<'static>> {
        let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
        // At standstill what the dead time leaves cancels.
        if let Some(electrical) = &self.electrical {
            set_electrical(control, electrical);
            control.saliency = electrical.known_saliency();
        }
        self.action = Action::Done;
        self.set_motion()
    }

    /// Speed, acceleration and bandwidths that fit flux linkage and inertia.
    fn set_motion(&mut self) -> Result<(), Error<'static>> {
        let Settings { pole_pairs, max_electrical_hz, pwm_hz, .. } = self.settings;
        let pairs = f32::from(pole_pairs);
        let noise = self.noise;
        let bus_v = self.electrical.map_or(12.0, |found| found.bus_v);
        let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
        let Control { flux_linkage_wb, inertia_kgm2, max_current_a, current_bandwidth_hz, .. } = *control;
        let constant = 1.5 * pairs * flux_linkage_wb;
        let reached = 0.85 * bus_v / 1.732 / (flux_linkage_wb * pairs);
        let allowed = 0.9 * TAU * max_electrical_hz / pairs;
        control.max_speed_rad_s = control.max_speed_rad_s.min(reached).min(allowed).max(0.2);
        let most = 0.35 * max_current_a * constant / inertia_kgm2;
        control.max_acceleration_rad_s2 = most.min(10.0 * control.max_speed_rad_s).clamp(0.01, 1e6);
        // A slow motor that is dragged the wrong way would never be so far from its speed as a fast one.
        let far_rad_s = (0.5 * control.max_speed_rad_s).max(1.0);
        control.following_error_rad_s = control.following_error_rad_s.min(far_rad_s);
        // A supply that takes little back makes braking slower.
        let stop_s = 2.0 * control.max_speed_rad_s / control.max_acceleration_rad_s2;
        control.guard.stop_s = control.guard.stop_s.max(stop_s).min(60.0);
        // The tracker's speed is noisy by about this, and the speed loop makes a current of it.
        let quiet_hz = |tracking_hz: f32| {
            let tracker = TAU * tracking_hz;
            let noise_rad_s = noise * tracker * crate::float::root(tracker / pwm_hz / 2.8) / pairs;
            NOISE * max_current_a * constant / (inertia_kgm2 * noise_rad_s.max(1e-6)) / TAU
        };
        // A heavy rotor changes its speed slowly, and a slower tracker is less noisy.
        let tracking_hz = &mut self.settings.tracking_bandwidth_hz;
        while quiet_hz(*tracking_hz) < QUIETEST_HZ && *tracking_hz > SLOWEST_TRACKER_HZ {
            *tracking_hz *= 0.8;
        }
        let speed_hz = quiet_hz(*tracking_hz).clamp(QUIETEST_HZ, 60.0);
        self.set_bandwidths(current_bandwidth_hz, speed_hz)
    }

    /// A third of the acceleration, which is a third of the current that the next step begins with, and a speed and position
    /// control that is four times slower: a load on a soft shaft swings less. What that step finds sets all of them anew.
    ///
    /// # Errors
    /// [`Error::NoControl`], or the settings are contradictory.
    pub fn be_gentle(&mut self) -> Result<(), Error<'static>> {
        let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
        control.max_acceleration_rad_s2 = (control.max_acceleration_rad_s2 / 3.0).max(0.01);
        let Control { current_bandwidth_hz, speed_bandwidth_hz, .. } = *control;
        self.set_bandwidths(current_bandwidth_hz, speed_bandwidth_hz / 4.0)
    }

    /// Sets bandwidths, or what the integers of the control have room for.
    fn set_bandwidths(&mut self, mut current_hz: f32, mut speed_hz: f32) -> Result<(), Error<'static>> {
        for _ in 0..24 {
            current_hz = current_hz.clamp(10.0, self.settings.pwm_hz / 20.0);
            speed_hz = speed_hz.clamp(SLOWEST_SPEED_HZ, current_hz / 5.0);
            let control = self.settings.control.as_mut().ok_or(Error::NoControl)?;
            control.current_bandwidth_hz = current_hz;
            control.speed_bandwidth_hz = speed_hz;
            control.position_bandwidth_hz = speed_hz / 4.0;
            match self.settings.validate() {
                Err(Error::OutOfRange { field: "current_bandwidth_hz", max, .. }) if current_hz > 10.0 => {
                    current_hz = if max > 0.0 { 0.9 * max.min(current_hz) } else { 0.5 * current_hz };
                }
                Err(Error::OutOfRange { field: "speed_bandwidth_hz", .. }) if speed_hz > SLOWEST_SPEED_HZ => {
                    speed_hz *= 0.7
                }
                result => return result.map(|_| ()),
            }
        }
        self.settings.validate().map(|_| ())
    }
}

fn set_electrical(control: &mut Control, found: &Electrical) {
    control.resistance_ohm = found.resistance_ohm.value;
    control.inductance_h = found.inductance_h.value;
}
