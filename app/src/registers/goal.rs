//! What a client wants the drive to do, and the command that does it.

use crate::encoder::Encoder;
use crate::tasks::Tasks;
use core::f32::consts::TAU;
use embedded_storage::nor_flash::NorFlash;
use hallservo::control::Current;
use hallservo::control::impedance::{LONGEST_S, Motion, Request};
use hallservo::double;
use hallservo_registers::axis::{self, Position, Refused};

/// A command that moves.
#[derive(Clone, Copy, Debug)]
pub(super) enum Goal {
    /// A current along q, A.
    Current(f32),
    /// To a position, or along a velocity.
    Position(Position),
    /// To rest.
    ZeroVelocity(Position),
    /// Free between two positions.
    StayWithin([f32; 2], Position),
    /// The windings shorted.
    Brake,
}

/// A command, and where the client's position was zero when it came, in 2⁻³² turns of the drive: setting the output to
/// another position afterwards moves nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wish {
    pub goal: Goal,
    pub zero: i64,
}

impl Wish {
    /// Whether it is the same in every bit.
    pub fn is_same(&self, other: &Self) -> bool {
        self.zero == other.zero && self.goal.is_same(&other.goal)
    }
}

/// What the drive is told.
pub(super) enum Order {
    /// A current.
    Current(Current),
    /// A spring and a damper.
    Impedance(Request),
    /// No voltage between the windings.
    Short,
}

impl Goal {
    /// Of a command that is one.
    pub fn of(command: &axis::Command) -> Result<Self, Refused> {
        match *command {
            // There is no current along d to be commanded.
            axis::Command::Current { d: 0.0, q, .. } => Ok(Self::Current(q)),
            axis::Command::Position(position) => Ok(Self::Position(position)),
            axis::Command::ZeroVelocity(with) => Ok(Self::ZeroVelocity(with)),
            axis::Command::StayWithin { lower, upper, with } => Ok(Self::StayWithin([lower, upper], with)),
            axis::Command::Brake => Ok(Self::Brake),
            axis::Command::Current { .. } | axis::Command::Stop => Err(Refused),
        }
    }

    /// The mode that it is.
    pub const fn mode(&self) -> axis::Mode {
        match self {
            Self::Current(_) => axis::Mode::Current,
            Self::Position(_) => axis::Mode::Position,
            Self::ZeroVelocity(_) => axis::Mode::ZeroVelocity,
            Self::StayWithin(..) => axis::Mode::StayWithin,
            Self::Brake => axis::Mode::Brake,
        }
    }

    /// Whether it is the same in every bit.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Current(a), Self::Current(b)) => a.to_bits() == b.to_bits(),
            (Self::Position(a), Self::Position(b)) | (Self::ZeroVelocity(a), Self::ZeroVelocity(b)) => a.is_same(b),
            (Self::StayWithin(bounds, a), Self::StayWithin(others, b)) => {
                bounds.map(f32::to_bits) == others.map(f32::to_bits) && a.is_same(b)
            }
            (Self::Brake, Self::Brake) => true,
            _ => false,
        }
    }

    /// The spring and the damper that it is.
    pub const fn spring(&self) -> Option<&Position> {
        match self {
            Self::Current(_) | Self::Brake => None,
            Self::Position(with) | Self::ZeroVelocity(with) | Self::StayWithin(_, with) => Some(with),
        }
    }

    /// The same from another position at once, and with what speed; what is commanded follows after that.
    pub fn from(&self, position: f32) -> Option<Self> {
        let Self::Position(goal) = *self else { return None };
        let velocity = if goal.position.is_nan() { goal.velocity } else { 0.0 };
        let now = Position { position, velocity, velocity_limit: -1.0, acceleration_limit: -1.0, ..goal };
        Some(Self::Position(now))
    }

    /// What follows after [`Self::from`], if anything does: the way to a position.
    pub const fn moves_on(&self) -> Option<Self> {
        match self {
            Self::Position(goal) if !goal.position.is_nan() && goal.velocity == 0.0 => Some(*self),
            _ => None,
        }
    }

    /// What the drive is told. `zero` is where the client's position is zero, in 2⁻³² turns of the drive.
    pub fn order<F: NorFlash, E: Encoder>(&self, tasks: &Tasks<F, E>, zero: i64) -> Result<Order, Refused> {
        let config = tasks.service.config();
        if let Self::Current(amperes) = self {
            let control = config.control.as_ref().ok_or(Refused)?;
            return control.current(*amperes).map(Order::Current).map_err(|_| Refused);
        }
        if let Self::Brake = self {
            return if tasks.may_short() { Ok(Order::Short) } else { Err(Refused) };
        }
        let fastest = tasks.settings.control.as_ref().ok_or(Refused)?.max_speed_rad_s;
        let request = self.request(zero, fastest)?;
        // What cannot be is refused at once.
        config.impedance(&request).map_err(|_| Refused)?;
        Ok(Order::Impedance(request))
    }

    #[inline(never)]
    fn request(&self, zero: i64, fastest_rad_s: f32) -> Result<Request, Refused> {
        let with = self.spring().ok_or(Refused)?;
        let place = |revolutions: f32| match some(revolutions) {
            None => Ok(None),
            Some(value) => {
                fixed(value).map(|turns| Some(double::from_fixed(turns.saturating_add(zero)))).ok_or(Refused)
            }
        };
        let motion = match self {
            Self::Current(_) | Self::Brake => return Err(Refused),
            Self::ZeroVelocity(_) => Motion::HERE,
            Self::StayWithin([lower, upper], _) => {
                Motion::Within { least_turns: place(*lower)?, most_turns: place(*upper)? }
            }
            Self::Position(Position { position, velocity, stop_position, .. }) => {
                let moves = *velocity != 0.0;
                // A position that moves on is one to be at now.
                let at_once = moves && !position.is_nan();
                Motion::To {
                    position_turns: place(*position)?,
                    speed_rad_s: TAU * velocity,
                    stop_turns: if moves { place(*stop_position)? } else { None },
                    max_speed_rad_s: limit(with.velocity_limit, at_once).map(|limit| clamped(limit, fastest_rad_s)),
                    max_acceleration_rad_s2: limit(with.acceleration_limit, at_once),
                }
            }
        };
        Ok(Request {
            kp_nm_rad: None,
            kd_nms_rad: None,
            kp_scale: if let Self::ZeroVelocity(_) = self { 0.0 } else { with.kp_scale },
            kd_scale: with.kd_scale,
            feed_forward_nm: with.torque,
            max_torque_nm: some(with.max_torque),
            motion,
            timeout_s: match with.timeout {
                0.0 => None,
                // No motor turns on for ever when its client has died.
                seconds => Some(seconds.min(LONGEST_S)),
            },
        })
    }
}

fn some(value: f32) -> Option<f32> {
    (!value.is_nan()).then_some(value)
}

/// A limit per second as one of radians: none where there is to be none, that of the settings where nothing is said.
fn limit(revolutions: f32, none: bool) -> Option<f32> {
    if none || revolutions < 0.0 { Some(f32::INFINITY) } else { some(TAU * revolutions) }
}

/// No limit, or one within that of the settings.
fn clamped(limit: f32, most: f32) -> f32 {
    if limit.is_infinite() { limit } else { limit.min(most) }
}

/// Turns in 2⁻³².
#[inline(never)]
pub(super) fn fixed(turns: f32) -> Option<i64> {
    // Within what every drive can count.
    (turns.abs() < 16_777_216.0).then_some((turns * 4_294_967_296.0) as i64)
}

/// The inverse.
pub(super) fn turns(fixed: i64) -> f32 {
    fixed as f32 / 4_294_967_296.0
}
