//! What the tasks know of the drive, and what they do once a millisecond.

mod asking;
mod keeping;
mod telling;
mod turning;

use crate::fmt::say;
use crate::heartbeat::Sensed;
use crate::history::History;
use crate::learning::Learning;
use crate::procedure::Procedure;
use crate::saving::{Saving, Sensors};
use crate::settings::Settings;
use crate::{App, Identity, Memory, wire};
use core::mem::MaybeUninit;
use embedded_storage::nor_flash::NorFlash;
use hallservo::board::TemperatureCode;
use hallservo::control::cogging::Table;
use hallservo::drive::{Drive, Tasks};
use hallservo::hall::estimate::Estimator;
use hallservo::mode::Mode;
use hallservo::service::{Event, Service, adaptation};
use hallservo::settings::{self, Config};
use hallservo::telemetry::{Measurement, Record as Live};
use hallservo_protocol::{self as protocol, Calibration, Cause, Cogging, Motor, Problem, Record, Refusal};
use telling::Stream;

/// Ticks after a command from which on the records tell what it did.
pub(crate) const SETTLED: u32 = 5;

/// Everything in the tasks' hands.
pub(crate) struct Supervisor<F> {
    pub identity: Identity,
    pub service: &'static mut Service,
    pub history: History,
    pub defaults: Settings,
    pub settings: Settings,
    /// Those that the drive is asked to take up.
    coming: Option<Settings>,
    /// Memory for them.
    spare: Option<&'static mut Config>,
    saving: Saving<F>,
    stored: [Problem; 3],
    stored_sensors: Option<Sensors>,
    stored_settings: Settings,
    /// What is to be saved when the bridge is off.
    waiting: [bool; 3],
    learnt_saved_ms: Option<u64>,
    sensors: Option<Sensors>,
    /// The drive has to be given their model.
    install: bool,
    learning: &'static mut Learning,
    /// Of the cogging.
    table: Option<Table>,
    /// The drive has to be given it, or told to do without.
    balance: bool,
    balanced: bool,
    pub procedure: &'static mut Option<Procedure>,
    pub calibration: Calibration,
    pub identification: protocol::Procedure<'static, Motor>,
    pub cogging: protocol::Procedure<'static, Cogging>,
    live: Live,
    measurement: Option<Measurement>,
    sensed: Sensed,
    reply: Option<Result<(), Refusal<'static>>>,
    /// Answers of the drive that nobody waits for.
    unheard: u8,
    pub since_command: u32,
    stream: Option<Stream>,
    lost_records: u32,
    pub garbage: u32,
    pub lost_frames: u32,
    now_ms: u64,
}

/// What passes over the stack does so by itself, and has left it when the next comes.
#[inline(never)]
fn blank(place: &mut MaybeUninit<Estimator>) -> &mut Estimator {
    place.write(Estimator::blank())
}

#[inline(never)]
fn serve(
    place: &'static mut MaybeUninit<Service>,
    config: Config,
    tasks: Tasks,
    estimators: [&'static mut Estimator; 2],
) -> &'static mut Service {
    place.write(Service::new(config, tasks, estimators))
}

impl<F: NorFlash> Supervisor<F> {
    pub fn start(
        identity: Identity,
        defaults: settings::Settings,
        flash: F,
        place: u32,
        memory: &'static mut Memory,
        app: &'static mut MaybeUninit<App<F>>,
    ) -> (Drive, &'static App<F>) {
        let defaults = Settings::new(defaults);
        let mut saving = Saving::new(flash, place);
        let (settings, settings_problem) = saving.settings(&defaults);
        let config = match settings.validate() {
            Ok(config) => config,
            Err(_) => panic!("the board's default settings are invalid"),
        };
        let sensors = saving.sensors(&settings);
        let table = saving.table(settings.full_scale_a());
        let stored = [sensors.err().unwrap_or_default(), table.err().unwrap_or_default(), settings_problem];
        let (sensors, table) = (sensors.ok(), table.ok());
        let Memory { channels, estimators, tables, config: spare, service, procedure, learning } = memory;
        let (interrupt, tasks) = channels.split();
        let estimators = estimators.each_mut().map(blank);
        let service = serve(service, config, tasks, estimators);
        for table in tables {
            service.lend(table);
        }
        let app = app.write(App::new(Self {
            identity,
            service,
            history: History::new(),
            defaults,
            settings,
            coming: None,
            spare: Some(spare.write(config)),
            saving,
            stored,
            stored_sensors: sensors,
            stored_settings: settings,
            waiting: [false; 3],
            learnt_saved_ms: None,
            sensors,
            install: sensors.is_some(),
            learning: learning.write(Learning::new()),
            balance: table.is_some(),
            table,
            balanced: false,
            procedure: procedure.write(None),
            calibration: Calibration::None,
            identification: protocol::Procedure::None,
            cogging: protocol::Procedure::None,
            live: Live::new(),
            measurement: None,
            sensed: Sensed { bus: 0, temperatures: [TemperatureCode::MISSING; 2] },
            reply: None,
            unheard: 0,
            since_command: 0,
            stream: None,
            lost_records: 0,
            garbage: 0,
            lost_frames: 0,
            now_ms: 0,
        }));
        let supervisor = app.supervisor();
        for (record, problem) in [Record::Sensors, Record::Cogging, Record::Settings].into_iter().zip(supervisor.stored)
        {
            if !matches!(problem, Problem::None | Problem::Blank) {
                supervisor.note(Cause::Stored(record, problem));
            }
        }
        supervisor.relearn();
        (Drive::new(config, interrupt), app)
    }

    /// Everything that is due every millisecond.
    pub fn tick(&mut self, now_ms: u64, sensed: Sensed) {
        self.now_ms = now_ms;
        self.sensed = sensed;
        self.since_command = self.since_command.saturating_add(1);
        let torque_nm = self.take_measurements();
        while let Some(event) = self.service.poll() {
            if let Some(procedure) = self.procedure {
                procedure.event(&event);
            }
            self.on(event, torque_nm);
        }
        self.proceed();
        self.spare = self.spare.take().or_else(|| self.service.unused_config());
        self.give();
        self.end_calibration();
        self.save();
    }

    /// Mean torque since the last tick, in the direction of the electrical angle, as far as the currents tell it.
    #[inline(never)]
    fn take_measurements(&mut self) -> f32 {
        let Some(control) = self.service.config().control else { return 0.0 };
        let (mut sum, mut count) = (0.0, 0.0);
        while let Some(measurement) = self.service.measurement() {
            sum += adaptation::torque_nm(&measurement, &control);
            count += 1.0;
            self.measurement = Some(measurement);
            if let Some(procedure) = self.procedure {
                procedure.measurement(&measurement);
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }

    #[inline(never)]
    fn on(&mut self, event: Event, torque_nm: f32) {
        match event {
            Event::Reply(reply) => self.answered(reply.map_err(wire::refusal)),
            // What is learnt while the drive is faulted is refused, and comes again.
            Event::Installed(_) => {}
            Event::Record(record) => self.take(record, torque_nm),
            Event::Calibrated(calibrate) => {
                say!(info, "calibrated, residual {} %", calibrate.report.residual_pct);
                self.calibration = Calibration::Found(wire::report(&calibrate.report));
                let noise = calibrate.report.sensors.each_ref().map(|sensor| sensor.noise_pct / 200.0 * sensor.swing);
                self.sensors = Some(Sensors { model: calibrate.model, noise });
                self.waiting[Record::Sensors as usize] = true;
                self.relearn();
            }
            Event::Refused(error) => {
                say!(warn, "the calibration failed");
                self.calibration = Calibration::Failed(wire::calibration_error(error));
            }
        }
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

    /// Gives the drive what is due: a model, a table.
    #[inline(never)]
    fn give(&mut self) {
        if let Some(sensors) = &mut self.sensors {
            if self.install {
                self.install = self.service.install(&sensors.model).is_err();
            } else if let Some(model) = self.learning.publish(self.service, self.settings.drive.run_on_two_halls) {
                sensors.model = model;
            }
        }
        if self.balance {
            let table = self.table.as_ref().filter(|_| self.settings.anti_cogging);
            self.balance = self.service.balance(table).is_err();
            self.balanced = !self.balance && table.is_some();
        }
    }

    /// Starts to learn anew from the model in use.
    #[inline(never)]
    pub fn relearn(&mut self) {
        let every = self.service.config().record_every();
        self.learning.restart(&self.settings, self.sensors.as_ref(), every);
    }

    /// Whether the cogging has been learnt.
    pub const fn has_table(&self) -> bool {
        self.table.is_some()
    }

    pub fn mode(&self) -> Mode {
        self.live.status.mode()
    }

    /// Control periods a second.
    pub fn step_hz(&self) -> f32 {
        self.settings.drive.pwm_hz
    }
}
