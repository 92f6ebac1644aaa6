//! What is asked for, in SI, and how it becomes what the interrupt works with.

use super::gains::Loop;
use super::motion::{Course, Start, Travel};
use super::{Error, Field, Gains, Impedance, Spring};
use crate::config::Config;
use crate::control::config::Config as Control;
use crate::control::trajectory::Limits;
use crate::schedule::{OUTER, coarse};

/// A spring and a damper at the shaft. The default takes all that it can from the settings, and stays where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Request {
    /// kp, N·m/rad: 0 to that of [`Config::largest_impedance`]; `None`: that of [`Config::default_impedance`].
    pub kp_nm_rad: Option<f32>,
    /// kd, N·m·s/rad: 0 to that of [`Config::largest_impedance`]; `None`: that of [`Config::default_impedance`].
    pub kd_nms_rad: Option<f32>,
    /// What kp is multiplied by, 0 to 1. The limits are for the product.
    pub kp_scale: f32,
    /// What kd is multiplied by, 0 to 1. The limits are for the product.
    pub kd_scale: f32,
    /// Feed-forward torque, N·m; at most that of `max_current_a`.
    pub feed_forward_nm: f32,
    /// Largest torque, N·m: not negative; `None`, or what is beyond it: that of `max_current_a`.
    pub max_torque_nm: Option<f32>,
    /// What the reference does.
    pub motion: Motion,
    /// How long the command holds, s: 0.001 to [`LONGEST_S`]; `None`: `command_timeout_s`.
    pub timeout_s: Option<f32>,
}

/// Longest time for which a command may hold, s: that of the setting `command_timeout_s`, for a motor does not turn on
/// for ever when whoever commanded it has died.
pub const LONGEST_S: f32 = 60.0;

/// What the reference does. Positions are mechanical turns, up to an eighth of the range of a
/// [`Position`](crate::angle::Position) and within `min_position_turns` to `max_position_turns`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Motion {
    /// The spring acts everywhere, towards a reference that moves.
    To {
        /// Where the reference is to be; `None`: it goes on from where it is, after another mode from the rotor.
        position_turns: Option<f64>,
        /// With what speed it moves on from there, rad/s; up to ± `max_speed_rad_s`. With a position and limits: 0.
        speed_rad_s: f32,
        /// Where it comes to rest, and so in which direction it moves; `None`: at the bound of the position. With a position
        /// and limits: none.
        stop_turns: Option<f64>,
        /// Largest speed on the way to the position, rad/s: above 0, up to `max_speed_rad_s`; `None`: that; infinite:
        /// none.
        max_speed_rad_s: Option<f32>,
        /// Largest acceleration of the reference, rad/s²: above 0; `None`: `max_acceleration_rad_s2`; infinite: none.
        /// Without either limit the reference is there at once, which must not be farther from the rotor than
        /// `following_error_turns`.
        max_acceleration_rad_s2: Option<f32>,
    },
    /// Spring and damper act outside of a range only, towards its nearer end; inside, nothing but the feed-forward torque.
    /// With both ends it is shorter than 256 electrical turns. The rotor must not be farther outside than
    /// `following_error_turns`.
    Within {
        /// Least position; `None`: none.
        least_turns: Option<f64>,
        /// Largest position; `None`: none.
        most_turns: Option<f64>,
    },
}

impl Default for Request {
    fn default() -> Self {
        Self {
            kp_nm_rad: None,
            kd_nms_rad: None,
            kp_scale: 1.0,
            kd_scale: 1.0,
            feed_forward_nm: 0.0,
            max_torque_nm: None,
            motion: Motion::HERE,
            timeout_s: None,
        }
    }
}

impl Motion {
    /// The reference stays where it is.
    pub const HERE: Self = Self::To {
        position_turns: None,
        speed_rad_s: 0.0,
        stop_turns: None,
        max_speed_rad_s: None,
        max_acceleration_rad_s2: None,
    };

    /// To a position, as the settings limit speed and acceleration.
    pub const fn to(position_turns: f64) -> Self {
        Self::To {
            position_turns: Some(position_turns),
            speed_rad_s: 0.0,
            stop_turns: None,
            max_speed_rad_s: None,
            max_acceleration_rad_s2: None,
        }
    }
}

impl Config {
    /// A spring and a damper for the interrupt: what [`Command::Impedance`](crate::drive::Command::Impedance) carries.
    /// Positions are the drive's, which [`Impedance::shift`] changes.
    ///
    /// # Errors
    /// [`Error`] tells what cannot be, and what can.
    pub fn impedance(&self, request: &Request) -> Result<Impedance, Error> {
        let control = self.control.as_ref().ok_or(Error::NoControl)?;
        let spring = self.spring(control, request)?;
        let forward =
            range(Field::FeedForward, request.feed_forward_nm, -control.largest_torque(), control.largest_torque())?;
        let most = match request.max_torque_nm {
            Some(most) => range(Field::MaxTorque, most, 0.0, f32::MAX)?.min(control.largest_torque()),
            None => control.largest_torque(),
        };
        let current = |torque: f32| control.torque(torque).map_or(0, |current| current.0);
        Ok(Impedance {
            spring,
            forward: current(forward),
            most: current(most),
            course: control.course(&request.motion)?,
            timeout: control.timeout(request.timeout_s)?,
        })
    }

    fn spring(&self, control: &Control, request: &Request) -> Result<Spring, Error> {
        let lags = Loop::new(control, &self.tracking);
        let preset = lags.usual(control);
        let scaled = |field, gain: f32, scale: f32| {
            range(Field::Scale, scale, 0.0, 1.0)?;
            range(field, gain, 0.0, f32::MAX).map(|gain| gain * scale)
        };
        let kp = scaled(Field::Kp, request.kp_nm_rad.unwrap_or(preset.kp_nm_rad), request.kp_scale)?;
        let kd = scaled(Field::Kd, request.kd_nms_rad.unwrap_or(preset.kd_nms_rad), request.kd_scale)?;
        let most = lags.largest();
        range(Field::Kp, kp, 0.0, most.kp_nm_rad)?;
        range(Field::Kd, kd, 0.0, most.kd_nms_rad)?;
        Ok(Spring::new(&Gains { kp_nm_rad: kp, kd_nms_rad: kd }, &lags, control))
    }

    /// Stiffness and damping that a request without them has: what the position and speed loops make of
    /// `position_bandwidth_hz`, `speed_bandwidth_hz` and `inertia_kgm2`, at most the largest. `None` without current
    /// control.
    pub fn default_impedance(&self) -> Option<Gains> {
        let control = self.control.as_ref()?;
        Some(Loop::new(control, &self.tracking).usual(control))
    }

    /// The largest stiffness and damping that are taken: [`Gains`] says by what. `None` without current control.
    pub fn largest_impedance(&self) -> Option<Gains> {
        let control = self.control.as_ref()?;
        Some(Loop::new(control, &self.tracking).largest())
    }
}

impl Impedance {
    /// Counts the positions from where the user's zero is.
    pub fn shift(&mut self, origin: crate::angle::Position) {
        self.course.shift(origin);
    }
}

/// A number within its range; not a number is never.
#[inline(never)]
fn range(field: Field, value: f32, least: f32, most: f32) -> Result<f32, Error> {
    // A limit may have been rounded on its way.
    let room = |limit: f32| 1e-4 * limit.abs().min(1e30);
    if value >= least - room(least) && value <= most + room(most) {
        Ok(value.max(least).min(most))
    } else {
        Err(Error::OutOfRange { field, value, least, most })
    }
}

impl Control {
    /// Torque of the largest current, N·m.
    fn largest_torque(&self) -> f32 {
        self.max_current as f32 / self.scale.per_ampere() * self.motor.torque_constant(self.scale.pole_pairs)
    }

    fn timeout(&self, seconds: Option<f32>) -> Result<u32, Error> {
        Ok(match seconds {
            None => self.guard.timeout,
            Some(seconds) => {
                let seconds = range(Field::Timeout, seconds, 1e-3, LONGEST_S)?;
                crate::float::ceil(seconds * self.scale.step_hz / OUTER as f32) as u32
            }
        })
    }

    fn course(&self, motion: &Motion) -> Result<Course, Error> {
        match *motion {
            Motion::Within { least_turns, most_turns } => {
                let free = i32::MAX;
                let (end, dead) = match (self.place(least_turns)?, self.place(most_turns)?) {
                    (None, None) => (None, [-free, free]),
                    (Some(least), None) => (Some(least), [-free, 0]),
                    (None, Some(most)) => (Some(most), [0, free]),
                    (Some(least), Some(most)) if least <= most => match Spring::strain(most - least) {
                        i32::MAX => return Err(Error::Crossed),
                        wide => (Some(least), [-wide, 0]),
                    },
                    _ => return Err(Error::Crossed),
                };
                Ok(Course::Within { end, dead })
            }
            Motion::To { position_turns, speed_rad_s, stop_turns, max_speed_rad_s, max_acceleration_rad_s2 } => {
                let speed = self.speed(speed_rad_s).map_err(|bad| Error::OutOfRange {
                    field: Field::Speed,
                    value: bad.value,
                    least: -bad.most,
                    most: bad.most,
                })?;
                let at = self.place(position_turns)?;
                let stop = self.place(stop_turns)?;
                let fastest = self.fastest(max_speed_rad_s)?;
                let acceleration = self.acceleration(max_acceleration_rad_s2)?;
                let speed = speed.0;
                let limits = |most: i32| Limits::up_to(acceleration.unwrap_or(Limits::MOST), most);
                let travel =
                    Travel { speed, stop, limits: limits(if speed == 0 { Limits::MOST } else { speed.abs() }) };
                if fastest.is_none() && acceleration.is_none() {
                    return Ok(Course::Travel { from: at.map_or(Start::AtSpeed, Start::At), travel });
                }
                match at {
                    None => Ok(Course::Travel { from: Start::Smoothly, travel }),
                    Some(_) if speed != 0 || stop.is_some() => Err(Error::Moving),
                    Some(target) => {
                        let fastest = fastest.unwrap_or(self.trajectory.speed());
                        Ok(Course::Approach { target, limits: limits(fastest) })
                    }
                }
            }
        }
    }

    /// The position, if there is one.
    #[inline(never)]
    fn place(&self, turns: Option<f64>) -> Result<Option<i64>, Error> {
        let Some(turns) = turns else { return Ok(None) };
        let position = self.position(turns).map_err(|bad| Error::OutOfRange {
            field: Field::Position,
            value: bad.value,
            least: -bad.most,
            most: bad.most,
        })?;
        Ok(Some(coarse(position).to_bits()))
    }

    /// Largest speed of the reference; `None` for no limit.
    fn fastest(&self, asked: Option<f32>) -> Result<Option<i32>, Error> {
        let most = self.trajectory.speed();
        Ok(match asked {
            None => Some(most),
            Some(f32::INFINITY) => None,
            Some(speed) => {
                let largest = most as f32 / self.scale.per_radian_s();
                let speed = range(Field::MaxSpeed, speed, 1.0 / self.scale.per_radian_s(), largest)?;
                Some(((speed * self.scale.per_radian_s()) as i32).max(1).min(most))
            }
        })
    }

    /// Largest acceleration of the reference; `None` for no limit.
    fn acceleration(&self, asked: Option<f32>) -> Result<Option<i32>, Error> {
        Ok(match asked {
            None => Some(self.trajectory.acceleration()),
            Some(f32::INFINITY) => None,
            Some(acceleration) => {
                let unit = self.scale.per_radian_s() / self.scale.step_hz * OUTER as f32;
                let acceleration = range(Field::MaxAcceleration, acceleration, 1.0 / unit, 1e6)?;
                Some(((acceleration * unit) as i32).max(1))
            }
        })
    }
}
