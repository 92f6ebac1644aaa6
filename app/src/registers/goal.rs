//! What a client wants the drive to do, and the command that does it.

use crate::encoder::Encoder;
use crate::tasks::Tasks;
use core::f32::consts::TAU;
use embedded_storage::nor_flash::NorFlash;
use hallservo::angle::Position as Electrical;
use hallservo::drive::Command;
use hallservo_registers::axis::{self, Position, Refused};

/// A command that moves.
#[derive(Clone, Copy, Debug)]
pub(super) enum Goal {
    /// A current along q, A.
    Current(f32),
    /// To a position, along a velocity, or to rest.
    Position(Position),
    /// To rest.
    ZeroVelocity(Position),
}

impl Goal {
    /// Of a command that is one.
    pub fn of(command: &axis::Command) -> Result<Self, Refused> {
        match *command {
            // There is no current along d to be commanded.
            axis::Command::Current { d: 0.0, q, .. } => Ok(Self::Current(q)),
            axis::Command::Position(position) => Ok(Self::Position(position)),
            axis::Command::ZeroVelocity(with) => Ok(Self::ZeroVelocity(with)),
            _ => Err(Refused),
        }
    }

    /// The mode that it is.
    pub const fn mode(&self) -> axis::Mode {
        match self {
            Self::Current(_) => axis::Mode::Current,
            Self::Position(_) => axis::Mode::Position,
            Self::ZeroVelocity(_) => axis::Mode::ZeroVelocity,
        }
    }

    /// Whether it is the same in every bit.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Current(a), Self::Current(b)) => a.to_bits() == b.to_bits(),
            (Self::Position(a), Self::Position(b)) | (Self::ZeroVelocity(a), Self::ZeroVelocity(b)) => a.is_same(b),
            _ => false,
        }
    }

    /// The command of the drive. `zero` is where the client's position is zero, in 2⁻³² turns of the drive.
    pub fn command<F: NorFlash, E: Encoder>(&self, tasks: &Tasks<F, E>, zero: i64) -> Result<Command, Refused> {
        let control = tasks.service.config().control.as_ref().ok_or(Refused)?;
        match self {
            Self::Current(amperes) => control.current(*amperes).map(Command::Current).map_err(|_| Refused),
            Self::ZeroVelocity(_) => control.speed(0.0).map(Command::Speed).map_err(|_| Refused),
            Self::Position(Position { kp_scale: 0.0, kd_scale: 0.0, torque, .. }) => {
                control.torque(*torque).map(Command::Current).map_err(|_| Refused)
            }
            Self::Position(Position { position, velocity, .. }) if position.is_nan() => {
                control.speed(TAU * *velocity).map(Command::Speed).map_err(|_| Refused)
            }
            Self::Position(Position { position, velocity: 0.0, .. }) => {
                let turns = fixed(*position).ok_or(Refused)?.saturating_add(zero);
                let pole_pairs = i64::from(tasks.settings.pole_pairs);
                let bits = turns.saturating_mul(pole_pairs).wrapping_add(tasks.encoder.origin().to_bits());
                Ok(Command::Position(Electrical::from_bits(bits)))
            }
            Self::Position(_) => Err(Refused),
        }
    }
}

/// Turns in 2⁻³².
pub(super) fn fixed(turns: f32) -> Option<i64> {
    // Within what every drive can count.
    (turns.abs() < 16_777_216.0).then_some((turns * 4_294_967_296.0) as i64)
}

/// The inverse.
pub(super) fn turns(fixed: i64) -> f32 {
    fixed as f32 / 4_294_967_296.0
}
