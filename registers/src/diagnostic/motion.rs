//! The commands of the group `d`: what is asked of the motor.

use super::lines::Note;
use crate::axis::{Axis, Command, Position, Refused};
use core::str::SplitAsciiWhitespace;

impl From<Refused> for Note {
    fn from(_: Refused) -> Self {
        Self::Refused
    }
}

/// Carries out what is behind the `d`. What is `held` is the motion to renew.
pub(super) fn carry_out(drive: &mut impl Axis, line: &str, held: &mut Option<Command>) -> Result<(), Note> {
    let words = &mut line.split_ascii_whitespace();
    let name = words.next().unwrap_or_default();
    match name {
        "stop" => {
            *held = None;
            drive.command(&Command::Stop)?;
        }
        "recapture" => drive.recapture()?,
        "nearest" | "rezero" => drive.set_output(output(words)?, true)?,
        "exact" | "index" => drive.set_output(output(words)?, false)?,
        "req-reindex" => drive.require_reindex()?,
        _ => {
            let command = parse(name, words)?;
            drive.command(&command)?;
            *held = Some(command).filter(is_held);
        }
    }
    Ok(())
}

/// Whether a motion has no time of its own: it holds for as long as is configured.
const fn is_held(command: &Command) -> bool {
    match command {
        Command::Position(with) | Command::ZeroVelocity(with) | Command::StayWithin { with, .. } => with.timeout == 0.0,
        Command::Current { timeout, .. } => *timeout == 0.0,
        Command::Brake => true,
        Command::Stop => false,
    }
}

fn parse(name: &str, words: &mut SplitAsciiWhitespace<'_>) -> Result<Command, Note> {
    Ok(match name {
        "pos" => {
            let (position, velocity) = (number(words)?, number(words)?);
            Command::Position(Position { position, velocity, ..spring(words, true)? })
        }
        "zero" => {
            let _ = (number(words)?, number(words)?);
            Command::ZeroVelocity(options(words, true)?)
        }
        "within" => {
            let (lower, upper) = (number(words)?, number(words)?);
            Command::StayWithin { lower, upper, with: spring(words, false)? }
        }
        "dq" => Command::Current { d: number(words)?, q: number(words)?, timeout: 0.0 },
        "brake" => Command::Brake,
        "tmt" | "raw" | "pwm" | "vdq" | "v" | "cal" | "cali" | "ind" | "flash" | "reset" | "cfg-set-output" | "die"
        | "assert" | "stack" | "loop" | "led" | "hstart" | "hend" => return Err(Note::Unsupported),
        _ => return Err(Note::Unknown),
    })
}

/// The options of a spring: without stiffness, no damping, as by the registers.
fn spring(words: &mut SplitAsciiWhitespace<'_>, stops: bool) -> Result<Position, Note> {
    let mut with = options(words, stops)?;
    // What is no share at all is refused later.
    if with.kd_scale <= 1.0 {
        with.kd_scale = with.kd_scale.min(with.kp_scale);
    }
    Ok(with)
}

/// The largest torque, and the options.
fn options(words: &mut SplitAsciiWhitespace<'_>, stops: bool) -> Result<Position, Note> {
    let mut position = Position { max_torque: number(words)?, ..Position::DEFAULT };
    for option in words {
        let (letter, value) = option.split_at_checked(1).ok_or(Note::Option)?;
        let place = match letter {
            "p" => &mut position.kp_scale,
            "d" => &mut position.kd_scale,
            "s" if stops => &mut position.stop_position,
            "f" => &mut position.torque,
            "t" => &mut position.timeout,
            "v" => &mut position.velocity_limit,
            "a" => &mut position.acceleration_limit,
            // Limit of an integral part, a fixed voltage or current, no bounds.
            "i" | "o" | "c" | "b" => return Err(Note::Unsupported),
            _ => return Err(Note::Option),
        };
        *place = value.parse().map_err(|_| Note::Number)?;
    }
    Ok(position)
}

fn number(words: &mut SplitAsciiWhitespace<'_>) -> Result<f32, Note> {
    words.next().ok_or(Note::Missing)?.parse().map_err(|_| Note::Number)
}

/// A position of the output; 0 where there is none.
fn output(words: &mut SplitAsciiWhitespace<'_>) -> Result<f32, Note> {
    words.next().map_or(Ok(0.0), |word| word.parse().map_err(|_| Note::Number))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Result<Command, Note> {
        let mut words = line.split_ascii_whitespace();
        parse(words.next().unwrap_or_default(), &mut words)
    }

    #[test]
    fn a_motion_has_three_numbers_and_options() {
        let Ok(Command::Position(motion)) = read("pos nan 0.5 0.2 p0.5 s-1.25 v3 a1e2") else { panic!() };
        assert!(motion.position.is_nan() && motion.timeout == 0.0);
        assert_eq!((motion.velocity, motion.max_torque, motion.kp_scale, motion.kd_scale), (0.5, 0.2, 0.5, 0.5));
        assert_eq!((motion.stop_position, motion.velocity_limit), (-1.25, 3.0));
        assert_eq!((motion.acceleration_limit, motion.torque), (100.0, 0.0));
        for (line, kd_scale) in [("pos 0 0 nan p0.2 d0.1", 0.1), ("pos 0 0 nan p0.2 d5", 5.0), ("pos 0 0 nan p0", 0.0)]
        {
            let Ok(Command::Position(motion)) = read(line) else { panic!() };
            assert_eq!(motion.kd_scale, kd_scale, "{line}");
        }
        let Ok(Command::StayWithin { lower, upper, with }) = read("within -1 2.5 0.2 t0.5") else { panic!() };
        assert_eq!((lower, upper, with.max_torque, with.timeout), (-1.0, 2.5, 0.2, 0.5));
    }

    #[test]
    fn what_is_wrong_is_no_motion() {
        assert_eq!(read("pos 1 2"), Err(Note::Missing));
        assert_eq!(read("pos 1 2 x"), Err(Note::Number));
        assert_eq!(read("pos 1 2 3 p"), Err(Note::Number));
        assert_eq!(read("pos 1 2 3 q1"), Err(Note::Option));
        assert_eq!(read("pos 1 2 3 c1.5"), Err(Note::Unsupported));
        assert_eq!(read("within 1 2 3 s1"), Err(Note::Option));
        assert_eq!(read("raw 0.5 0.5 0.5"), Err(Note::Unsupported));
        assert_eq!(read("jump"), Err(Note::Unknown));
    }
}
