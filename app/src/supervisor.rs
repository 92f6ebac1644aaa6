//! What the tasks know of the drive, and what they do once a millisecond.

use crate::fmt::say;
use crate::heartbeat::Sensed;
use crate::history::History;
use crate::learning::{Learning, NOISE};
use crate::saving::{REST_S, Saving, differ};
use crate::settings::Settings;
use crate::{Identity, Memory, measure, wire};
use core::f32::consts::TAU;
use embedded_storage::nor_flash::NorFlash;
use hallservo::drive::{Command, Drive};
use hallservo::hall::estimate;
use hallservo::hall::model::Model;
use hallservo::mode::Mode;
use hallservo::service::{Event, Service};
use hallservo::settings::{self, Config};
use hallservo::storage::{LONGEST, calibration};
use hallservo::telemetry::{Measurement, Record as Live};
use hallservo_protocol::{Activity, Calibration, CalibrationError, Cause, Problem, Record, Refusal, Status, Telemetry};

/// Ticks after a command from which on the records tell what it did.
pub(crate) const SETTLED: u32 = 5;

/// Telemetry that was asked for.
#[derive(Clone, Copy)]
struct Stream {
    id: u16,
    /// Frames a tick, and what is left of them.
    rate: f32,
    due: f32,
    number: u32,
}

/// Everything in the tasks' hands.
pub(crate) struct Supervisor<F> {
    pub identity: Identity,
    pub service: Service,
    pub history: History,
    pub defaults: Settings,
    pub settings: Settings,
    /// Those that the drive is asked to take up.
    coming: Option<Settings>,
    /// Memory for them.
    spare: Option<&'static mut Config>,
    saving: Saving<F>,
    stored: [Problem; 3],
    stored_model: Option<Model>,
    stored_settings: Settings,
    /// What is to be saved when the bridge is off.
    waiting: [bool; 3],
    learnt_saved_ms: Option<u64>,
    model: Option<Model>,
    /// The drive has to be given the model once more.
    install: bool,
    noise_codes: [f32; 3],
    learning: Learning,
    pub calibration: Calibration,
    live: Live,
    measurement: Option<Measurement>,
    sensed: Sensed,
    reply: Option<Result<(), Refusal<'static>>>,
    /// Whether nobody waits for the drive's next answer any more.
    late: bool,
    pub since_command: u32,
    stream: Option<Stream>,
    lost_records: u32,
    pub garbage: u32,
    pub lost_frames: u32,
    now_ms: u64,
}

impl<F: NorFlash> Supervisor<F> {
    pub fn start(
        identity: Identity,
        defaults: settings::Settings,
        flash: F,
        place: u32,
        memory: &'static mut Memory,
    ) -> (Drive, Self) {
        let defaults = Settings::new(defaults);
        let mut saving = Saving::new(flash, place);
        let (settings, settings_problem) = stored_settings(&mut saving, &defaults);
        let config = match settings.validate() {
            Ok(config) => config,
            Err(_) => panic!("the board's default settings are invalid"),
        };
        let (model, model_problem) = stored_model(&mut saving, &settings);
        let Memory { channels, estimators: [first, second], config: spare, .. } = memory;
        let (interrupt, tasks) = channels.split();
        let mut supervisor = Self {
            identity,
            service: Service::new(config, tasks, [first, second]),
            history: History::new(),
            defaults,
            settings,
            coming: None,
            spare: Some(spare.insert(config)),
            saving,
            stored: [model_problem, Problem::Blank, settings_problem],
            stored_model: model,
            stored_settings: settings,
            waiting: [false; 3],
            learnt_saved_ms: None,
            model,
            install: model.is_some(),
            noise_codes: noise_codes(model.as_ref()),
            learning: Learning::default(),
            calibration: Calibration::None,
            live: Live::new(),
            measurement: None,
            sensed: Sensed { bus: 0, temperatures: [0; 2] },
            reply: None,
            late: false,
            since_command: 0,
            stream: None,
            lost_records: 0,
            garbage: 0,
            lost_frames: 0,
            now_ms: 0,
        };
        for (record, problem) in [Record::Sensors, Record::Cogging, Record::Settings].into_iter().zip(supervisor.stored)
        {
            if !matches!(problem, Problem::None | Problem::Blank) {
                supervisor.note(Cause::Stored(record, problem));
            }
        }
        supervisor.relearn();
        (Drive::new(config, interrupt), supervisor)
    }

    /// Everything that is due every millisecond.
    pub fn tick(&mut self, now_ms: u64, sensed: Sensed) {
        self.now_ms = now_ms;
        self.sensed = sensed;
        self.since_command = self.since_command.saturating_add(1);
        let torque_nm = self.take_measurements();
        while let Some(event) = self.service.poll() {
            self.on(event, torque_nm);
        }
        self.spare = self.spare.take().or_else(|| self.service.unused_config());
        self.give();
        self.end_calibration();
        self.save();
    }

    /// Mean torque since the last tick, in the direction of the electrical angle, as far as the currents tell it.
    fn take_measurements(&mut self) -> f32 {
        let Some(control) = &self.settings.drive.control else { return 0.0 };
        let (mut sum, mut count) = (0.0, 0.0);
        while let Some(measurement) = self.service.measurement() {
            sum += measure::current_a(control, self.settings.drive.reversed, &measurement)[1];
            count += 1.0;
            self.measurement = Some(measurement);
        }
        let newton_metres = 1.5 * f32::from(self.settings.drive.pole_pairs) * control.flux_linkage_wb;
        if count > 0.0 { sum / count * newton_metres } else { 0.0 }
    }

    fn on(&mut self, event: Event, torque_nm: f32) {
        match event {
            Event::Reply(reply) => self.answered(reply.map_err(wire::refusal)),
            // What is learnt while the drive is faulted is refused, and comes again.
            Event::Installed(_) => {}
            Event::Record(record) => self.take(record, torque_nm),
            Event::Calibrated(calibrate) => {
                say!(info, "calibrated, residual {} %", calibrate.report.residual_pct);
                self.calibration = Calibration::Found(wire::report(&calibrate.report));
                self.model = Some(calibrate.model);
                self.noise_codes =
                    calibrate.report.sensors.each_ref().map(|sensor| sensor.noise_pct / 200.0 * sensor.swing);
                self.waiting[Record::Sensors as usize] = true;
                self.relearn();
            }
            Event::Refused(error) => {
                say!(warn, "the calibration failed");
                self.calibration = Calibration::Failed(wire::calibration_error(error));
            }
        }
    }

    fn answered(&mut self, reply: Result<(), Refusal<'static>>) {
        if let Some(settings) = self.coming.take()
            && reply.is_ok()
        {
            self.take_up(settings);
        }
        if !core::mem::take(&mut self.late) {
            self.reply = Some(reply);
        }
    }

    /// The drive works with other settings now.
    fn take_up(&mut self, settings: Settings) {
        let turned = settings.drive.reversed != self.settings.drive.reversed;
        if let Some(model) = self.model.as_mut().filter(|_| turned) {
            model.reversed = settings.drive.reversed;
            self.install = true;
        }
        self.settings = settings;
        self.relearn();
    }

    fn take(&mut self, record: Live, torque_nm: f32) {
        let before = self.live.status.mode();
        let mode = record.status.mode();
        if mode != before {
            say!(info, "{} after {}", mode, before);
            if let Mode::Faulted(fault) = mode {
                let cause = Cause::Fault(fault.code());
                self.history.push(self.now_ms, wire::mode(before), cause);
            }
        }
        if mode == before && !mode.drives() || mode == Mode::Running {
            let every = self.service.config().record_every();
            let missing = (record.sequence.wrapping_sub(self.live.sequence) + every / 2) / every;
            // A record out of turn comes early, never late.
            self.lost_records = self.lost_records.saturating_add(missing.saturating_sub(1).min(1 << 16));
        }
        if mode != Mode::Running {
            self.measurement = None;
        }
        self.live = record;
        if let Some(cause) = self.learning.take(&record, torque_nm) {
            self.note(cause);
        }
    }

    /// An incident of this moment.
    fn note(&mut self, cause: Cause) {
        self.history.push(self.now_ms, wire::mode(self.mode()), cause);
    }

    /// Gives the drive a model, if it is due.
    fn give(&mut self) {
        if self.install {
            let model = self.model.filter(|_| self.mode() != Mode::Running);
            self.install = model.is_some_and(|model| self.service.install(&model).is_err());
        } else if let Some(model) = self.learning.publish(&mut self.service, self.settings.drive.run_on_two_halls) {
            self.model = Some(model);
        }
    }

    /// Starts to learn anew from the model in use.
    pub fn relearn(&mut self) {
        let every = self.service.config().record_every();
        self.learning.restart(&self.settings, self.model.as_ref(), self.noise_codes, every);
    }

    /// A calibration that a command or a fault has ended.
    fn end_calibration(&mut self) {
        let turns = matches!(self.mode(), Mode::Aligning | Mode::Calibrating);
        if self.calibration == Calibration::Turning && !turns && self.since_command > SETTLED {
            self.calibration = Calibration::Failed(CalibrationError::Ended);
        }
    }

    /// Saves one of what waits, if the bridge is off.
    fn save(&mut self) {
        if !self.may_save() {
            return;
        }
        let rested = self.learnt_saved_ms.is_none_or(|then| self.now_ms >= then + 1000 * REST_S);
        if rested && self.is_worth_saving() {
            self.learnt_saved_ms = Some(self.now_ms);
            self.waiting[Record::Sensors as usize] = true;
        }
        if core::mem::take(&mut self.waiting[Record::Sensors as usize]) {
            self.save_model();
        } else if core::mem::take(&mut self.waiting[Record::Settings as usize]) {
            self.save_settings();
        }
    }

    /// Whether an erase, which stalls the core, does no harm.
    pub fn may_save(&self) -> bool {
        !self.mode().drives() && self.since_command >= SETTLED
    }

    fn is_worth_saving(&self) -> bool {
        match (&self.model, &self.stored_model) {
            (Some(model), Some(stored)) => differ(model, stored),
            (model, _) => model.is_some() && self.calibration != Calibration::Turning,
        }
    }

    fn save_model(&mut self) {
        let Some(model) = self.model else { return };
        let saved = self.saving.save(Record::Sensors, &calibration::encode(&model));
        // One that cannot be saved is not tried again and again.
        self.stored_model = Some(model);
        self.saved(Record::Sensors, saved);
    }

    fn save_settings(&mut self) {
        let mut record = [0; LONGEST];
        let saved = match self.settings.record(&self.defaults, &mut record) {
            Some(length) => self.saving.save(Record::Settings, &record[..length]),
            None => Err(Problem::Flash),
        };
        if saved.is_ok() {
            self.stored_settings = self.settings;
        }
        self.saved(Record::Settings, saved);
    }

    fn saved(&mut self, record: Record, saved: Result<(), Problem>) {
        self.stored[record as usize] = saved.err().unwrap_or(Problem::None);
        match saved {
            Ok(()) => say!(info, "record {} saved", record as u8),
            Err(_) => self.note(Cause::NotSaved(record)),
        }
    }

    /// Asks for the settings to be saved when that is possible.
    pub fn ask_to_save(&mut self) {
        self.waiting[Record::Settings as usize] = true;
    }

    /// Whether they have been, and how that went.
    pub fn settings_saved(&self) -> Option<bool> {
        let done = !self.waiting[Record::Settings as usize];
        done.then(|| self.stored[Record::Settings as usize] == Problem::None)
    }

    /// The settings in the flash.
    pub fn load_settings(&mut self) -> Result<Settings, Problem> {
        match stored_settings(&mut self.saving, &self.defaults) {
            (settings, Problem::None | Problem::Foreign) => Ok(settings),
            (_, problem) => Err(problem),
        }
    }

    /// Sends a command to the drive; [`Self::take_reply`] has the answer.
    pub fn send(&mut self, command: Command) -> Result<(), Refusal<'static>> {
        self.ready_to_ask()?;
        self.service.send(command).map_err(|_| Refusal::Silent)
    }

    /// Sends other settings to the drive, the same way.
    pub fn configure(&mut self, settings: Settings) -> Result<(), Refusal<'static>> {
        let config = settings.validate()?;
        self.ready_to_ask()?;
        let spare = self.spare.take().ok_or(Refusal::Silent)?;
        *spare = config;
        match self.service.configure(spare) {
            Ok(()) => {
                self.coming = Some(settings);
                Ok(())
            }
            Err(spare) => {
                self.spare = Some(spare);
                Err(Refusal::Silent)
            }
        }
    }

    fn ready_to_ask(&mut self) -> Result<(), Refusal<'static>> {
        self.reply = None;
        self.since_command = 0;
        if self.late { Err(Refusal::Silent) } else { Ok(()) }
    }

    /// The drive's answer to the last command.
    pub fn take_reply(&mut self) -> Option<Result<(), Refusal<'static>>> {
        self.reply.take()
    }

    /// Nobody waits for the answer any more.
    pub fn give_up(&mut self) {
        self.late = true;
    }

    pub fn mode(&self) -> Mode {
        self.live.status.mode()
    }

    /// Control periods a second.
    pub fn step_hz(&self) -> f32 {
        self.settings.drive.pwm_hz
    }

    /// Starts telemetry, or ends it with a rate of zero.
    pub fn stream(&mut self, id: u16, hz: f32) {
        self.stream = (hz > 0.0).then_some(Stream { id, rate: hz / 1000.0, due: 0.0, number: 0 });
    }

    /// Telemetry that is due, with the id of its request.
    pub fn telemetry(&mut self) -> Option<(u16, Telemetry)> {
        let stream = self.stream.as_mut()?;
        stream.due += stream.rate;
        if stream.due < 1.0 {
            return None;
        }
        stream.due -= 1.0;
        stream.number = stream.number.wrapping_add(1);
        let Stream { id, number, .. } = *stream;
        let [mut current_a, mut voltage_v] = [[f32::NAN; 2]; 2];
        if let (Some(measurement), Some(control)) = (&self.measurement, &self.settings.drive.control) {
            current_a = measure::current_a(control, self.settings.drive.reversed, measurement);
            voltage_v = measure::voltage_v(control, measurement);
        }
        let telemetry = Telemetry {
            number,
            step: self.live.sequence,
            angle_deg: self.live.rotor.angle().to_degrees(),
            speed_rad_s: self.speed_rad_s(),
            position_turns: self.position_turns(),
            current_a,
            voltage_v,
            bus_v: measure::bus_v(&self.settings.drive, self.sensed),
            mode: wire::mode(self.mode()),
            limits: self.live.status.limits().bits(),
            codes: self.live.codes,
        };
        Some((id, telemetry))
    }

    fn speed_rad_s(&self) -> f32 {
        self.live.electrical_hz(self.step_hz()) * TAU / f32::from(self.settings.drive.pole_pairs)
    }

    fn position_turns(&self) -> f64 {
        self.live.rotor.position().to_turns() / f64::from(self.settings.drive.pole_pairs)
    }

    /// What goes on that takes a while.
    pub fn activity(&self) -> Activity {
        if self.calibration == Calibration::Turning { Activity::Calibration } else { Activity::None }
    }

    pub fn status(&self) -> Status {
        let Settings { drive, .. } = &self.settings;
        let current = |control, measurement| measure::current_a(control, drive.reversed, measurement)[1];
        let mode = self.mode();
        let activity = self.activity();
        Status {
            uptime_ms: self.now_ms,
            mode: wire::mode(mode),
            limits: self.live.status.limits().bits(),
            calibrated: self.model.is_some() && !matches!(mode, Mode::Unarmed | Mode::Aligning | Mode::Calibrating),
            commutation: wire::commutation(drive.commutation),
            balanced: false,
            position_turns: self.position_turns(),
            speed_rad_s: self.speed_rad_s(),
            current_a: drive.control.as_ref().zip(self.measurement.as_ref()).map_or(f32::NAN, |(c, m)| current(c, m)),
            bus_v: measure::bus_v(drive, self.sensed),
            temperatures_c: measure::temperatures_c(drive, self.sensed),
            activity,
            progress: if activity == Activity::Calibration { self.service.progress() } else { 0.0 },
            learning: self.learning.state(),
            learnt: self.learning.count,
            stored: self.stored,
            unsaved: self.waiting != [false; 3] || self.settings != self.stored_settings || self.is_worth_saving(),
            lost_records: self.lost_records,
            garbage: self.garbage,
            lost_frames: self.lost_frames,
            command_timeout_s: drive.control.map_or(f32::INFINITY, |control| control.guard.command_timeout_s),
            incidents: self.history.len(),
        }
    }
}

/// The settings to work with, and what is wrong with those stored.
fn stored_settings<F: NorFlash>(saving: &mut Saving<F>, defaults: &Settings) -> (Settings, Problem) {
    let mut record = [0; LONGEST];
    match saving.load(Record::Settings, &mut record) {
        Ok(length) => Settings::of_record(defaults, &record[..length]),
        Err(problem) => (*defaults, problem),
    }
}

/// The stored model, if it can give an angle, or what is wrong with it.
fn stored_model<F: NorFlash>(saving: &mut Saving<F>, settings: &Settings) -> (Option<Model>, Problem) {
    let mut record = [0; LONGEST];
    let model = match saving.load(Record::Sensors, &mut record) {
        Ok(length) => calibration::decode(&record[..length]),
        Err(problem) => return (None, problem),
    };
    match model.filter(|model| estimate::validate(model, settings.drive.adc_bits).is_ok()) {
        // The settings may have been saved after the model.
        Some(model) => (Some(Model { reversed: settings.drive.reversed, ..model }), Problem::None),
        None => (None, Problem::Corrupt),
    }
}

/// Of sensors whose noise was not measured.
fn noise_codes(model: Option<&Model>) -> [f32; 3] {
    model.map_or([0.0; 3], |model| model.sensors.each_ref().map(|sensor| NOISE * sensor.amplitude))
}
