//! What the interrupt tells the tasks: raw numbers, SI only when someone looks.

use crate::angle::ElectricalAngle;
use crate::fault::Limits;
use crate::hall::Codes;
use crate::hall::calibrate::Sweep;
use crate::hall::track::Tracker;
use crate::mode::Mode;

/// One sample and what became of it: 32 bytes without a gap. The drive keeps one up to date as its state, so that handing
/// it over is a copy of eight words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Record {
    /// Position, angle and speed of the rotor. While calibrating, the field's, which acts while the sample is taken.
    pub rotor: Tracker,
    /// Number of the step, wrapping.
    pub sequence: u32,
    /// The Halls as sampled.
    pub codes: Codes,
    /// Successive samples without a plausible angle up to this one, over which the rotor is extrapolated.
    pub missed: u16,
    /// State after the step.
    pub mode: Mode,
    /// What held the drive back.
    pub limits: Limits,
    /// What the sample is to a calibration.
    pub calibration: Progress,
}

impl Record {
    /// At the start: nothing is known.
    pub const fn new() -> Self {
        Self {
            rotor: Tracker::at(ElectricalAngle::ZERO),
            sequence: 0,
            codes: [0; 3],
            missed: 0,
            mode: Mode::Unarmed,
            limits: Limits::NONE,
            calibration: Progress::None,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_eight_words() {
        assert_eq!(size_of::<Record>(), 32);
    }
}
