//! What the interrupt tells the tasks: raw numbers, SI only when someone looks.

use crate::angle::ElectricalAngle;
use crate::fault::Limits;
use crate::hall::Codes;
use crate::hall::calibrate::Sweep;
use crate::hall::track::Tracker;
use crate::mode::Mode;

/// One sample and what became of it. The drive keeps one up to date as its state, so that handing it over is a copy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Record {
    /// Position, angle and speed of the rotor.
    pub rotor: Tracker,
    /// Number of the step, wrapping.
    pub sequence: u32,
    /// While calibrating: the angle of the field that acts.
    pub field: ElectricalAngle,
    /// The Halls as sampled.
    pub codes: Codes,
    /// What held the drive back.
    pub limits: Limits,
    /// What the sample is to a calibration.
    pub calibration: Progress,
    /// State after the step.
    pub mode: Mode,
}

impl Record {
    /// At the start: nothing is known.
    pub const fn new() -> Self {
        Self {
            rotor: Tracker::at(ElectricalAngle::ZERO),
            sequence: 0,
            field: ElectricalAngle::ZERO,
            codes: [0; 3],
            limits: Limits::NONE,
            calibration: Progress::None,
            mode: Mode::Unarmed,
        }
    }

    /// Speed of the rotor in electrical turns a second, for a drive of `step_hz` steps a second.
    pub fn electrical_hz(&self, step_hz: f32) -> f32 {
        self.rotor.speed() as f32 / 4_294_967_296.0 * step_hz
    }
}

impl Default for Record {
    fn default() -> Self {
        Self::new()
    }
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
