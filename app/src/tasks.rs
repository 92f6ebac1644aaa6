//! The state of the tasks, and what they do once a millisecond.

#[cfg(feature = "encoder")]
mod align;
mod commands;
#[cfg(feature = "diagnostic")]
mod halls;
mod procedures;
#[cfg(feature = "registers")]
mod registers;
mod rest;
mod start;
mod storage;
mod telemetry;

use crate::Identity;
use crate::adaptation::SensorAdaptation;
use crate::controller::Controller;
use crate::encoder::Encoder;
use crate::fmt::log;
use crate::history::History;
use crate::housekeeping::Readings;
use crate::magnets::MagnetMap;
use crate::procedure::Procedure;
use crate::scope::ScopeTasks;
use crate::storage::{Sensors, Storage};
use embedded_storage::nor_flash::NorFlash;
use hallservo::config::Config;
use hallservo::control::cogging::Table;
use hallservo::drive::standstill::Window;
use hallservo::drive::{Refusal, Reply};
use hallservo::fault::{Fault, Limits};
use hallservo::hall::plausibility::Implausible;
use hallservo::mode::Mode;
use hallservo::service::identify;
use hallservo::service::swings::Rough;
use hallservo::service::{Event, Service, adaptation};
use hallservo::settings::Settings;
use hallservo::telemetry::{Measurement, Record as DriveRecord};
use hallservo_protocol::{self as protocol, Activity, Calibration, Cause, Cogging, Problem, Record};
use rest::Rest;
pub(crate) use start::start;
use telemetry::Stream;

/// Ticks after a command until the records show its effect.
const SETTLED: u32 = 5;

/// The state of the tasks. What is small comes first, within reach of the short forms of the load instructions.
#[repr(C)]
pub(crate) struct Tasks<F, E> {
    /// Answers that the drive still owes and no request waits for.
    unclaimed_replies: u8,
    /// Whether the drive is to be disarmed as soon as a command has room in the queue.
    pub disarm_due: bool,
    /// Whether the model of the sensors is to be sent to the drive.
    install_due: bool,
    /// Those of before a calibration are to be taken up again.
    sensors_due: bool,
    /// Whether the drive is to be sent the table, or to stop using it.
    table_due: bool,
    /// Whether the drive compensates the cogging by the table.
    anti_cogging: bool,
    /// Whether the settings on their way differ in tunable ones only.
    retunes: bool,
    /// Whether the last command to the drive was a spring and a damper.
    follows_impedance: bool,
    /// Whether nobody has confirmed settings that are not those stored.
    pub unconfirmed: bool,
    /// Kinds of records to save when the bridge is off.
    unsaved: [bool; 3],
    reply: Option<Reply>,
    /// What is wrong with each kind of stored record.
    pub stored: [Problem; 3],
    pub service: &'static mut Service,
    adaptation: &'static mut SensorAdaptation,
    pub procedure: &'static mut Option<Procedure>,
    /// Memory for the next settings on their way to the drive.
    spare_config: Option<&'static mut Config>,
    /// Ticks since the last command, saturating.
    ticks_since_command: u32,
    lost_records: u32,
    pub garbage: u32,
    pub lost_frames: u32,
    pub now_ms: u64,
    /// The latest record of the drive.
    record: DriveRecord,
    readings: Readings,
    pub controller: Controller,
    /// [Digest](Settings::digest) of those stored.
    stored_settings: u32,
    stream: Option<Stream>,
    /// The wait for the rotor to come to rest after the last procedure.
    rest: Option<Rest>,
    learnt_saved_ms: Option<u64>,
    pub identity: Identity,
    storage: Storage<F>,
    measurement: Option<Measurement>,
    /// The last window of a measurement at standstill, until it is asked for.
    pub window: Option<Window>,
    pub magnets: MagnetMap,
    pub cogging: protocol::Procedure<Cogging>,
    pub swings: protocol::Procedure<Rough>,
    pub defaults: Settings,
    pub settings: Settings,
    sensors: Option<Sensors>,
    pub calibration: Calibration,
    pub identification: protocol::Procedure<identify::Report>,
    pub encoder: E,
    pub scope: ScopeTasks,
    /// Those of the flash; while others are being calibrated, those of before.
    stored_sensors: Option<Sensors>,
    /// Anti-cogging table, once learnt.
    table: Option<Table>,
    /// Settings that were sent to the drive and are not acknowledged yet.
    sent_settings: Option<Settings>,
    pub history: History,
}

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Everything that is due every millisecond.
    // A stack frame of its own, without the answers'.
    #[inline(never)]
    pub fn tick(&mut self, now_ms: u64, readings: Readings) {
        self.now_ms = now_ms;
        self.readings = readings;
        if self.disarm_due && self.disarm().is_ok() {
            self.abandon_reply();
        }
        self.ticks_since_command = self.ticks_since_command.saturating_add(1);
        let torque_nm = self.take_measurements();
        // Long before its first sample: the field is raised at first.
        if matches!(self.mode(), Mode::Aligning | Mode::Calibrating) {
            self.scope.give_back(self.service);
        }
        while self.next_event(torque_nm) {}
        self.magnets.tick(self.record.status, self.settings.anti_cogging);
        self.end_abandoned();
        self.window = self.service.window().or(self.window);
        self.proceed();
        self.attend_to_encoder();
        self.spare_config = self.spare_config.take().or_else(|| self.service.unused_config());
        self.end_calibration();
        self.update_drive();
        self.save();
        self.come_to_rest();
    }

    /// Takes the service's next event; false where there is none.
    #[inline(never)]
    fn next_event(&mut self, torque_nm: f32) -> bool {
        let Some(event) = &self.service.poll() else { return false };
        if let Some(procedure) = self.procedure {
            procedure.event(event);
        }
        self.encoder.event(event);
        self.handle(event, torque_nm);
        true
    }

    /// The encoder's share of a tick. The bounds of the position move with its zero.
    #[inline(always)]
    fn attend_to_encoder(&mut self) {
        if E::SETTINGS == 0 {
            return;
        }
        let mode = self.mode();
        let activity = self.encoder.activity().0;
        if self.encoder.tick(self.service, &self.settings, mode, self.now_ms) {
            self.rest = Some(Rest::after(activity, self.now_ms));
        }
        let free = self.ticks_since_command >= SETTLED && !mode.drives();
        if free && self.encoder.has_moved(&self.settings) && self.configure(&{ self.settings }).is_ok() {
            self.abandon_reply();
        }
    }

    /// Mean torque of the motor since the last tick, N·m, in the direction of the electrical angle; 0 without current
    /// sensing.
    #[inline(never)]
    fn take_measurements(&mut self) -> f32 {
        let Some(control) = self.service.config().control else { return 0.0 };
        let (mut sum, mut count) = (0.0, 0.0);
        while let Some(measurement) = self.service.measurement() {
            let measurement = self.measurement.insert(measurement);
            sum += adaptation::torque_nm(measurement, &control);
            count += 1.0;
            self.magnets.measurement(measurement, &control);
            if let Some(procedure) = self.procedure {
                procedure.measurement(measurement);
                #[cfg(feature = "map")]
                if let Some(learning) = procedure.learning() {
                    self.magnets.learn_by_pole(learning.direction(), measurement, &control);
                }
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }

    #[inline(never)]
    fn handle(&mut self, event: &Event, torque_nm: f32) {
        match event {
            Event::Reply(reply) => self.on_reply(*reply),
            // A faulted drive refuses a model, and gets it when the fault is cleared.
            Event::Installed(Err(Refusal::Mode(Mode::Faulted(_)))) => self.install_due = self.sensors.is_some(),
            // One that was made for other settings is followed by another.
            Event::Installed(_) => {}
            Event::Record(record) => self.on_record(*record, torque_nm),
            Event::Calibrated(calibrate) => {
                log!(info, "calibrated, residual {} %", calibrate.report.residual_pct);
                self.calibration = Calibration::Done(calibrate.report);
                let noise = calibrate.report.sensors.each_ref().map(|sensor| sensor.noise_pct / 200.0 * sensor.swing);
                self.sensors = Some(Sensors { model: calibrate.model, calibrated: calibrate.model, noise });
                self.unsaved[Record::Sensors as usize] = true;
                self.magnets.forget();
                self.rest = Some(Rest::after(Activity::Calibration, self.now_ms));
                self.relearn();
            }
            Event::Refused(error) => {
                log!(warn, "the calibration failed");
                self.calibration = Calibration::Failed(*error);
                // Later in this tick, where the stack is less deep.
                self.sensors_due = true;
            }
        }
    }

    fn on_record(&mut self, record: DriveRecord, torque_nm: f32) {
        let before = self.record.status.mode();
        let mode = record.status.mode();
        if mode != before {
            log!(info, "{} after {}", mode, before);
            if let Mode::Faulted(fault) = mode {
                self.history.push(self.now_ms, before, Cause::Fault(fault));
            }
        }
        if mode == before && !mode.drives() || mode == Mode::Running {
            let every = self.service.config().record_every();
            let missing = (record.sequence.wrapping_sub(self.record.sequence) + every / 2) / every;
            // A record outside of the rhythm comes early, never late.
            self.lost_records = self.lost_records.saturating_add(missing.saturating_sub(1).min(1 << 16));
        }
        if mode != Mode::Running {
            self.measurement = None;
        }
        if before == Mode::Aligning && !mode.drives() {
            // A measurement at standstill has set the model aside; a calibration leaves none here.
            self.install_due = self.sensors.is_some();
        }
        if record.status.is_heavier() && !self.record.status.is_heavier() {
            self.note(Cause::Heavier);
        }
        if record.status.is_lighter() && !self.record.status.is_lighter() {
            self.note(Cause::Lighter);
        }
        self.record = record;
        if let Some(sensors) = &self.sensors {
            self.magnets.record(&record, sensors);
        }
        if self.settings.halls == 2 {
            self.watch_two_halls(&record, torque_nm);
        }
        if let Some(cause) = self.adaptation.take(&record, torque_nm) {
            self.note(cause);
        }
    }

    /// Of two Halls nothing in the control interrupt tells whether they fit each other.
    fn watch_two_halls(&mut self, record: &DriveRecord, torque_nm: f32) {
        if let Some(sensors) = &self.sensors
            && self.adaptation.contradicts(record, sensors, torque_nm, self.service.config())
        {
            // Told again with the next record, where the queue is full.
            let _ = self.service.trip(Fault::Hall(Implausible::Inconsistent));
        }
    }

    /// Adds an incident of this moment to the history.
    fn note(&mut self, cause: Cause) {
        self.history.push(self.now_ms, self.mode(), cause);
    }

    /// Sends the drive the model or the table that is due.
    fn update_drive(&mut self) {
        // A faulted drive refuses a model; it gets it when the fault is cleared.
        if self.install_due && !matches!(self.mode(), Mode::Faulted(_)) {
            self.install();
        } else if !self.is_mapping()
            // To make an estimator takes longer than the samples of an encoder's calibration can wait.
            && self.encoder.activity().0 == Activity::None
            && let Some(sensors) = &mut self.sensors
            && let Some(model) = self.adaptation.publish(self.service, self.settings.run_on_two_halls)
        {
            sensors.model = model;
        }
        if self.table_due {
            let table = self.table.as_ref().filter(|_| self.settings.anti_cogging);
            self.table_due = self.service.set_anti_cogging(table).is_err();
            self.anti_cogging = !self.table_due && table.is_some();
        }
    }

    /// Sends the drive the model that is due.
    #[inline(never)]
    pub fn install(&mut self) {
        if let Some(sensors) = self.sensors.as_ref().filter(|_| self.install_due) {
            self.install_due = self.service.install(&sensors.model).is_err();
        }
    }

    /// The sensors are being calibrated: what was known of them is not for the new calibration, and is kept until that has
    /// succeeded, saved or not.
    pub fn set_sensors_aside(&mut self) {
        self.unsaved[Record::Sensors as usize] |= self.sensors_changed();
        (self.stored_sensors, self.install_due) = (self.sensors.take(), false);
        self.magnets.set_aside();
        self.relearn();
    }

    /// Restarts the adaptation from the model in use.
    #[inline(never)]
    pub fn relearn(&mut self) {
        let every = self.service.config().record_every();
        let unevenness = self.magnets.unevenness();
        self.adaptation.restart(&self.settings, self.sensors.as_ref(), unevenness, every);
    }

    /// Whether the cogging has been learnt.
    pub const fn has_table(&self) -> bool {
        self.table.is_some()
    }

    pub fn mode(&self) -> Mode {
        self.record.status.mode()
    }

    pub const fn limits(&self) -> Limits {
        self.record.status.limits()
    }

    /// Control periods a second.
    pub fn step_hz(&self) -> f32 {
        self.settings.pwm_hz
    }
}
