//! The messages. Their order is their number on the wire.

use crate::report::{Calibration, Cogging, Motor, Procedure};
use serde::{Deserialize, Serialize};

/// From a tool to the drive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Request<'a> {
    /// The reply repeats it.
    pub id: u16,
    /// What is asked.
    #[serde(borrow)]
    pub ask: Ask<'a>,
}

/// From the drive to a tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reply<'a> {
    /// That of the request.
    pub id: u16,
    /// What is answered.
    #[serde(borrow)]
    pub answer: Answer<'a>,
}

/// What can be asked. Numbers that are not finite or beyond what the settings allow are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Ask<'a> {
    /// Who is there: [`Answer::Hello`].
    Hello,
    /// How it is: [`Answer::Status`].
    Status,
    /// Bridge on, command zero.
    Arm,
    /// Bridge off; ends whatever is going on.
    Disarm,
    /// The fault has been taken note of.
    Clear,
    /// Voltage as a fraction of the largest, −1 to 1.
    Voltage(f32),
    /// Torque, N·m.
    Torque(f32),
    /// Mechanical speed, rad/s.
    Speed(f32),
    /// Mechanical position, turns.
    Position(f64),
    /// How the phases are driven, while the bridge is off.
    Commutate(Commutation),
    /// Turn the rotor open loop and find out what the sensors deliver. [`Status::progress`] tells how far it is.
    Calibrate,
    /// What the last one came to: [`Answer::Calibration`].
    Calibration,
    /// Turn to and fro and measure the motor, from a drive that is ready; the bridge is off again in the end.
    Identify,
    /// What the last one came to: [`Answer::Identification`].
    Identification,
    /// Turn slowly both ways and learn what the magnets do to the teeth, the same way.
    LearnCogging,
    /// What the last one came to: [`Answer::Cogging`].
    Cogging,
    /// Balance what was learnt, or no longer.
    Balance(bool),
    /// A setting by its number, from zero: [`Answer::Setting`].
    Setting(u16),
    /// A setting by its name: [`Answer::Setting`].
    Get(&'a str),
    /// Another value, while the bridge is off. It holds until the power goes, or for good after [`Ask::Save`].
    Set {
        /// Name of the setting.
        name: &'a str,
        /// In its unit; 0 and 1 for no and yes, the number of a choice.
        value: f32,
    },
    /// Keep the settings in the flash: [`Answer::Saved`].
    Save,
    /// Back to the settings in the flash.
    Load,
    /// Back to the board's defaults; the flash keeps what it has until [`Ask::Save`].
    Restore,
    /// Telemetry so many times a second, 0 to 1000; 0 ends it.
    Telemetry(f32),
    /// An entry of the history, 0 the latest: [`Answer::History`].
    History(u8),
}

/// What can be answered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Answer<'a> {
    /// To [`Ask::Hello`].
    #[serde(borrow)]
    Hello(Hello<'a>),
    /// It is done.
    Done,
    /// It is not done, and why.
    Refused(Refusal<'a>),
    /// To [`Ask::Status`].
    Status(Status),
    /// To [`Ask::Calibration`].
    Calibration(Calibration),
    /// To [`Ask::Identification`].
    Identification(Procedure<'a, Motor>),
    /// To [`Ask::Cogging`].
    Cogging(Procedure<'a, Cogging>),
    /// To [`Ask::Setting`], [`Ask::Get`] and [`Ask::Set`].
    Setting(Setting<'a>),
    /// The settings are in the flash, or will be when the bridge is off.
    Saved {
        /// An erase stalls the control, so it waits for the bridge to be off.
        waits: bool,
    },
    /// Unasked, after [`Ask::Telemetry`].
    Telemetry(Telemetry),
    /// To [`Ask::History`].
    History(History),
}

/// Who is there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello<'a> {
    /// The board.
    pub board: &'a str,
    /// Version of its firmware.
    pub firmware: &'a str,
    /// Number of settings.
    pub settings: u16,
    /// Control periods a second.
    pub step_hz: f32,
}

/// State of the drive, as in `hallservo::mode::Mode`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Bridge off, no calibration.
    #[default]
    Unarmed,
    /// The field stands still and pulls the rotor to it.
    Aligning,
    /// The field turns.
    Calibrating,
    /// Bridge off, angle and speed are known.
    Ready,
    /// Bridge on.
    Running,
    /// Bridge off until cleared; the code of the fault, as in `hallservo::fault::Fault::code`.
    Faulted(u8),
}

/// How the phases are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Commutation {
    /// Six steps a turn.
    Block,
    /// Three sines.
    #[default]
    Sinusoidal,
    /// Currents in the frame of the rotor.
    FieldOriented,
}

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
}

/// Whether the drive learns its sensors while it turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Learning {
    /// It is switched off, or there is no calibration.
    #[default]
    Off,
    /// It follows, and learns when the rotor turns.
    On,
    /// It has given up: which sensor (0 to 2, or 3 for all) and why, as [`Cause::Sensor`].
    Ended {
        /// The sensor.
        channel: u8,
        /// Why.
        why: u8,
    },
}

/// How the drive is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Since power-up.
    pub uptime_ms: u64,
    /// State.
    pub mode: Mode,
    /// What holds the drive back, as in `hallservo::fault::Limits::bits`.
    pub limits: u8,
    /// Whether there is a calibration.
    pub calibrated: bool,
    /// How the phases are driven.
    pub commutation: Commutation,
    /// Whether the cogging is balanced.
    pub balanced: bool,
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
    /// What goes on.
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
    /// Seconds that a command holds; infinite: for ever.
    pub command_timeout_s: f32,
    /// Entries in the history.
    pub incidents: u8,
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
    /// What holds the drive back.
    pub limits: u8,
    /// The Halls, ADC codes.
    pub codes: [u16; 3],
}

/// Of what kind the value of a setting is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind<'a> {
    /// A number.
    Real,
    /// A whole number.
    Whole,
    /// 0 for no and 1 for yes.
    Switch,
    /// One of these names, separated by `|`, counted from zero.
    Choice(&'a str),
}

/// A setting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting<'a> {
    /// Its name.
    pub name: &'a str,
    /// Unit of the value.
    pub unit: &'a str,
    /// Of what kind it is.
    pub kind: Kind<'a>,
    /// What it is at the moment.
    pub value: f32,
    /// What the board would have.
    pub default: f32,
    /// Least allowed, as the others are.
    pub min: f32,
    /// Most allowed, as the others are.
    pub max: f32,
    /// Whether it follows from the board's parts, and cannot be set.
    pub fixed: bool,
}

/// Why something is not done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal<'a> {
    /// Not in this state.
    Mode(Mode),
    /// There is no calibration.
    NotCalibrated,
    /// The Halls give no angle at the moment.
    NoAngle,
    /// Not a number, or of a larger magnitude than allowed.
    Beyond {
        /// What was asked for.
        value: f32,
        /// What is allowed.
        most: f32,
    },
    /// A Hall is lost.
    HallLost,
    /// The drive has no current control.
    NoControl,
    /// What would be a fault at once.
    Fault(u8),
    /// There is no such setting.
    NoSetting,
    /// It follows from the board's parts.
    Fixed,
    /// Out of range: which setting, and its range as the others are.
    OutOfRange {
        /// Name as in the drive's validation.
        field: &'a str,
        /// What it would be.
        value: f32,
        /// Least allowed.
        min: f32,
        /// Most allowed.
        max: f32,
    },
    /// Not a whole number, or none of the choices.
    NoChoice,
    /// The settings contradict each other.
    Contradiction,
    /// The flash holds no settings to go back to.
    NothingStored(Problem),
    /// The flash did not take it.
    Flash,
    /// There is no table of the cogging: it has to be learnt first.
    NoTable,
    /// Something goes on that a disarming ends.
    Busy(Activity),
    /// The control interrupt does not answer.
    Silent,
}

/// What went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Cause {
    /// The drive switched off, with this code.
    Fault(u8),
    /// A record of the flash could not be used.
    Stored(Record, Problem),
    /// A record could not be saved.
    NotSaved(Record),
    /// The sensors are not learnt any more. Which sensor, 0 to 2, or 3 for all; and 0 at the rail, 1 lost, 2 its offset,
    /// 3 its amplitude, 4 its placement drifted too far, 5 the third harmonic did, 6 a contradiction.
    Sensor {
        /// The sensor.
        channel: u8,
        /// Why.
        why: u8,
    },
}

/// What went wrong, and when.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Incident {
    /// Since power-up.
    pub at_ms: u64,
    /// State before.
    pub mode: Mode,
    /// What.
    pub cause: Cause,
}

/// An entry of the history.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Incidents since power-up, also those that have been pushed out.
    pub total: u32,
    /// The entry, if there is one of this number.
    pub entry: Option<Incident>,
}
