//! What the control interrupt reports to the tasks, as raw numbers.

use crate::angle::{ElectricalAngle, TURN};
use crate::commutation::frames::Dq;
use crate::fault::{Fault, Limits};
use crate::hall::Codes;
use crate::hall::calibrate::Sweep;
use crate::hall::track::Tracker;
use crate::mode::Mode;

/// One sample and the angle, speed and state that came of it: 32 bytes without a gap. The drive keeps one up to date,
/// so that handing it over is a copy of eight words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Record {
    /// Position, angle and speed of the rotor. While calibrating, the field's, which acts while the sample is taken.
    pub rotor: Tracker,
    /// Number of the step whose rotor it is, wrapping; in the drive itself, that of the next record's.
    pub sequence: u32,
    /// The Halls as sampled; while a current, a speed or a position is followed, a step later.
    pub codes: Codes,
    /// Successive samples without a plausible angle up to this one, over which the rotor is extrapolated.
    pub missed: u16,
    /// State after the step.
    pub status: Status,
}

impl Record {
    /// At the start: nothing is known.
    pub const fn new() -> Self {
        Self {
            rotor: Tracker::at(ElectricalAngle::ZERO),
            sequence: 0,
            codes: [0; 3],
            missed: 0,
            status: Status::new(Mode::Unarmed, Limits::NONE, Progress::None),
        }
    }

    /// Speed of the rotor in electrical turns a second, for a drive of `step_hz` steps a second.
    pub fn electrical_hz(&self, step_hz: f32) -> f32 {
        self.rotor.speed() as f32 / TURN * step_hz
    }
}

impl Default for Record {
    fn default() -> Self {
        Self::new()
    }
}

/// Currents and voltages of a step, in 2⁻¹⁵ of their full scales.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State {
    /// Phase currents, offsets taken off.
    pub phases: [i32; 3],
    /// Currents in the frame of the rotor.
    pub current: Dq,
    /// Reference of the current along q, with the anti-cogging current, within its limit.
    pub current_reference: i32,
    /// Voltage of the last step; with block and sinusoidal commutation that along q only.
    pub voltage: Dq,
    /// Bus voltage.
    pub bus: u16,
    /// Reference of the current along d.
    pub field_reference: i16,
}

impl State {
    /// All zero.
    pub(crate) const NONE: Self =
        Self { phases: [0; 3], current: Dq::ZERO, current_reference: 0, voltage: Dq::ZERO, bus: 0, field_reference: 0 };
}

/// The reference of a spring and a damper, told every 64 steps while they are followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reference {
    /// How far it is ahead of the rotor, in 2⁻²³ electrical turns.
    pub strain: i32,
    /// Its speed, in 2⁻³² electrical turns a step.
    pub speed: i32,
    /// Whether it has come to where it was commanded to, or to the speed.
    pub complete: bool,
}

/// Rotor, currents and voltages of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Position, angle and speed of the rotor.
    pub rotor: Tracker,
    /// Number of the step whose rotor it is, wrapping.
    pub sequence: u32,
    /// Currents and voltages; `phases` a step later while something is followed.
    pub state: State,
    /// Correction of the alignment, by which the frame of the currents is ahead of the rotor's angle: see
    /// [`Drive::trim`](crate::drive::Drive::trim).
    pub trim: ElectricalAngle,
}

impl Measurement {
    /// Before the first.
    pub const NONE: Self = Self {
        rotor: Tracker::at(ElectricalAngle::ZERO),
        sequence: 0,
        state: State::NONE,
        trim: ElectricalAngle::ZERO,
    };
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

/// State, limits and progress in one word of plain numbers, which is copied as a word.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Status {
    mode: u8,
    fault: u8,
    limits: Limits,
    /// And [`HEAVIER`] and [`LIGHTER`].
    progress: u8,
}

/// Bits of [`Status::progress`]: see [`Status::is_heavier`] and [`Status::is_lighter`].
const HEAVIER: u8 = 4;
const LIGHTER: u8 = 8;

impl Status {
    /// The word.
    pub const fn new(mode: Mode, limits: Limits, progress: Progress) -> Self {
        let (mode, fault) = match mode {
            Mode::Unarmed => (0, 0),
            Mode::Aligning => (1, 0),
            Mode::Calibrating => (2, 0),
            Mode::Ready => (3, 0),
            Mode::Running => (4, 0),
            Mode::Faulted(fault) => (5, fault.code()),
        };
        let progress = match progress {
            Progress::None => 0,
            Progress::Sample(Sweep::Forward) => 1,
            Progress::Sample(Sweep::Backward) => 2,
            Progress::Complete => 3,
        };
        Self { mode, fault, limits, progress }
    }

    /// With other limits.
    pub(crate) const fn with_limits(self, limits: Limits) -> Self {
        Self { limits, ..self }
    }

    /// The same with what is known of the rotor's inertia.
    pub(crate) const fn with_heavier(self, heavier: bool) -> Self {
        Self { progress: self.progress & !HEAVIER | if heavier { HEAVIER } else { 0 }, ..self }
    }

    /// Whether the position is controlled with less than the bandwidth of the settings, until the drive is armed again:
    /// by a swing, the rotor was found to be much heavier than its inertia in the settings.
    pub const fn is_heavier(self) -> bool {
        self.progress & HEAVIER != 0
    }

    /// The same with what is known of the speed control.
    pub(crate) const fn with_lighter(self, lighter: bool) -> Self {
        Self { progress: self.progress & !LIGHTER | if lighter { LIGHTER } else { 0 }, ..self }
    }

    /// Whether the speed is controlled with smaller gains than the settings', until the drive is armed again: they swung
    /// the rotor to and fro, which is much lighter than its inertia in the settings.
    pub const fn is_lighter(self) -> bool {
        self.progress & LIGHTER != 0
    }

    /// State of the drive.
    pub const fn mode(self) -> Mode {
        match (self.mode, Fault::from_code(self.fault)) {
            (1, _) => Mode::Aligning,
            (2, _) => Mode::Calibrating,
            (3, _) => Mode::Ready,
            (4, _) => Mode::Running,
            (5, Some(fault)) => Mode::Faulted(fault),
            _ => Mode::Unarmed,
        }
    }

    /// What limits the drive at the moment.
    pub const fn limits(self) -> Limits {
        self.limits
    }

    /// What the sample is to a calibration.
    pub const fn progress(self) -> Progress {
        match self.progress & !(HEAVIER | LIGHTER) {
            1 => Progress::Sample(Sweep::Forward),
            2 => Progress::Sample(Sweep::Backward),
            3 => Progress::Complete,
            _ => Progress::None,
        }
    }
}

impl core::fmt::Debug for Status {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:?} {:?} {:?}", self.mode(), self.limits(), self.progress())
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Status {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{} {} {}", self.mode(), self.limits(), self.progress());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_eight_words() {
        assert_eq!(size_of::<Record>(), 32);
    }

    #[test]
    fn a_status_keeps_what_it_was_made_of() {
        let faults = Fault::all().map(Mode::Faulted);
        let modes = [Mode::Unarmed, Mode::Aligning, Mode::Calibrating, Mode::Ready, Mode::Running].into_iter();
        for mode in modes.chain(faults) {
            for limits in [Limits::NONE, Limits::DUTY.with(Limits::EXTRAPOLATED)] {
                for progress in [
                    Progress::None,
                    Progress::Sample(Sweep::Forward),
                    Progress::Sample(Sweep::Backward),
                    Progress::Complete,
                ] {
                    for heavier in [true, false] {
                        let status = Status::new(mode, limits, progress).with_heavier(true).with_heavier(heavier);
                        assert_eq!((status.mode(), status.limits()), (mode, limits));
                        assert_eq!((status.progress(), status.is_heavier()), (progress, heavier));
                    }
                }
            }
        }
    }
}
