//! What is asked and answered. The order of the variants is their number on the wire.

#[cfg(feature = "encoder")]
use crate::encoder::{EncoderAsk, EncoderRefusal, EncoderStatus};
use crate::history::History;
#[cfg(feature = "map")]
use crate::magnets::{MagnetsAsk, MagnetsRefusal, MagnetsStatus, POINTS_AT_ONCE};
use crate::report::{Calibration, Cogging, Procedure};
#[cfg(feature = "scope")]
use crate::scope::{ScopeAsk, ScopeRefusal, ScopeRows, ScopeStatus};
use crate::status::{Activity, Problem, Status, Telemetry};
use hallservo::commutation::Commutation;
use hallservo::control::config::BadDemand;
use hallservo::control::impedance;
use hallservo::drive;
use hallservo::drive::standstill::{Probe, Window};
use hallservo::service::identify;
use hallservo::service::procedure;
use hallservo::service::swings::Rough;
use hallservo::settings::{self, Kind};
use serde::{Deserialize, Serialize};

/// What is never said: it keeps the number of a message that a drive has not, for those after it.
#[cfg(all(feature = "scope", not(all(feature = "encoder", feature = "map"))))]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Absent {}

/// From a tool to the drive, with names of settings as [`AskBy`] has them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestBy<N> {
    /// The reply repeats it.
    pub id: u16,
    /// Who asks: a number other than 0 that each tool draws at random.
    pub client: u32,
    /// Whether what this begins goes on though its tool falls silent.
    pub unattended: bool,
    /// What is asked.
    pub ask: AskBy<N>,
}

/// From a tool to the drive.
pub type Request<'a> = RequestBy<&'a str>;

/// What can be asked.
pub type Ask<'a> = AskBy<&'a str>;

/// From the drive to a tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reply<'a> {
    /// That of the request.
    pub id: u16,
    /// What is answered.
    #[serde(borrow)]
    pub answer: Answer<'a>,
}

/// What can be asked. Numbers that are not finite or beyond what the settings allow are refused. A name of a setting is
/// text, or what a drive takes it as, which compares it only: its bytes. Whether they are text takes 536 bytes of a
/// chip's flash to find out.
// A byte tells which it is: the compiler would take a number of 64 bits inside of one.
#[repr(u8)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum AskBy<N> {
    /// Who is there: [`Answer::Hello`].
    Hello,
    /// How it is: [`Answer::Status`].
    Status,
    /// Bridge on; a rotor at rest is checked and held.
    Arm,
    /// Bridge off; ends whatever is going on, and the control by a tool. From anyone.
    Disarm,
    /// The fault has been taken note of.
    Clear,
    /// Voltage as a fraction of the largest, −1 to 1.
    Voltage(f32),
    /// Torque, N·m.
    Torque(f32),
    /// Mechanical speed, rad/s. While something goes on that turns the motor, 0 is not refused: it ends that by braking.
    /// [`Ask::Disarm`] is to follow.
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
    /// Compensate the cogging with what was learnt, or no longer.
    AntiCogging(bool),
    /// A setting by its number, from zero: [`Answer::Setting`].
    Setting(u16),
    /// A setting by its name: [`Answer::Setting`].
    Get(N),
    /// Another value, while the bridge is off; bandwidths of the loops and of the tracker at any time. It holds until the
    /// power goes, or for good after [`Ask::Save`].
    Set {
        /// Name of the setting.
        name: N,
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
    /// Another tool may control the drive.
    Release,
    /// The settings are right as they are, though those in the flash could not be taken over: [`Status::unconfirmed`].
    Accept,
    /// Measure at standstill, calibrated or not; to be repeated, or the bridge is switched off. [`Ask::Disarm`] ends it;
    /// the sensors have to be calibrated then.
    Measure {
        /// Whether a measurement begins; otherwise one goes on.
        begins: bool,
        /// What is to be measured now.
        probe: Probe,
    },
    /// What flowed: [`Answer::Window`].
    Window,
    /// Swing to and fro and measure flux linkage and inertia roughly, from a drive that is ready.
    Swing,
    /// What the last one came to: [`Answer::Swings`].
    Swings,
    /// A spring and a damper at the shaft. Positions are mechanical turns, as those of [`Ask::Position`].
    Impedance(impedance::Request),
    /// Where the reference of the spring and the damper is: [`Answer::Reference`].
    Reference,
    /// The absolute encoder.
    #[cfg(feature = "encoder")]
    Encoder(EncoderAsk),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "encoder")))]
    Encoder(Absent),
    /// The map of the rotor's magnets.
    #[cfg(feature = "map")]
    Magnets(MagnetsAsk),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "map")))]
    Magnets(Absent),
    /// The scope.
    #[cfg(feature = "scope")]
    Scope(ScopeAsk),
}

impl<N> AskBy<N> {
    /// Whether it says what the motor is to do, until the next one or for `command_timeout_s`.
    pub const fn is_set_point(&self) -> bool {
        use AskBy::{Impedance, Position, Speed, Torque, Voltage};
        matches!(self, Voltage(_) | Torque(_) | Speed(_) | Position(_) | Impedance(_))
    }

    /// Whether it changes anything of the drive, which is for the one tool that controls it.
    pub const fn controls(&self) -> bool {
        #[cfg(feature = "encoder")]
        if let Self::Encoder(EncoderAsk::Status) = self {
            return false;
        }
        #[cfg(feature = "map")]
        if let Self::Magnets(MagnetsAsk::Status | MagnetsAsk::Points(_)) = self {
            return false;
        }
        #[cfg(feature = "scope")]
        if let Self::Scope(_) = self {
            return false;
        }
        !matches!(
            self,
            Self::Hello
                | Self::Status
                | Self::Disarm
                | Self::Calibration
                | Self::Identification
                | Self::Cogging
                | Self::Setting(_)
                | Self::Get(_)
                | Self::Telemetry(_)
                | Self::History(_)
                | Self::Release
                | Self::Window
                | Self::Swings
                | Self::Reference
        )
    }
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
    Identification(Procedure<identify::Report>),
    /// To [`Ask::Cogging`].
    Cogging(Procedure<Cogging>),
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
    /// To [`Ask::Window`]: one that was not asked for before, if there is any.
    Window(Option<Window>),
    /// To [`Ask::Swings`].
    Swings(Procedure<Rough>),
    /// To [`Ask::Reference`]; none while no spring and damper are followed.
    Reference(Option<impedance::State>),
    /// To [`EncoderAsk::Status`].
    #[cfg(feature = "encoder")]
    Encoder(EncoderStatus),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "encoder")))]
    Encoder(Absent),
    /// To [`MagnetsAsk::Status`].
    #[cfg(feature = "map")]
    Magnets(MagnetsStatus),
    /// To [`MagnetsAsk::Points`], in 2⁻¹⁸ electrical turns; none beyond the end of the map.
    #[cfg(feature = "map")]
    MagnetPoints([i16; POINTS_AT_ONCE]),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "map")))]
    Magnets(Absent),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "map")))]
    MagnetPoints(Absent),
    /// To [`ScopeAsk::Status`].
    #[cfg(feature = "scope")]
    Scope(ScopeStatus),
    /// To [`ScopeAsk::Rows`].
    #[cfg(feature = "scope")]
    ScopeRows(ScopeRows),
}

/// Who is there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello<'a> {
    /// The board.
    pub board: &'a str,
    /// Version of its firmware.
    pub firmware: &'a str,
    /// Serial number of its chip, the lowest word first.
    pub serial: [u32; 3],
    /// Number of settings.
    pub settings: u16,
    /// Control periods a second.
    pub step_hz: f32,
}

/// A setting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting<'a> {
    /// Its name.
    pub name: &'a str,
    /// Unit of the value.
    pub unit: &'a str,
    /// What values it takes.
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
    /// The drive refuses the command.
    Drive(drive::Refusal),
    /// Not a number, or of a larger magnitude than the settings allow.
    Demand(BadDemand),
    /// The procedure cannot begin.
    Procedure(procedure::Error),
    /// A setting cannot be changed so.
    #[serde(borrow)]
    Setting(settings::Error<'a>),
    /// The flash holds no settings to go back to.
    NothingStored(Problem),
    /// The flash did not take it.
    Flash,
    /// There is no table of the cogging: it has to be learnt first.
    NoTable,
    /// A procedure is at work, which a disarming ends.
    Busy(Activity),
    /// The control interrupt does not answer.
    NoAnswer,
    /// Another tool controls the drive.
    Controlled,
    /// Not all of the settings in the flash could be taken over: [`Ask::Accept`] or [`Ask::Save`] first.
    Unconfirmed(Problem),
    /// There is no such spring and damper.
    Impedance(impedance::Error),
    /// The absolute encoder cannot.
    #[cfg(feature = "encoder")]
    Encoder(EncoderRefusal),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "encoder")))]
    Encoder(Absent),
    /// The map of the magnets cannot.
    #[cfg(feature = "map")]
    Magnets(MagnetsRefusal),
    /// Keeps the number: there is none of it here.
    #[cfg(all(feature = "scope", not(feature = "map")))]
    Magnets(Absent),
    /// The scope cannot.
    #[cfg(feature = "scope")]
    Scope(ScopeRefusal),
}
