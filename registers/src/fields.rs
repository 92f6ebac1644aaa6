//! What the registers of a command hold.

use crate::axis::{Command, Mode, Position, Refused};
use crate::frame::Fault;
use crate::register::{self, Content};

/// The mode that was commanded, and the registers of its command.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fields {
    mode: i32,
    position: Position,
    current: [f32; 2],
    within: [f32; 2],
}

impl Fields {
    /// A command of a mode about which nothing else is said.
    pub const fn of(mode: i32) -> Self {
        Self { mode, position: Position::DEFAULT, current: [0.0; 2], within: [0.0; 2] }
    }

    fn place(&mut self, number: u32) -> Option<&mut f32> {
        let Self { position, current: [d, q], within: [lower, upper], .. } = self;
        Some(match number {
            register::COMMAND_Q_CURRENT => q,
            register::COMMAND_D_CURRENT => d,
            register::COMMAND_POSITION => &mut position.position,
            register::COMMAND_VELOCITY => &mut position.velocity,
            register::COMMAND_TORQUE | register::WITHIN_TORQUE => &mut position.torque,
            register::COMMAND_KP_SCALE | register::WITHIN_KP_SCALE => &mut position.kp_scale,
            register::COMMAND_KD_SCALE | register::WITHIN_KD_SCALE => &mut position.kd_scale,
            register::COMMAND_MAX_TORQUE | register::WITHIN_MAX_TORQUE => &mut position.max_torque,
            register::COMMAND_STOP_POSITION => &mut position.stop_position,
            register::COMMAND_TIMEOUT | register::WITHIN_TIMEOUT => &mut position.timeout,
            register::COMMAND_VELOCITY_LIMIT => &mut position.velocity_limit,
            register::COMMAND_ACCELERATION_LIMIT => &mut position.acceleration_limit,
            register::WITHIN_LOWER => lower,
            register::WITHIN_UPPER => upper,
            _ => return None,
        })
    }

    /// What one of its registers holds.
    pub fn get(&self, number: u32) -> Option<f32> {
        match number {
            // There is no integral that it could limit.
            register::COMMAND_ILIMIT_SCALE | register::WITHIN_ILIMIT_SCALE => Some(1.0),
            _ => { *self }.place(number).map(|place| *place),
        }
    }

    /// Writes one of its registers.
    pub fn set(&mut self, number: u32, content: Content) -> Result<(), Fault> {
        match (number, content) {
            (register::COMMAND_ILIMIT_SCALE | register::WITHIN_ILIMIT_SCALE, _) => Ok(()),
            // The bounds are never ignored.
            (register::COMMAND_IGNORE_BOUNDS | register::WITHIN_IGNORE_BOUNDS, Content::Bits(0)) => Ok(()),
            (_, Content::Real(value)) => {
                *self.place(number).ok_or(Fault::Refused)? = value;
                Ok(())
            }
            _ => Err(Fault::Refused),
        }
    }

    /// The command, if it is one that is obeyed.
    pub fn command(&self) -> Result<Command, Refused> {
        const STOPPED: i32 = Mode::Stopped as i32;
        const CURRENT: i32 = Mode::Current as i32;
        const POSITION: i32 = Mode::Position as i32;
        const ZERO_VELOCITY: i32 = Mode::ZeroVelocity as i32;
        const STAY_WITHIN: i32 = Mode::StayWithin as i32;
        const BRAKE: i32 = Mode::Brake as i32;
        let with = self.checked()?;
        // So it is documented: without stiffness, no damping.
        let position = Position { kd_scale: with.kd_scale.min(with.kp_scale), ..with };
        let [d, q] = self.current;
        let [lower, upper] = self.within;
        Ok(match self.mode {
            STOPPED => Command::Stop,
            CURRENT if d.is_nan() || q.is_nan() => return Err(Refused),
            CURRENT => Command::Current { d, q, timeout: position.timeout },
            POSITION => Command::Position(position),
            ZERO_VELOCITY => Command::ZeroVelocity(with),
            STAY_WITHIN if lower > upper => return Err(Refused),
            STAY_WITHIN => Command::StayWithin { lower, upper, with: position },
            BRAKE => Command::Brake,
            _ => return Err(Refused),
        })
    }

    /// With the numbers for those for which "none" means one; refused where "none" means nothing.
    fn checked(&self) -> Result<Position, Refused> {
        let Position { velocity, torque, kp_scale, kd_scale, max_torque, .. } = self.position;
        if torque.is_nan() || !(0.0..=1.0).contains(&kp_scale) || !(0.0..=1.0).contains(&kd_scale) || max_torque < 0.0 {
            return Err(Refused);
        }
        Ok(Position { velocity: if velocity.is_nan() { 0.0 } else { velocity }, ..self.position })
    }
}
