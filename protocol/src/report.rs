//! Results of the calibration and the procedures that turn the motor.

use hallservo::hall::calibrate::{self, report::Report};
use hallservo::service::procedure;
use serde::{Deserialize, Serialize};

/// Result of the last calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Calibration {
    /// There was none since power-up.
    None,
    /// It is at work.
    Running,
    /// The drive can be armed.
    Done(Report),
    /// What is wrong.
    Failed(calibrate::Error),
    /// A command or a fault ended it.
    Ended,
}

/// Result of the last run of a procedure that turns the motor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Procedure<T> {
    /// There was none since power-up.
    None,
    /// It is at work.
    Running,
    /// What it found.
    Done(T),
    /// Why it came to nothing.
    Failed(procedure::Error),
}

/// The cogging as learnt; it is in the flash, or will be at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cogging {
    /// Largest current of the table, A.
    pub largest_a: f32,
    /// Its RMS, A.
    pub rms_a: f32,
    /// RMS of the current beside it for what differs from pole to pole, A; not a number where the drive has no room for
    /// that.
    pub by_pole_a: f32,
}
