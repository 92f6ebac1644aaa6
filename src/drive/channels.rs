//! What passes between the control interrupt and the tasks: samples, commands, replies, records, and the queues for
//! them.

use super::standstill::{Probe, Window};
use crate::angle::Position;
use crate::commutation::{Commutation, Modulation};
use crate::config::Config;
use crate::control::cogging;
use crate::control::{Current, Impedance, Speed};
use crate::fault::Fault;
use crate::hall::estimate::Estimator;
use crate::mode::Mode;
#[cfg(feature = "small")]
use crate::scope::Recording;
use crate::telemetry::{Measurement, Record, Reference};
use core::fmt;
use core::sync::atomic::{AtomicBool, AtomicI32, Ordering::Relaxed};
use heapless::spsc::{Consumer, Producer, Queue};

/// What a task asks the drive to do. Each is answered by one [`Reply`], in order.
#[derive(Debug)]
pub enum Command {
    /// Turn the rotor open loop and record the Halls. The model in use comes back through [`Tasks::retired`]: where none
    /// comes of this calibration, it may be installed again.
    Calibrate,
    /// Measure at standstill; to be repeated every 0.3 s (at 40 kHz), or the bridge is switched off.
    Measure {
        /// Whether a measurement begins; otherwise one goes on.
        begins: bool,
        /// What is to be measured now.
        probe: Probe,
    },
    /// Take up a new estimator; the old one comes back through [`Tasks::retired`].
    Install(&'static mut Estimator),
    /// The samples of the calibration made no model: a fault.
    CalibrationFailed,
    /// Bridge on; a rotor at rest is checked, and held at a speed of zero until something is commanded.
    Arm,
    /// Bridge off.
    Disarm,
    /// Voltage as a fraction of the largest; negative turns backward.
    Drive(Modulation),
    /// Current along q, and so a torque.
    Current(Current),
    /// Speed, reached with the largest acceleration.
    Speed(Speed),
    /// Position, reached with the largest acceleration and speed and held.
    Position(Position),
    /// A spring and a damper at the shaft; the memory of the one before comes back through [`Tasks::impedances`], and so
    /// does that of one that was refused.
    Impedance(&'static mut Impedance),
    /// Another commutation, while the bridge is off.
    Commutate(Commutation),
    /// Compensate the cogging by a table, or not; the old table comes back through [`Tasks::tables`].
    AntiCogging(Option<&'static mut cogging::Table>),
    /// Other settings, while the bridge is off. A calibration that does not fit them, for they count the other way, is
    /// given up: the drive is unarmed, and the model to be installed anew. Their memory comes back through
    /// [`Tasks::configs`], whether they were taken over or refused.
    Configure(&'static mut Config),
    /// Other bandwidths of the loops, while turning, too: of these settings nothing else is taken over. No current jumps
    /// by it. Their memory comes back through [`Tasks::configs`].
    Retune(&'static mut Config),
    /// The speed control swings the rotor by itself: its gains are those for half of the inertia that they are now, until
    /// the bridge is switched on again or others come.
    SlowDown,
    /// The winding's rise as it was measured by its resistance, as the square of the current that would make it in the long
    /// run, in 2⁻³⁰ of the full scale's: not negative. It counts where it is hotter than the model.
    #[cfg(not(feature = "small"))]
    Winding(i32),
    /// Leave the faulted state.
    Clear,
    /// A task has found a fault: off, if the bridge is on.
    Trip(Fault),
}

/// Answer to a [`Command`].
pub type Reply = Result<(), Refusal>;

/// Why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Refusal {
    /// Not in this state.
    Mode(Mode),
    /// There is no calibration: the drive must turn the rotor first.
    NotCalibrated,
    /// The Halls give no angle at the moment.
    NoAngle,
    /// The command is beyond `max_modulation`, the largest current or the largest speed.
    TooLarge,
    /// A Hall is lost: the drive must be calibrated after its repair.
    HallLost,
    /// The drive was set up without current control.
    NoControl,
    /// Armed, the drive would fail at once, with this fault.
    Fault(Fault),
    /// The rotor turns, and the bridge would short it or pull it to a standing field.
    Turning,
    /// The position is outside of `min_position_turns` to `max_position_turns`.
    OutOfBounds,
    /// The position to be at at once, or the range to stay within, is farther from the rotor than
    /// `following_error_turns`, which would be a fault.
    TooFar,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mode(Mode::Faulted(fault)) => write!(f, "faulted: {fault}"),
            Self::Mode(mode) => write!(f, "not while {mode:?}"),
            Self::NotCalibrated => write!(f, "not calibrated"),
            Self::HallLost => write!(f, "a Hall is lost: repair it and calibrate"),
            Self::NoAngle => write!(f, "the Halls give no plausible angle"),
            Self::TooLarge => write!(f, "the command is beyond the allowed"),
            Self::NoControl => write!(f, "set up without current control"),
            Self::Fault(fault) => fault.fmt(f),
            Self::Turning => write!(f, "the rotor turns: let it come to rest"),
            Self::OutOfBounds => write!(f, "the position is outside of its bounds"),
            Self::TooFar => {
                write!(f, "the position or range is too far away to be there at once: go there with a limited speed")
            }
        }
    }
}

impl core::error::Error for Refusal {}

/// Length of the queue of records; it holds one less. Half as long where RAM is scarce: the tasks then have to come
/// twice as often.
const RECORDS: usize = if cfg!(feature = "small") { 32 } else { 64 };
/// Length of the queue of measurements, of which one comes every 32 steps at most.
const MEASUREMENTS: usize = RECORDS / 4;

/// What the drive tells the tasks, which may read it at any time.
#[derive(Default)]
pub struct Told {
    strain: AtomicI32,
    speed: AtomicI32,
    complete: AtomicBool,
    turned: AtomicBool,
}

impl Told {
    const fn new() -> Self {
        Self {
            strain: AtomicI32::new(0),
            speed: AtomicI32::new(0),
            complete: AtomicBool::new(false),
            turned: AtomicBool::new(false),
        }
    }

    #[inline(always)]
    pub(super) fn tell(&self, Reference { strain, speed, complete }: Reference) {
        self.strain.store(strain, Relaxed);
        self.speed.store(speed, Relaxed);
        self.complete.store(complete, Relaxed);
    }

    /// The last reference of a spring and a damper. A part of it may be newer, by 64 steps.
    pub fn get(&self) -> Reference {
        let Self { strain, speed, complete, .. } = self;
        Reference { strain: strain.load(Relaxed), speed: speed.load(Relaxed), complete: complete.load(Relaxed) }
    }

    /// A set-point has turned the current round.
    pub(super) fn tell_turn(&self) {
        self.turned.store(true, Relaxed);
    }

    /// Whether one has since this was asked last.
    pub(crate) fn has_turned(&self) -> bool {
        let turned = self.turned.load(Relaxed);
        if turned {
            self.turned.store(false, Relaxed);
        }
        turned
    }
}

/// The queues between the interrupt and the tasks.
#[derive(Default)]
pub struct Channels {
    commands: Queue<Command, 8>,
    replies: Queue<Reply, 16>,
    records: Queue<Record, RECORDS>,
    retired: Queue<&'static mut Estimator, 8>,
    measurements: Queue<Measurement, MEASUREMENTS>,
    tables: Queue<&'static mut cogging::Table, 8>,
    configs: Queue<&'static mut Config, 8>,
    windows: Queue<Window, 4>,
    impedances: Queue<&'static mut Impedance, 4>,
    told: Told,
    /// Where there is little memory, one for the calibration's sums and the scope's rows.
    #[cfg(feature = "small")]
    recording: Recording,
}

/// The interrupt's ends of the queues.
pub struct Interrupt {
    pub(super) commands: Consumer<'static, Command, 8>,
    pub(super) replies: Producer<'static, Reply, 16>,
    pub(super) records: Producer<'static, Record, RECORDS>,
    pub(super) retired: Producer<'static, &'static mut Estimator, 8>,
    pub(super) measurements: Producer<'static, Measurement, MEASUREMENTS>,
    pub(super) tables: Producer<'static, &'static mut cogging::Table, 8>,
    pub(super) configs: Producer<'static, &'static mut Config, 8>,
    pub(super) windows: Producer<'static, Window, 4>,
    pub(super) impedances: Producer<'static, &'static mut Impedance, 4>,
    pub(super) told: &'static Told,
}

/// The tasks' ends of the queues.
pub struct Tasks {
    /// To the drive, which carries out one a step.
    pub commands: Producer<'static, Command, 8>,
    /// One for each command, in order.
    pub replies: Consumer<'static, Reply, 16>,
    /// Decimated samples; lost ones show in their sequence numbers.
    pub records: Consumer<'static, Record, RECORDS>,
    /// Estimators that the drive no longer uses.
    pub retired: Consumer<'static, &'static mut Estimator, 8>,
    /// Currents and voltages, with every record while running with current control.
    pub measurements: Consumer<'static, Measurement, MEASUREMENTS>,
    /// Tables that the drive no longer uses.
    pub tables: Consumer<'static, &'static mut cogging::Table, 8>,
    /// Settings that the drive no longer uses.
    pub configs: Consumer<'static, &'static mut Config, 8>,
    /// What was measured at standstill.
    pub windows: Consumer<'static, Window, 4>,
    /// Springs and dampers that the drive no longer uses.
    pub impedances: Consumer<'static, &'static mut Impedance, 4>,
    /// Where the reference of a spring and a damper is, and whether a set-point has turned the current round.
    pub told: &'static Told,
    /// Memory for the calibration's sums, which a scope may borrow.
    #[cfg(feature = "small")]
    pub recording: Option<&'static mut Recording>,
}

impl Channels {
    /// Empty ones.
    pub const fn new() -> Self {
        Self {
            commands: Queue::new(),
            replies: Queue::new(),
            records: Queue::new(),
            retired: Queue::new(),
            measurements: Queue::new(),
            tables: Queue::new(),
            configs: Queue::new(),
            windows: Queue::new(),
            impedances: Queue::new(),
            told: Told::new(),
            #[cfg(feature = "small")]
            recording: Recording::new(),
        }
    }

    /// Both ends.
    pub fn split(&'static mut self) -> (Interrupt, Tasks) {
        let (commands_in, commands) = self.commands.split();
        let (replies, replies_out) = self.replies.split();
        let (records, records_out) = self.records.split();
        let (retired, retired_out) = self.retired.split();
        let (measurements, measurements_out) = self.measurements.split();
        let (tables, tables_out) = self.tables.split();
        let (configs, configs_out) = self.configs.split();
        let (windows, windows_out) = self.windows.split();
        let (impedances, impedances_out) = self.impedances.split();
        (
            Interrupt {
                commands,
                replies,
                records,
                retired,
                measurements,
                tables,
                configs,
                windows,
                impedances,
                told: &self.told,
            },
            Tasks {
                commands: commands_in,
                replies: replies_out,
                records: records_out,
                retired: retired_out,
                measurements: measurements_out,
                tables: tables_out,
                configs: configs_out,
                windows: windows_out,
                impedances: impedances_out,
                told: &self.told,
                #[cfg(feature = "small")]
                recording: Some(&mut self.recording),
            },
        )
    }
}
