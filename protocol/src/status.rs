//! How the drive is. The order of the variants is their number on the wire.

use hallservo::commutation::Commutation;
use hallservo::fault::Limits;
use hallservo::hall::adapt;
use hallservo::mode::Mode;
use serde::{Deserialize, Serialize};

/// What takes a while.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Activity {
    /// Nothing does.
    #[default]
    None,
    /// The sensors.
    Calibration,
    /// The motor.
    Identification,
    /// Its cogging.
    Cogging,
    /// Its flux linkage and inertia, roughly.
    Swings,
    /// The rings of the absolute encoder.
    #[cfg(feature = "encoder")]
    Encoder,
    /// What its magnets do to the angle.
    #[cfg(feature = "map")]
    Magnets,
}

/// What the flash holds of a kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Problem {
    /// A good record, in use.
    #[default]
    None,
    /// Nothing was ever saved.
    Blank,
    /// Something, but no whole record, or one with impossible values.
    Corrupt,
    /// A whole record, of another version of the firmware.
    Version(u16),
    /// It has a setting that is not known or not allowed any more, which was left at its default.
    Foreign,
    /// The flash failed, or there is no place in it.
    Flash,
}

/// The kinds of records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Record {
    /// What the sensors deliver.
    Sensors,
    /// The table of the cogging.
    Cogging,
    /// The settings.
    Settings,
    /// All that is known of the absolute encoder.
    #[cfg(feature = "encoder")]
    Encoder,
    /// The map of the rotor's magnets.
    #[cfg(feature = "map")]
    Magnets,
}

/// Whether the drive learns its sensors while it turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Learning {
    /// It is switched off, or there is no calibration.
    #[default]
    Off,
    /// It follows, and learns when the rotor turns.
    On,
    /// It has given up.
    Ended(adapt::Fault),
    /// The rotor leaves more unexplained than its sensors can be learnt from: the calibration is used until that ends.
    Uneven,
    /// It follows, and the rotor turns too fast to learn.
    TooFast,
}

/// How the drive is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Since power-up.
    pub uptime_ms: u64,
    /// State.
    pub mode: Mode,
    /// What limits the drive.
    pub limits: Limits,
    /// Whether there is a calibration.
    pub calibrated: bool,
    /// How the phases are driven.
    pub commutation: Commutation,
    /// Whether the drive compensates the cogging.
    pub anti_cogging: bool,
    /// Mechanical, turns since power-up.
    pub position_turns: f64,
    /// Mechanical, rad/s.
    pub speed_rad_s: f32,
    /// Along q, A, with what produces it; not a number where it is not measured.
    pub current_a: f32,
    /// Not a number where it is not measured.
    pub bus_v: f32,
    /// Of bridge and motor; not a number where there is no thermistor.
    pub temperatures_c: [f32; 2],
    /// What goes on. It is over when the rotor is at rest, and what was found at work and in the flash: 5 s after the
    /// last turn at most.
    pub activity: Activity,
    /// How far, 0 to 1.
    pub progress: f32,
    /// Whether the sensors are learnt.
    pub learning: Learning,
    /// Models learnt and taken up since power-up.
    pub learnt: u32,
    /// Sensors, cogging and settings in the flash, as found at power-up or saved since.
    pub stored: [Problem; 3],
    /// Whether there are settings, a model or a table that the flash does not hold yet.
    pub unsaved: bool,
    /// Records of the control interrupt that the tasks were too late for.
    pub lost_records: u32,
    /// Frames from the tool that were none.
    pub garbage: u32,
    /// Frames to the tool that found no room.
    pub lost_frames: u32,
    /// Seconds that a command holds; infinite without current control: for ever.
    pub command_timeout_s: f32,
    /// Entries in the history.
    pub incidents: u8,
    /// The tool that controls, 0 for none.
    pub client: u32,
    /// Whether the settings in the flash could not be taken over as they are, and nobody has confirmed those in use:
    /// the bridge is not switched on before.
    pub unconfirmed: bool,
}

/// One sample, and what became of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// One more from frame to frame.
    pub number: u32,
    /// The control period that it is of.
    pub step: u32,
    /// Electrical degrees, −180 to 180.
    pub angle_deg: f32,
    /// Mechanical, rad/s.
    pub speed_rad_s: f32,
    /// Mechanical, turns since power-up.
    pub position_turns: f64,
    /// Along d and q, A; not numbers where they are not measured.
    pub current_a: [f32; 2],
    /// Along d and q, V; not numbers but under field-oriented control.
    pub voltage_v: [f32; 2],
    /// Not a number where it is not measured.
    pub bus_v: f32,
    /// State.
    pub mode: Mode,
    /// What limits the drive.
    pub limits: Limits,
    /// The Halls, ADC codes; while a current, a speed or a position is followed, of the period after.
    pub codes: [u16; 3],
}
