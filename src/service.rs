//! The low-rate side of a drive: collects the calibration's samples, fits the model and installs it.

mod absolute;
pub mod adaptation;
mod back_emf;
#[cfg(not(feature = "small"))]
pub mod by_pole;
pub mod coil;
pub mod commission;
pub mod encoder;
mod hunting;
pub mod identification;
pub mod identify;
mod impedance;
pub mod learning;
pub mod magnets;
pub mod mapping;
mod phases;
pub mod pole_pairs;
pub mod procedure;
mod sequence;
pub mod standstill;
pub mod swings;
#[cfg(not(feature = "small"))]
mod winding;

use crate::commutation::Commutation;
use crate::config::Config;
#[cfg(not(feature = "small"))]
use crate::control::config::COPPER_PER_K;
use crate::control::{Impedance, cogging};
use crate::drive::standstill::Window;
use crate::drive::{Command, Reply, Tasks};
use crate::fault::Fault;
use crate::hall::calibrate::{self, Calibration, Collector, Sweep};
use crate::hall::estimate::{BadModel, Estimator};
use crate::hall::model::Model;
use crate::hall::{Channel, Halls};
use crate::math::high;
use crate::mode::Mode;
use crate::scope::Recording;
use crate::telemetry::{Measurement, Progress, Record};
use back_emf::BackEmf;
use core::fmt;
use heapless::{Deque, Vec};
use hunting::Hunting;
use phases::Phases;
#[cfg(not(feature = "small"))]
use winding::Winding;

/// What [`Service::poll`] delivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A command was answered.
    Reply(Reply),
    /// The drive's answer to a model that was sent.
    Installed(Reply),
    /// One sample and what became of it.
    Record(Record),
    /// The calibration succeeded; its model is on the way to the drive.
    Calibrated(Calibration),
    /// The calibration failed, and the drive becomes faulted.
    Refused(calibrate::Error),
}

/// Why a model or a table was not sent to the drive.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum InstallError {
    /// No memory is free or the command queue is full: try again after the drive's next step.
    Busy,
    /// No estimator can be made of the model.
    Model(BadModel),
}

impl fmt::Display for InstallError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => write!(f, "the drive has not taken up the last parameters yet"),
            Self::Model(bad) => bad.fmt(f),
        }
    }
}

impl core::error::Error for InstallError {}

/// A command was not sent: seven are queued that the drive has not taken up yet. It takes one a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct QueueFull;

impl fmt::Display for QueueFull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the queue of commands to the drive is full")
    }
}

impl core::error::Error for QueueFull {}

/// Percentage of lost samples from which on they are why a calibration failed.
const MANY_LOST: u8 = 10;

/// Serves one drive; 2.7 KiB beside the two estimators.
pub struct Service {
    tasks: Tasks,
    #[cfg(not(feature = "small"))]
    collector: Collector,
    /// Without, while a scope has the memory.
    #[cfg(feature = "small")]
    collector: Option<Collector<&'static mut Recording>>,
    /// Whether a calibration has begun to turn the rotor and is not over.
    turns: bool,
    /// Samples of the calibration at work.
    collected: u32,
    /// Estimators that the drive does not use.
    spares: Vec<&'static mut Estimator, 2>,
    /// Commands that are not answered yet.
    unanswered: Deque<Origin, 16>,
    /// The drive's answer to a procedure.
    answer: Option<Reply>,
    /// Tables that the drive does not use.
    tables: Vec<&'static mut cogging::Table, 2>,
    /// Springs and dampers that the drive does not use.
    impedances: Vec<&'static mut Impedance, 2>,
    /// Settings that the drive works with.
    config: Config,
    /// Whether settings are on their way to the drive.
    configures: bool,
    /// The memory of settings that the drive has answered.
    unused_config: Option<&'static mut Config>,
    /// Commutation that was commanded last.
    commutation: Commutation,
    phases: Phases,
    back_emf: BackEmf,
    hunting: Hunting,
    #[cfg(not(feature = "small"))]
    winding: Winding,
}

/// Where a command comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    User,
    Calibration,
    Install,
    Configure,
    Retune,
    Supervision,
    Procedure,
}

impl Service {
    /// For the tasks' end of a drive's channels. One of the estimators can be filled while the drive uses the other.
    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub fn new(
        config: Config,
        #[cfg(feature = "small")] mut tasks: Tasks,
        #[cfg(not(feature = "small"))] tasks: Tasks,
        estimators: [&'static mut Estimator; 2],
    ) -> Self {
        #[cfg(not(feature = "small"))]
        let collector = Collector::new(config.adc_bits);
        #[cfg(feature = "small")]
        let collector = tasks.recording.take().map(|memory| Collector::with(config.adc_bits, memory));
        let spares = Vec::from_iter(estimators);
        Self {
            tasks,
            collector,
            turns: false,
            collected: 0,
            spares,
            unanswered: Deque::new(),
            answer: None,
            tables: Vec::new(),
            impedances: Vec::new(),
            config,
            configures: false,
            unused_config: None,
            commutation: config.commutation,
            phases: Phases::default(),
            back_emf: BackEmf::default(),
            hunting: Hunting::NONE,
            #[cfg(not(feature = "small"))]
            winding: Winding::default(),
        }
    }

    /// Sends a command; its answer is a later [`Event::Reply`].
    ///
    /// # Errors
    /// [`QueueFull`]; memory that the command carried is lost then, so send it by [`Self::configure`],
    /// [`Self::install`] or [`Self::set_anti_cogging`].
    pub fn send(&mut self, command: Command) -> Result<(), QueueFull> {
        let origin = if matches!(command, Command::Calibrate) { Origin::Calibration } else { Origin::User };
        self.enqueue(command, origin).map_err(|_| QueueFull)
    }

    /// Makes a running drive fail.
    ///
    /// # Errors
    /// The command, when the queue is full.
    pub fn trip(&mut self, fault: Fault) -> Result<(), Command> {
        self.send_internal(Command::Trip(fault))
    }

    /// Sends a command whose answer is not reported.
    pub(crate) fn send_internal(&mut self, command: Command) -> Result<(), Command> {
        self.enqueue(command, Origin::Supervision)
    }

    /// Sends a command of a [procedure], which gets the answer by [`Self::procedure_answer`].
    pub(crate) fn send_for_procedure(&mut self, command: Command) -> Result<(), Command> {
        self.enqueue(command, Origin::Procedure)
    }

    pub(crate) const fn procedure_answer(&mut self) -> Option<Reply> {
        self.answer.take()
    }

    fn enqueue(&mut self, command: Command, origin: Origin) -> Result<(), Command> {
        if self.unanswered.is_full() {
            return Err(command);
        }
        let commutation = if let Command::Commutate(commutation) = command { commutation } else { self.commutation };
        self.tasks.commands.enqueue(command)?;
        self.commutation = commutation;
        let _ = self.unanswered.push_back(origin);
        Ok(())
    }

    /// Sends other settings, which a drive takes up while its bridge is off; its answer is a later [`Event::Reply`].
    ///
    /// # Errors
    /// The settings themselves, when others are on their way or seven commands are queued already.
    pub fn configure(&mut self, config: &'static mut Config) -> Result<(), &'static mut Config> {
        self.send_config(config, Command::Configure, Origin::Configure)
    }

    /// Sends settings that differ from those of now in [tunable](crate::settings::Entry::is_tunable) ones, which a drive takes up
    /// while it turns, too; its answer is a later [`Event::Reply`].
    ///
    /// # Errors
    /// As [`Self::configure`].
    pub fn retune(&mut self, config: &'static mut Config) -> Result<(), &'static mut Config> {
        self.hunting = Hunting::NONE;
        self.send_config(config, Command::Retune, Origin::Retune)
    }

    fn send_config(
        &mut self,
        config: &'static mut Config,
        command: fn(&'static mut Config) -> Command,
        origin: Origin,
    ) -> Result<(), &'static mut Config> {
        if self.configures {
            return Err(config);
        }
        match self.enqueue(command(config), origin) {
            Err(Command::Configure(config) | Command::Retune(config)) => Err(config),
            _ => {
                self.configures = true;
                Ok(())
            }
        }
    }

    /// The memory of settings that the drive has taken over or refused, until it answers to others.
    pub const fn unused_config(&mut self) -> Option<&'static mut Config> {
        self.unused_config.take()
    }

    /// The drive has answered to settings, and given them back as they were.
    fn configured(&mut self, origin: Origin, reply: Reply) {
        self.configures = false;
        self.unused_config = self.tasks.configs.dequeue();
        match &self.unused_config {
            Some(config) if reply.is_ok() && origin == Origin::Configure => self.config = **config,
            Some(config) if reply.is_ok() => self.config.retune(config),
            _ => {}
        }
        if origin == Origin::Configure {
            #[cfg(not(feature = "small"))]
            {
                self.winding = Winding::default();
            }
            self.commutation = self.config.commutation;
        }
    }

    /// The settings that the drive works with.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Makes an estimator of a model, for the direction that the settings say, and sends it to the drive, which takes
    /// it up between two steps.
    ///
    /// # Errors
    /// [`InstallError`]; nothing has changed then.
    pub fn install(&mut self, model: &Model) -> Result<(), InstallError> {
        self.send_estimator(None, model)
    }

    /// The same for the two Halls that are left when one is lost.
    ///
    /// # Errors
    /// [`InstallError`]; nothing has changed then.
    pub fn install_without(&mut self, lost: Channel, model: &Model) -> Result<(), InstallError> {
        self.send_estimator(Some(lost), model)
    }

    /// As the settings have the direction and the number of the sensors.
    fn directed(&self, model: &Model) -> Model {
        let directed = Model { reversed: self.config.is_reversed(), ..*model };
        match self.config.halls {
            Halls::Two => directed.of_two(),
            Halls::Three => directed,
        }
    }

    /// Without a Hall where one is lost.
    #[inline(never)]
    fn send_estimator(&mut self, lost: Option<Channel>, model: &Model) -> Result<(), InstallError> {
        let (model, adc_bits) = (self.directed(model), self.config.adc_bits);
        self.reclaim();
        let spare = self.spares.pop().ok_or(InstallError::Busy)?;
        if let Err(bad) = spare.rebuild(&model, adc_bits, lost) {
            let _ = self.spares.push(spare);
            return Err(InstallError::Model(bad));
        }
        if let Err(Command::Install(spare)) = self.enqueue(Command::Install(spare), Origin::Install) {
            let _ = self.spares.push(spare);
            return Err(InstallError::Busy);
        }
        Ok(())
    }

    /// The next measurement of currents and voltages, while running with current control. When nobody takes them, they
    /// are lost.
    pub fn measurement(&mut self) -> Option<Measurement> {
        let measurement = self.tasks.measurements.dequeue()?;
        if self.tasks.told.has_turned() {
            self.phases.begin_following();
            self.back_emf = BackEmf::default();
            self.hunting = Hunting::NONE;
        }
        if self.commutation != Commutation::Block
            && let Some(control) = &self.config.control
            && let speed = measurement.rotor.speed()
            && let elsewhere = self.back_emf.look(&measurement.state, speed, control)
            && let induced = high(speed, control.motion.model.flux)
            && let Some(fault) = self
                .phases
                .look(&measurement, self.config.is_reversed(), induced)
                .or(elsewhere.then_some(Fault::Commutation))
        {
            // Found again, where the queue is full.
            let _ = self.trip(fault);
            (self.phases, self.back_emf) = (Phases::default(), BackEmf::default());
        }
        if let Some(control) = &self.config.control
            && self.hunting.look(measurement.state.current_reference, control.max_current, measurement.rotor.position())
        {
            // Found again, where the queue is full.
            let _ = self.send_internal(Command::SlowDown);
        }
        #[cfg(not(feature = "small"))]
        self.look_at_winding(&measurement);
        Some(measurement)
    }

    #[cfg(not(feature = "small"))]
    fn look_at_winding(&mut self, measurement: &Measurement) {
        if self.commutation == Commutation::FieldOriented
            && let Some(control) = &self.config.control
            && let Some(square) =
                self.winding.look(&measurement.state, measurement.rotor.speed(), &control.overload.copper)
        {
            // Measured again, where the queue is full.
            let _ = self.send_internal(Command::Winding(square));
        }
    }

    /// How much warmer the winding was than when `resistance_ohm` was measured, K, when its resistance told it last; `None`
    /// where that is not measured (`max_winding_rise_k`), or was not yet.
    #[cfg(not(feature = "small"))]
    pub fn winding_rise_k(&self) -> Option<f32> {
        self.winding.risen.map(|risen| risen / COPPER_PER_K)
    }

    /// The next window of a measurement at standstill.
    pub fn window(&mut self) -> Option<Window> {
        self.tasks.windows.dequeue()
    }

    /// Adds memory for a table of anti-cogging currents; with two, one can be filled while the drive uses the other.
    /// Gives the memory back where there are two already.
    pub fn add_table(&mut self, table: &'static mut cogging::Table) -> Option<&'static mut cogging::Table> {
        self.tables.push(table).err()
    }

    /// Lets the drive compensate the cogging by a table, copied to memory that was [added](Self::add_table); `None`
    /// ends the compensation.
    ///
    /// # Errors
    /// [`InstallError::Busy`]: no table is left or the queue is full; nothing has changed then.
    pub fn set_anti_cogging(&mut self, table: Option<&cogging::Table>) -> Result<(), InstallError> {
        while !self.tables.is_full()
            && let Some(table) = self.tasks.tables.dequeue()
        {
            let _ = self.tables.push(table);
        }
        let place = match table {
            None => None,
            Some(table) => {
                let place = self.tables.pop().ok_or(InstallError::Busy)?;
                *place = *table;
                Some(place)
            }
        };
        self.send_internal(Command::AntiCogging(place)).map_err(|refused| {
            if let Command::AntiCogging(Some(place)) = refused {
                let _ = self.tables.push(place);
            }
            InstallError::Busy
        })
    }

    fn reclaim(&mut self) {
        while let Some(estimator) = self.tasks.retired.dequeue() {
            let _ = self.spares.push(estimator);
        }
    }

    /// The next thing that happened; to be called until it is `None`, at least every
    /// 63 records. After a calibration's last sample the fit runs in here, for some ten million instructions.
    pub fn poll(&mut self) -> Option<Event> {
        while let Some(reply) = self.tasks.replies.dequeue() {
            match self.unanswered.pop_front() {
                Some(Origin::Install) => return Some(Event::Installed(reply)),
                Some(origin @ (Origin::Configure | Origin::Retune)) => {
                    self.configured(origin, reply);
                    return Some(Event::Reply(reply));
                }
                Some(Origin::Calibration) => {
                    // A refused one leaves the calibration at work as it is.
                    if reply.is_ok() {
                        (self.turns, self.collected) = (false, 0);
                    }
                    return Some(Event::Reply(reply));
                }
                Some(Origin::Supervision) => {}
                Some(Origin::Procedure) => self.answer = Some(reply),
                Some(Origin::User) | None => return Some(Event::Reply(reply)),
            }
        }
        let record = self.tasks.records.dequeue()?;
        Some(match record.status.progress() {
            Progress::Sample(sweep) => {
                self.collect(sweep, &record);
                (self.turns, self.collected) = (true, self.collected + 1);
                Event::Record(record)
            }
            Progress::Complete if self.turns => self.finish(),
            Progress::None if record.status.mode() == Mode::Aligning => {
                (self.turns, self.collected) = (true, 0);
                Event::Record(record)
            }
            _ => Event::Record(record),
        })
    }

    #[cfg(not(feature = "small"))]
    const fn collector(&mut self) -> Option<&mut Collector> {
        Some(&mut self.collector)
    }

    #[cfg(feature = "small")]
    const fn collector(&mut self) -> Option<&mut Collector<&'static mut Recording>> {
        self.collector.as_mut()
    }

    /// Lends the memory of the calibration's sums, where it is a scope's as well ([`BORROWS`](crate::scope::BORROWS)),
    /// unless the sums are being made.
    pub fn lend(&mut self) -> Option<&'static mut Recording> {
        #[cfg(feature = "small")]
        if !self.turns
            && let Some(collector) = self.collector.take()
        {
            return Some(collector.into_memory());
        }
        None
    }

    /// Takes the memory back that was [lent](Self::lend): a calibration needs it before its first sample.
    pub fn take_back(&mut self, recording: &'static mut Recording) {
        #[cfg(feature = "small")]
        {
            self.collector = Some(Collector::with(self.config.adc_bits, recording));
        }
        #[cfg(not(feature = "small"))]
        let _ = recording;
    }

    /// A calibration was broken off: its sums are nobody's, and their memory may be [lent](Self::lend) again.
    pub const fn give_up_calibration(&mut self) {
        (self.turns, self.collected) = (false, 0);
    }

    fn collect(&mut self, sweep: Sweep, record: &Record) {
        let (first, bits) = (self.collected == 0, self.config.adc_bits);
        if let Some(collector) = self.collector() {
            if first {
                collector.clear(bits);
            }
            collector.push(sweep, record.rotor.angle(), &record.codes, record.sequence);
        }
    }

    #[inline(never)]
    fn finish(&mut self) -> Event {
        let lost = self.config.calibration_records().saturating_sub(self.collected);
        let lost_pct = (100 * lost / self.config.calibration_records().max(1)) as u8;
        let (bits, halls, reversed) = (self.config.adc_bits, self.config.halls, self.config.is_reversed());
        let none = self.collected == 0;
        (self.turns, self.collected) = (false, 0);
        let found = self.collector().map_or(Err(calibrate::Error::Busy), |collector| {
            if none {
                collector.clear(bits);
            }
            collector.finish(halls, reversed)
        });
        let result = found.and_then(|calibration| match self.install(&calibration.model) {
            Ok(()) => Ok(calibration),
            Err(InstallError::Model(bad)) => Err(calibrate::Error::Model(bad)),
            Err(InstallError::Busy) => Err(calibrate::Error::Busy),
        });
        match result {
            Ok(calibration) => Event::Calibrated(calibration),
            Err(error) => {
                // Where many are missing, nothing else is worth telling.
                let lost = calibrate::Error::SamplesLost { percent: lost_pct };
                let error = if lost_pct >= MANY_LOST { lost } else { error };
                // The queue has room: the drive takes one command a step, and nobody sends seven a step.
                let _ = self.send_internal(Command::CalibrationFailed);
                Event::Refused(error)
            }
        }
    }

    /// How much of the calibration's samples are collected, 0 to 1.
    pub fn progress(&self) -> f32 {
        self.collected as f32 / self.config.calibration_records().max(1) as f32
    }
}
