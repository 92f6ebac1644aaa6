//! What the interrupt tells the tasks: raw numbers, SI only when someone looks.

use crate::angle::{ElectricalAngle, Position};
use crate::fault::Limits;
use crate::hall::Codes;
use crate::hall::calibrate::Sweep;
use crate::mode::Mode;

/// One sample and what became of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// Number of the step, wrapping.
    pub sequence: u32,
    /// The Halls as sampled.
    pub codes: Codes,
    /// State after the step.
    pub mode: Mode,
    /// What held the drive back.
    pub limits: Limits,
    /// What the sample is to a calibration.
    pub calibration: Progress,
    /// The field's angle while calibrating, the tracked angle of the rotor otherwise.
    pub angle: ElectricalAngle,
    /// Tracked speed in 2⁻³² electrical turns a step.
    pub speed: i32,
    /// Position with its turns.
    pub position: Position,
}

/// What a sample is to a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// Nothing.
    None,
    /// To be collected.
    Sample(Sweep),
    /// Both sweeps are done: what was collected is complete.
    Complete,
}

impl Record {
    /// Electrical turns a second.
    pub fn electrical_hz(&self, step_hz: f32) -> f32 {
        self.speed as f32 / 4_294_967_296.0 * step_hz
    }
}
