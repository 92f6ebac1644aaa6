//! The start: what the flash holds, and everything written to its place.
//!
//! Large values are written to their places by functions of their own, so that they do not add up on the stack.

use super::Tasks;
use crate::adaptation::SensorAdaptation;
use crate::controller::Controller;
use crate::encoder::Encoder;
use crate::history::History;
use crate::housekeeping::Readings;
use crate::magnets::{ForDrive, MagnetMap};
use crate::procedure::Procedure;
use crate::scope::ScopeTasks;
use crate::storage::{ENCODER, Storage};
use crate::{Identity, Memory, Supervisor};
use core::mem::MaybeUninit;
use embedded_storage::nor_flash::NorFlash;
use hallservo::config::Config;
use hallservo::control::Impedance;
use hallservo::drive::{self, Drive};
use hallservo::hall::estimate::Estimator;
use hallservo::service::Service;
use hallservo::settings::{Error, Settings};
use hallservo::telemetry::Record as DriveRecord;
use hallservo_protocol::{self as protocol, Calibration, Cause, Problem, Record};

/// Parts of the static memory that are filled already.
struct Places<E> {
    encoder: E,
    magnets: MagnetMap,
    scope: ScopeTasks,
    service: &'static mut Service,
    config: &'static mut Config,
    adaptation: &'static mut SensorAdaptation,
    procedure: &'static mut Option<Procedure>,
}

/// The settings to start with.
struct Start<'a, F> {
    identity: Identity,
    defaults: &'a Settings,
    settings: &'a Settings,
    /// What is wrong with those stored.
    problem: Problem,
    storage: Storage<F>,
}

#[inline(never)]
fn new_config<'a>(place: &'a mut MaybeUninit<Config>, settings: &Settings) -> Result<&'a mut Config, Error<'static>> {
    let config = Config::blank_in(place);
    settings.validate_into(config)?;
    Ok(config)
}

#[inline(never)]
fn blank(place: &mut MaybeUninit<Estimator>) -> &mut Estimator {
    place.write(Estimator::blank())
}

#[inline(never)]
fn new_service(
    place: &'static mut MaybeUninit<Service>,
    config: &Config,
    tasks: drive::Tasks,
    estimators: [&'static mut Estimator; 2],
) -> &'static mut Service {
    place.write(Service::new(*config, tasks, estimators))
}

#[inline(never)]
fn new_drive<E: Encoder>(
    place: &'static mut MaybeUninit<E::Drive>,
    config: &Config,
    interrupt: drive::Interrupt,
    encoder: E::Interrupt,
    map: ForDrive,
    settings: &Settings,
) -> &'static mut E::Drive {
    place.write(E::drive(map.attach(bare_drive(config, interrupt)), encoder, settings))
}

// Inlined, it would be taken apart and put together again.
#[inline(never)]
fn bare_drive(config: &Config, interrupt: drive::Interrupt) -> Drive {
    Drive::new(*config, interrupt)
}

/// See [`Supervisor::start`].
pub(crate) fn start<F: NorFlash, E: Encoder>(
    identity: Identity,
    defaults: Settings,
    flash: F,
    first_block: u32,
    memory: &'static mut Memory<F, E>,
) -> Result<(&'static mut E::Drive, &'static mut Supervisor<F, E>), Error<'static>> {
    let Memory {
        drive,
        channels,
        tables,
        impedances,
        estimators,
        config,
        service,
        procedure,
        adaptation,
        encoder,
        magnets,
        scope,
        supervisor,
    } = memory;
    let mut storage = Storage::new(flash, first_block);
    let mut settings = defaults;
    let problem = storage.settings(&defaults, &mut settings);
    let config = new_config(config, &settings)?;
    let (mut encoder, encoder_interrupt) = E::start(encoder, &settings);
    restore(&mut encoder, &mut storage);
    encoder.place(config, &settings);
    let (magnets, map) = MagnetMap::start(magnets);
    let (interrupt, tasks) = channels.split();
    let drive = new_drive::<E>(drive, config, interrupt, encoder_interrupt, map, &settings);
    let service = new_service(service, config, tasks, estimators.each_mut().map(blank));
    for table in tables {
        service.add_table(table);
    }
    for impedance in impedances {
        service.add_impedance(impedance.write(Impedance::NONE));
    }
    let adaptation = adaptation.write(SensorAdaptation::new());
    let scope = ScopeTasks::start(scope);
    let places = Places { encoder, magnets, scope, service, config, adaptation, procedure: procedure.write(None) };
    let start = Start { identity, defaults: &defaults, settings: &settings, problem, storage };
    let supervisor = supervise(start, places, supervisor);
    supervisor.tasks().take_up_stored();
    supervisor.tasks().relearn();
    Ok((drive, supervisor))
}

/// What the flash holds of an encoder.
#[inline(always)]
fn restore<F: NorFlash, E: Encoder>(encoder: &mut E, storage: &mut Storage<F>) {
    if E::RECORD > 0 {
        encoder.restore(storage.load_encoder(&mut [0; ENCODER]));
    }
}

#[inline(never)]
fn supervise<F: NorFlash, E: Encoder>(
    start: Start<'_, F>,
    places: Places<E>,
    supervisor: &'static mut MaybeUninit<Supervisor<F, E>>,
) -> &'static mut Supervisor<F, E> {
    let Start { identity, defaults, settings, problem, storage } = start;
    // Written right into its place, which spares the stack a copy.
    supervisor.write(Supervisor::new(Tasks {
        identity,
        controller: Controller::default(),
        service: places.service,
        history: History::new(),
        defaults: *defaults,
        settings: *settings,
        sent_settings: None,
        retunes: false,
        spare_config: Some(places.config),
        storage,
        encoder: places.encoder,
        magnets: places.magnets,
        scope: places.scope,
        stored: [Problem::None, Problem::None, problem],
        unconfirmed: !matches!(problem, Problem::None | Problem::Blank),
        stored_sensors: None,
        stored_settings: settings.digest(),
        unsaved: [false; 3],
        learnt_saved_ms: None,
        sensors: None,
        install_due: false,
        sensors_due: false,
        adaptation: places.adaptation,
        table_due: false,
        table: None,
        anti_cogging: false,
        procedure: places.procedure,
        rest: None,
        calibration: Calibration::None,
        identification: protocol::Procedure::None,
        cogging: protocol::Procedure::None,
        swings: protocol::Procedure::None,
        window: None,
        record: DriveRecord::new(),
        measurement: None,
        follows_impedance: false,
        readings: Readings::default(),
        reply: None,
        unclaimed_replies: 0,
        disarm_due: false,
        ticks_since_command: 0,
        stream: None,
        lost_records: 0,
        garbage: 0,
        lost_frames: 0,
        now_ms: 0,
    }))
}

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Takes up what the flash holds beside the settings.
    fn take_up_stored(&mut self) {
        self.restore_table();
        let map_problem = self.restore_sensors();
        #[cfg(feature = "map")]
        if E::SETTINGS == 0 {
            self.magnets.restore_by_pole(self.storage.by_pole(&self.settings), &self.settings);
        }
        for (record, problem) in [Record::Sensors, Record::Cogging, Record::Settings].into_iter().zip(self.stored) {
            self.note_problem(record, problem);
        }
        #[cfg(feature = "encoder")]
        if let problem @ (Problem::Corrupt | Problem::Version(_) | Problem::Foreign | Problem::Flash) =
            self.encoder.problem()
        {
            self.note(Cause::Stored(Record::Encoder, problem));
        }
        #[cfg(feature = "map")]
        self.note_problem(Record::Magnets, map_problem);
        #[cfg(not(feature = "map"))]
        let _ = map_problem;
    }

    /// A calibration has come to nothing: the sensors are those of before, with the map of the flash, if it is of them.
    #[inline(never)]
    pub(super) fn take_up_sensors(&mut self) {
        self.sensors = self.stored_sensors;
        self.install_due = self.sensors.is_some();
        self.restore_map();
        self.relearn();
    }

    /// What the flash holds of the sensors and of the magnets over them; what is wrong with the latter.
    fn restore_sensors(&mut self) -> Problem {
        match self.storage.sensors(&self.settings) {
            Ok(sensors) => {
                (self.sensors, self.stored_sensors) = (Some(sensors), Some(sensors));
                self.install_due = true;
            }
            Err(problem) => self.stored[Record::Sensors as usize] = problem,
        }
        self.restore_map()
    }

    fn restore_map(&mut self) -> Problem {
        if E::SETTINGS > 0 {
            return Problem::None;
        }
        self.magnets.restore(&mut self.storage, self.sensors.as_ref(), &self.settings)
    }

    fn restore_table(&mut self) {
        match self.storage.table(&self.settings) {
            Ok(table) => (self.table, self.table_due) = (Some(table), true),
            Err(problem) => self.stored[Record::Cogging as usize] = problem,
        }
    }

    /// What is wrong with a stored record, for the history.
    fn note_problem(&mut self, record: Record, problem: Problem) {
        if !matches!(problem, Problem::None | Problem::Blank) {
            self.note(Cause::Stored(record, problem));
        }
    }
}
