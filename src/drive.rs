//! Everything that the control interrupt does: one [`Sample`] in, one [`Output`] out.
//!
//! The interrupt owns a [`Drive`] and calls [`Drive::step`] once a PWM period. Tasks talk to it through the lock-free queues
//! of [`Channels`] only: commands in; replies, records and used-up estimators out. Large parameters travel as
//! references, so a calibration is taken up between two steps by swapping a pointer.

pub mod drag;

use crate::angle::ElectricalAngle;
use crate::commutation::block::Sextant;
use crate::commutation::sinusoidal::{self, Axes, PhaseOrder};
use crate::commutation::{Commutation, Legs, Modulation, Output};
use crate::fault::{Fault, Limits};
use crate::hall::Codes;
use crate::hall::estimate::Estimator;
use crate::hall::normalize::Implausible;
use crate::hall::track::Tracker;
use crate::mode::{Event, Mode};
use crate::pwm::Amplitude;
use crate::settings::Config;
use crate::telemetry::{Progress, Record};
use core::fmt;
use drag::{Drag, Stage};
use heapless::spsc::{Consumer, Producer, Queue};

/// What the ADCs delivered at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// The three Halls.
    pub halls: Codes,
}

/// What a task asks the drive to do. Each is answered by one [`Reply`], in order.
#[derive(Debug)]
pub enum Command {
    /// Turn the rotor open loop and record the Halls.
    Calibrate,
    /// Take up a new estimator; the old one comes back through [`Tasks::retired`].
    Install(&'static mut Estimator),
    /// The samples of the calibration made no model: a fault.
    CalibrationFailed,
    /// Bridge on, command zero.
    Arm,
    /// Bridge off.
    Disarm,
    /// Voltage as a fraction of the largest; negative turns backward.
    Drive(Modulation),
    /// Leave the faulted state.
    Clear,
}

/// Answer to a [`Command`].
pub type Reply = Result<(), Refusal>;

/// Why a command was not obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Not in this state.
    Mode(Mode),
    /// There is no calibration: the drive must turn the rotor first.
    NotCalibrated,
    /// The Halls give no angle at the moment.
    NoAngle,
    /// The command is beyond `max_modulation`.
    TooLarge,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mode(Mode::Faulted(fault)) => write!(f, "faulted: {fault}"),
            Self::Mode(mode) => write!(f, "not while {mode:?}"),
            Self::NotCalibrated => write!(f, "not calibrated"),
            Self::NoAngle => write!(f, "the Halls give no plausible angle"),
            Self::TooLarge => write!(f, "the command is beyond the allowed modulation"),
        }
    }
}

impl core::error::Error for Refusal {}

/// Records that fit between two looks of a task, less one.
const RECORDS: usize = 64;

/// The queues between the interrupt and the tasks.
#[derive(Default)]
pub struct Channels {
    commands: Queue<Command, 8>,
    replies: Queue<Reply, 16>,
    records: Queue<Record, RECORDS>,
    retired: Queue<&'static mut Estimator, 8>,
}

/// The interrupt's ends of the queues.
pub struct Interrupt {
    commands: Consumer<'static, Command, 8>,
    replies: Producer<'static, Reply, 16>,
    records: Producer<'static, Record, RECORDS>,
    retired: Producer<'static, &'static mut Estimator, 8>,
}

/// The tasks' ends of the queues.
pub struct Tasks {
    /// To the drive; one is obeyed a step.
    pub commands: Producer<'static, Command, 8>,
    /// One for each command, in order.
    pub replies: Consumer<'static, Reply, 16>,
    /// Decimated samples; lost ones show in their sequence numbers.
    pub records: Consumer<'static, Record, RECORDS>,
    /// Estimators that the drive no longer uses.
    pub retired: Consumer<'static, &'static mut Estimator, 8>,
}

impl Channels {
    /// Empty ones.
    pub const fn new() -> Self {
        Self { commands: Queue::new(), replies: Queue::new(), records: Queue::new(), retired: Queue::new() }
    }

    /// Both ends.
    pub fn split(&'static mut self) -> (Interrupt, Tasks) {
        let (commands_in, commands) = self.commands.split();
        let (replies, replies_out) = self.replies.split();
        let (records, records_out) = self.records.split();
        let (retired, retired_out) = self.retired.split();
        (
            Interrupt { commands, replies, records, retired },
            Tasks { commands: commands_in, replies: replies_out, records: records_out, retired: retired_out },
        )
    }
}

/// The drive.
pub struct Drive {
    config: Config,
    channels: Interrupt,
    estimator: Option<&'static mut Estimator>,
    tracker: Tracker,
    /// Successive samples without a plausible angle.
    missed: u32,
    mode: Mode,
    limits: Limits,
    amplitude: Amplitude,
    /// The same, for the sinusoidal commutation.
    axes: Axes,
    /// From the rotor to the field: a quarter turn and the phase advance.
    lead: ElectricalAngle,
    /// Where block commutation stands.
    sextant: Sextant,
    drag: Drag,
    sequence: u32,
    until_record: u32,
}

impl Drive {
    /// Unarmed and without a calibration.
    pub const fn new(config: Config, channels: Interrupt) -> Self {
        Self {
            drag: Drag::OFF,
            config,
            channels,
            estimator: None,
            tracker: Tracker::at(ElectricalAngle::ZERO),
            missed: 0,
            mode: Mode::Unarmed,
            limits: Limits::NONE,
            amplitude: Amplitude::ZERO,
            axes: Axes::new(Amplitude::ZERO, config.order(), config.limits.half()),
            lead: ElectricalAngle::QUARTER,
            sextant: Sextant::First,
            sequence: 0,
            until_record: 1,
        }
    }

    /// One PWM period. What it returns is to be written to the preloaded compare registers at once; if the bridge is to
    /// be off, it must be switched off at once.
    #[inline]
    pub fn step(&mut self, sample: &Sample) -> Output {
        if let Some(command) = self.channels.commands.dequeue() {
            let reply = self.obey(command, sample);
            // A task that reads no replies does not get any.
            let _ = self.channels.replies.enqueue(reply);
        }
        self.measure(&sample.halls);
        // First the one that is in a hurry: told apart by a comparison, without decoding the mode.
        if matches!(self.mode, Mode::Running) {
            self.report(sample);
            self.commutate()
        } else {
            self.off(sample)
        }
    }

    /// A step with the bridge off, or calibrating.
    #[cold]
    #[inline(never)]
    fn off(&mut self, sample: &Sample) -> Output {
        if matches!(self.mode, Mode::Aligning | Mode::Calibrating) {
            self.calibrate(sample)
        } else {
            self.report(sample);
            Output::OFF
        }
    }

    /// A record to the tasks, when it is time.
    #[inline(always)]
    fn report(&mut self, sample: &Sample) {
        self.sequence = self.sequence.wrapping_add(1);
        self.until_record = self.until_record.wrapping_sub(1);
        if self.until_record == 0 {
            self.until_record = self.config.record_every;
            let progress = if self.drag.is_done() { Progress::Complete } else { Progress::None };
            self.record(sample, progress, self.tracker.angle());
        }
    }

    /// Angle and speed from the Halls.
    #[inline(always)]
    fn measure(&mut self, codes: &Codes) {
        let Some(estimator) = &self.estimator else { return };
        match estimator.angle(codes) {
            Ok(angle) => {
                if self.tracker.step(&self.config.tracking, angle).is_err() {
                    self.jumped(angle);
                } else if self.missed != 0 {
                    self.missed = 0;
                    self.limits = self.limits.without(Limits::EXTRAPOLATED);
                }
                if self.tracker.speed().wrapping_add(self.config.fastest) as u32 > 2 * self.config.fastest as u32 {
                    self.fail(Fault::OverSpeed);
                }
            }
            Err(why) => self.blind(why),
        }
    }

    /// The codes are no angle.
    #[cold]
    fn blind(&mut self, why: Implausible) {
        self.tracker.coast();
        if !self.miss(Fault::Hall(why)) && !self.mode.drives() {
            // Nothing is known of the rotor, so it is not turned on and on.
            self.tracker = Tracker::at(self.tracker.angle());
        }
    }

    /// The angle is not where the rotor can be.
    #[cold]
    fn jumped(&mut self, angle: ElectricalAngle) {
        if !self.miss(Fault::AngleJump) && !self.mode.drives() {
            // While nothing is driven, believe what comes again and again.
            self.tracker = Tracker::at(angle);
            self.missed = 0;
        }
    }

    /// Counts a miss; false when they are too many. Then a running drive fails.
    fn miss(&mut self, fault: Fault) -> bool {
        self.missed = self.missed.saturating_add(1);
        self.limits = self.limits.with(Limits::EXTRAPOLATED);
        let tolerable = self.missed <= self.config.tolerated;
        if !tolerable && self.mode == Mode::Running {
            self.fail(fault);
        }
        tolerable
    }

    /// Latches a fault where the bridge is on.
    #[cold]
    fn fail(&mut self, fault: Fault) {
        if let Some(mode) = self.mode.after(Event::Fail(fault)) {
            self.mode = mode;
            self.set_amplitude(Amplitude::ZERO);
        }
    }

    /// The field ahead of the rotor.
    #[inline(always)]
    fn commutate(&mut self) -> Output {
        let vector = self.tracker.predicted(&self.config.tracking) + self.lead;
        match self.config.commutation {
            Commutation::Sinusoidal => Output { compare: sinusoidal::compare(vector, &self.axes), legs: Legs::ALL },
            Commutation::Block => self.block(vector),
        }
    }

    #[inline(never)]
    fn block(&mut self, vector: ElectricalAngle) -> Output {
        self.sextant = self.sextant.follow(vector);
        self.sextant.output(self.config.order(), self.amplitude, self.config.limits.half())
    }

    fn set_amplitude(&mut self, amplitude: Amplitude) {
        self.amplitude = amplitude;
        self.axes = Axes::new(amplitude, self.config.order(), self.config.limits.half());
    }

    /// A step of the calibration's motion.
    fn calibrate(&mut self, sample: &Sample) -> Output {
        self.sequence = self.sequence.wrapping_add(1);
        // The field that acts while this sample is taken.
        let field = self.drag.field();
        let stage = self.drag.step(&self.config.drag);
        let progress = match stage {
            Stage::Rise | Stage::Stand(_) => Progress::None,
            Stage::Settle(_) => {
                self.on(Event::Aligned);
                Progress::None
            }
            Stage::Record(sweep) => Progress::Sample(sweep),
            Stage::Done => {
                self.on(Event::Swept);
                self.record(sample, Progress::Complete, field);
                return Output::OFF;
            }
        };
        self.until_record = self.until_record.wrapping_sub(1);
        if self.until_record == 0 {
            self.until_record = self.config.calibration_record_every;
            self.record(sample, progress, field);
        }
        let amplitude = self.config.limits.amplitude(self.drag.modulation());
        let axes = Axes::new(amplitude, PhaseOrder::FORWARD, self.config.limits.half());
        Output { compare: sinusoidal::compare(self.drag.field(), &axes), legs: Legs::ALL }
    }

    /// To the tasks; when they do not keep up, the record is lost.
    #[inline(always)]
    fn record(&mut self, sample: &Sample, calibration: Progress, angle: ElectricalAngle) {
        let record = Record {
            sequence: self.sequence,
            codes: sample.halls,
            mode: self.mode,
            limits: self.limits,
            calibration,
            angle,
            speed: self.tracker.speed(),
            position: self.tracker.position(),
        };
        let _ = self.channels.records.enqueue(record);
    }

    #[cold]
    #[inline(never)]
    fn obey(&mut self, command: Command, sample: &Sample) -> Reply {
        match command {
            Command::Calibrate => {
                self.on_command(Event::Calibrate)?;
                self.drag = Drag::OFF;
            }
            Command::Install(estimator) => self.install(estimator, sample)?,
            Command::CalibrationFailed => self.on_command(Event::Fail(Fault::Calibration))?,
            Command::Arm => self.arm()?,
            Command::Disarm => {
                self.on_command(Event::Disarm)?;
                self.set_amplitude(Amplitude::ZERO);
            }
            Command::Drive(modulation) => self.drive(modulation)?,
            Command::Clear => self.on_command(Event::Clear { calibrated: self.estimator.is_some() })?,
        }
        Ok(())
    }

    fn install(&mut self, estimator: &'static mut Estimator, sample: &Sample) -> Reply {
        let allowed = self.on_command(Event::Installed);
        let unused = if allowed.is_ok() { self.estimator.replace(estimator) } else { Some(estimator) };
        if let Some(unused) = unused {
            // The queue holds more than there are estimators in a sane drive; beyond, one is leaked, not lost track of.
            let _ = self.channels.retired.enqueue(unused);
        }
        if allowed.is_ok() && self.mode == Mode::Ready {
            self.relock(sample);
        }
        allowed
    }

    /// Starts to track anew where the rotor is.
    fn relock(&mut self, sample: &Sample) {
        let angle = self.estimator.as_ref().and_then(|estimator| estimator.angle(&sample.halls).ok());
        self.missed = if angle.is_some() { 0 } else { self.config.tolerated.saturating_add(1) };
        self.tracker = Tracker::at(angle.unwrap_or(ElectricalAngle::ZERO));
    }

    fn arm(&mut self) -> Reply {
        match self.mode {
            Mode::Unarmed => Err(Refusal::NotCalibrated),
            Mode::Ready if self.missed != 0 => Err(Refusal::NoAngle),
            _ => {
                self.set_amplitude(Amplitude::ZERO);
                self.on_command(Event::Arm)
            }
        }
    }

    fn drive(&mut self, modulation: Modulation) -> Reply {
        if self.mode != Mode::Running {
            return Err(Refusal::Mode(self.mode));
        }
        let magnitude = i32::from(modulation.to_bits()).unsigned_abs();
        if magnitude > i32::from(self.config.max_modulation.to_bits()).unsigned_abs() {
            return Err(Refusal::TooLarge);
        }
        self.set_amplitude(self.config.limits.amplitude(modulation));
        let cut = self.config.limits.limits(modulation);
        self.limits = if cut { self.limits.with(Limits::DUTY) } else { self.limits.without(Limits::DUTY) };
        // A negative amplitude turns the field by half a turn; its advance is in the direction of the command, too.
        let advance = if modulation.is_negative() { -self.config.advance } else { self.config.advance };
        self.lead = ElectricalAngle::QUARTER + advance;
        Ok(())
    }

    fn on(&mut self, event: Event) {
        if let Some(mode) = self.mode.after(event) {
            self.mode = mode;
            self.until_record = 1;
        }
    }

    fn on_command(&mut self, event: Event) -> Reply {
        let mode = self.mode.after(event).ok_or(Refusal::Mode(self.mode))?;
        self.mode = mode;
        Ok(())
    }

    /// The state.
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// What holds the drive back.
    pub const fn limits(&self) -> Limits {
        self.limits
    }

    /// Angle, speed and turns.
    pub const fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The estimator in use.
    pub fn estimator(&self) -> Option<&Estimator> {
        self.estimator.as_deref()
    }
}
