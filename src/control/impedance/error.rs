//! What can be wrong with a request.

use core::fmt;

/// A number of a [request](super::Request) that cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// There is no current control, so no torque.
    NoControl,
    /// A number is none, or out of its range.
    OutOfRange {
        /// Which.
        field: Field,
        /// What was asked for.
        value: f32,
        /// Least allowed.
        least: f32,
        /// Most allowed.
        most: f32,
    },
    /// A position that is approached within limits is one to be at rest at: a speed or a stop beside it needs the
    /// reference to be there at once, without limits.
    Moving,
    /// The range to stay within has its ends the wrong way about, or is longer than 256 electrical turns.
    Crossed,
}

/// A number of a [request](super::Request).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Field {
    /// Stiffness, scaled.
    Kp,
    /// Damping, scaled.
    Kd,
    /// A scale factor.
    Scale,
    /// Feed-forward torque.
    FeedForward,
    /// Largest torque.
    MaxTorque,
    /// A position.
    Position,
    /// A speed.
    Speed,
    /// Largest speed of the reference.
    MaxSpeed,
    /// Largest acceleration of the reference.
    MaxAcceleration,
    /// The command time-out.
    Timeout,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::OutOfRange { field, value, least, most } = self else {
            return f.write_str(match self {
                Self::NoControl => "set up without current control",
                Self::Moving => "a speed or a stop beside a position needs the limits of speed and acceleration off",
                _ => "the range ends before it begins, or is longer than 256 electrical turns",
            });
        };
        let (name, why) = match field {
            Field::Kp => ("kp in N·m/rad", ": above, the drive's delay makes the spring unstable at this inertia"),
            Field::Kd => ("kd in N·m·s/rad", ": above, the drive's delay makes the damper unstable at this inertia"),
            Field::Scale => ("the scale factor", ""),
            Field::FeedForward => ("the feed-forward torque in N·m", ""),
            Field::MaxTorque => ("the largest torque in N·m", ""),
            Field::Position => ("the position in turns", ""),
            Field::Speed => ("the speed in rad/s", ""),
            Field::MaxSpeed => ("the largest speed in rad/s", ""),
            Field::MaxAcceleration => ("the largest acceleration in rad/s²", ""),
            Field::Timeout => ("the command time-out in s", ""),
        };
        write!(f, "{name} is {value}, but must be a number from {least} to {most}{why}")
    }
}

impl core::error::Error for Error {}
