//! What can be wrong with settings.

use crate::pwm;
use core::fmt;

/// A setting that cannot be, or why one cannot be changed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error<'a> {
    /// Name, value and allowed range.
    OutOfRange {
        /// Name of the setting.
        field: &'a str,
        /// Its value.
        value: f32,
        /// Least allowed.
        min: f32,
        /// Most allowed.
        max: f32,
    },
    /// The PWM settings contradict each other.
    Pwm(pwm::Error),
    /// This setting, or field-oriented commutation, needs current control.
    NoControl,
    /// There is no setting of this name.
    Unknown,
    /// It follows from the board's parts.
    Fixed,
    /// It takes whole numbers only, or one of its choices.
    NotWhole,
    /// More than the board stands, whatever the other settings are.
    Ceiling {
        /// Name of the setting.
        field: &'a str,
        /// Its value.
        value: f32,
        /// The board's ceiling.
        most: f32,
    },
}

impl fmt::Display for Error<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { field, value, min, max } => {
                write!(f, "{field} is {value}, but must be from {min} to {max} with the other settings as they are")
            }
            Self::Pwm(error) => error.fmt(f),
            Self::NoControl => write!(f, "this needs the settings of the current control"),
            Self::Unknown => write!(f, "there is no such setting"),
            Self::Fixed => write!(f, "this setting follows from the board's parts and cannot be changed"),
            Self::Ceiling { field, value, most } => {
                write!(f, "{field} is {value}, but the board's ceiling is {most}, which no setting exceeds")
            }
            Self::NotWhole => write!(f, "this setting takes whole numbers or one of its choices only"),
        }
    }
}

impl core::error::Error for Error<'_> {}

impl From<pwm::Error> for Error<'_> {
    fn from(error: pwm::Error) -> Self {
        Self::Pwm(error)
    }
}
