//! The drive's control code in a closed loop with the simulated motor: what a board and its motor are to each other.

pub mod commissioning;
pub mod motors;
mod shunts;

use anyhow::{Context, Result, anyhow, bail};
use hallservo::angle::{ElectricalAngle, PolePairs};
use hallservo::board::{Output, Sample, TemperatureCode};
use hallservo::commutation::Modulation;
use hallservo::config::Config;
use hallservo::control;
use hallservo::control::cogging::Table;
use hallservo::drive::{Channels, Command, Drive};
use hallservo::fault::Limits;
use hallservo::hall::calibrate::Calibration;
use hallservo::hall::estimate::Estimator;
use hallservo::hall::map::{Collector, Map};
use hallservo::hall::model::Model;
use hallservo::mode::Mode;
use hallservo::scope::{self, Recorder, Recording, Scope};
use hallservo::service::by_pole::ByPole;
use hallservo::service::identification::{self, Identification};
use hallservo::service::identify::Report;
use hallservo::service::learning::{self, Learning};
use hallservo::service::mapping::{self, Mapping};
use hallservo::service::procedure::{Procedure, Serve, State};
use hallservo::service::{Event, Service};
use hallservo::settings::Settings;
use hallservo::telemetry::Measurement;
use hallservo::turn::{Live, WHOLE};
use plant::{Legs, Plant, PlantParameters, Truth};
use shunts::Shunts;

/// A drive, its service and its motor.
pub struct Rig {
    /// The motor and everything between it and the drive.
    pub plant: Plant,
    /// What the control interrupt owns.
    pub drive: Drive,
    /// What the tasks own.
    pub service: Service,
    /// The settings in the interrupt's units.
    pub config: Config,
    /// The map of the magnets, which the tasks write and the drive reads.
    pub map: &'static Live,
    /// The cogging that differs from pole to pole.
    pub by_pole: ByPole,
    /// What the thermistors read.
    pub temperatures: [TemperatureCode; 2],
    /// Changes samples on their way from the ADC to the drive.
    pub disturb: Option<Disturb>,
    /// The brake resistor at the drive's output for it, Ω.
    pub brake_ohm: Option<f64>,
    /// What the tasks have of the scope.
    pub scope: Scope,
    recorder: Recorder,
    /// Whether it is on from the next period on: a driver and a transistor take their time.
    brakes: bool,
    /// Of the last calibration.
    model: Option<Model>,
    pole_pairs: PolePairs,
    period_s: f64,
    shunts: Shunts,
}

/// A change of a sample.
pub type Disturb = Box<dyn FnMut(&mut Sample)>;

/// A thermistor of [`Thermistor::ntc_10k`](hallservo::settings::Thermistor::ntc_10k) at 25 °C, 12 bit.
const COOL: TemperatureCode = TemperatureCode::new(2048);

/// One control period: what the drive saw and did, and how it really was at the sampling instant.
#[derive(Clone, Copy, Debug)]
pub struct Period {
    /// What the ADC delivered.
    pub sample: Sample,
    /// The state of the motor at that instant.
    pub truth: Truth,
    /// What the drive answered.
    pub output: Output,
}

impl Rig {
    /// A drive at a motor, both at rest.
    ///
    /// # Errors
    /// What is wrong with the settings or the parameters of the plant.
    pub fn new(plant: &PlantParameters, settings: &Settings, seed: u64) -> Result<Self> {
        let config = settings.validate().context("the drive's settings")?;
        let mut plant = Plant::new(plant, seed).map_err(|error| anyhow!("the plant's parameters: {error}"))?;
        let period_s = plant.period_s();
        if (period_s * f64::from(settings.pwm_hz) - 1.0).abs() > 1e-6 {
            bail!("the plant switches with {} Hz and the drive with {} Hz", 1.0 / period_s, settings.pwm_hz);
        }
        plant.place(0.3, 0.0)?;
        let (drive, service) = connected(config);
        let map: &Live = Box::leak(Box::default());
        let by_pole = ByPole::new(Box::leak(Box::default()));
        let drive = drive.with_map(map).with_cogging(by_pole.live());
        let (recorder, scope) =
            Box::leak(Box::<scope::Channels>::default()).split(Some(Box::leak(Box::new(Recording::new()))));
        Ok(Self {
            plant,
            drive,
            service,
            config,
            map,
            by_pole,
            pole_pairs: PolePairs::new(settings.pole_pairs).context("the drive's pole pairs")?,
            temperatures: [COOL; 2],
            disturb: None,
            brake_ohm: None,
            scope,
            recorder,
            brakes: false,
            model: None,
            period_s,
            shunts: Shunts::new(settings),
        })
    }

    /// Length of a control period in seconds.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// One control period.
    pub fn step(&mut self) -> Period {
        let sample = self.sample();
        let truth = self.plant.truth();
        let output = self.act(&sample);
        Period { sample, truth, output }
    }

    /// The same where nobody looks: how things really are need not be computed.
    pub fn tick(&mut self) {
        let sample = self.sample();
        self.act(&sample);
    }

    /// What the ADC delivers now.
    fn sample(&mut self) -> Sample {
        let plant::Codes { halls, currents, bus } = self.plant.sample();
        let currents = self.shunts.show(currents);
        let mut sample = Sample { halls, currents, bus, temperatures: self.temperatures, ..Sample::default() };
        if let Some(disturb) = &mut self.disturb {
            disturb(&mut sample);
        }
        sample
    }

    /// What the drive makes of it, until the next period.
    fn act(&mut self, sample: &Sample) -> Output {
        let output = self.drive.step(sample);
        self.recorder.take(&self.drive, sample, &output);
        self.plant.set_brake(self.brake_ohm.filter(|_| self.brakes)).expect("a brake resistor has a resistance");
        // A decision is for the next period.
        self.brakes = self.drive.chopper(sample).unwrap_or(self.brakes);
        self.plant.advance(&legs(&output, self.config.period));
        self.shunts.advance(output.compare, self.config.period);
        output
    }

    /// Control periods in a time.
    pub fn periods(&self, seconds: f64) -> u32 {
        (seconds / self.period_s).round() as u32
    }

    /// Whether the drive has the brake resistor on.
    pub fn brakes(&self) -> bool {
        self.brakes
    }

    /// Gives the drive other settings, its bridge off.
    ///
    /// # Errors
    /// What is wrong with the settings.
    pub fn configure(&mut self, settings: &Settings) -> Result<()> {
        self.config = settings.validate().context("the drive's settings")?;
        self.shunts = Shunts::new(settings);
        let lent = Box::leak(Box::new(self.config));
        if self.service.configure(lent).is_err() {
            bail!("the drive's queue is full");
        }
        self.wait(0.01);
        Ok(())
    }

    /// Sends a command and lets the drive obey it.
    ///
    /// # Errors
    /// The drive's refusal.
    pub fn command(&mut self, command: Command) -> Result<()> {
        self.service.send(command)?;
        for _ in 0..100 {
            self.tick();
            while let Some(event) = self.service.poll() {
                if let Event::Reply(reply) = event {
                    return Ok(reply?);
                }
            }
        }
        bail!("the drive did not answer")
    }

    /// Switches the bridge on and waits until it has been checked.
    ///
    /// # Errors
    /// The drive's refusal.
    pub fn arm(&mut self) -> Result<()> {
        self.command(Command::Arm)?;
        while self.drive.limits().contains(Limits::CHECKING) {
            self.tick();
        }
        Ok(())
    }

    /// Commands a modulation.
    ///
    /// # Errors
    /// The drive's refusal.
    pub fn drive_with(&mut self, modulation: f64) -> Result<()> {
        self.command(Command::Drive(Modulation::saturating_from_num(modulation)))
    }

    /// The settings of torque, speed and position in the interrupt's units.
    ///
    /// # Errors
    /// The drive has none.
    pub fn control(&self) -> Result<&hallservo::control::Config> {
        self.config.control.as_ref().context("the drive has no current control")
    }

    /// Steps for a time, serving the queues once a millisecond.
    pub fn run(&mut self, seconds: f64, mut look: impl FnMut(&Self, &Period)) {
        for k in 0..self.periods(seconds) {
            let period = self.step();
            look(self, &period);
            if k % 40 == 0 {
                self.serve();
            }
        }
    }

    /// The same where nobody looks.
    pub fn wait(&mut self, seconds: f64) {
        for k in 0..self.periods(seconds) {
            self.tick();
            if k % 40 == 0 {
                self.serve();
            }
        }
    }

    /// Lets the drive calibrate itself; `progress` hears from 0 to 1.
    ///
    /// # Errors
    /// Why the drive refused the sensors.
    pub fn calibrate(&mut self, mut progress: impl FnMut(f32)) -> Result<Calibration> {
        self.command(Command::Calibrate)?;
        for step in 0..self.periods(60.0) {
            self.tick();
            if step % 40 == 0 {
                progress(self.service.progress());
                if let Mode::Faulted(fault) = self.drive.mode() {
                    bail!("{fault:?} while calibrating");
                }
                while let Some(event) = self.service.poll() {
                    match event {
                        Event::Calibrated(calibration) => {
                            self.model = Some(calibration.model);
                            return Ok(calibration);
                        }
                        Event::Refused(error) => return Err(error.into()),
                        Event::Reply(_) | Event::Installed(_) | Event::Record(_) => {}
                    }
                }
            }
        }
        bail!("the calibration did not come to an end")
    }

    /// Lets the drive measure its motor.
    ///
    /// # Errors
    /// Why it came to nothing.
    pub fn identify(&mut self, plan: &identification::Plan) -> Result<Report> {
        let mut procedure = Identification::new(&self.config, plan)?;
        self.proceed(&mut procedure)?;
        Ok(*procedure.report().context("done without a report")?)
    }

    /// Lets the drive learn the cogging, and balance it from then on.
    ///
    /// # Errors
    /// Why it came to nothing.
    pub fn learn(&mut self, plan: &learning::Plan) -> Result<Table> {
        while self.service.add_table(Box::leak(Box::new(Table::ZERO))).is_none() {}
        let learning = Learning::new(&self.config, plan)?;
        let control = *self.control()?;
        let live = self.by_pole.live();
        let mut by_pole = std::mem::replace(&mut self.by_pole, ByPole::new(live));
        by_pole.begin(self.pole_pairs);
        let mut procedure = WholeLearning { learning, by_pole, control };
        let ended = self.proceed(&mut procedure);
        let WholeLearning { learning: procedure, by_pole, .. } = procedure;
        self.by_pole = by_pole;
        ended?;
        let table = self.by_pole.learnt().table(self.pole_pairs);
        self.by_pole.use_learnt(table);
        Ok(*procedure.table().context("done without a table")?)
    }

    /// Lets the drive learn the map of its rotor's magnets, and correct the angle by it from then on.
    ///
    /// # Errors
    /// Why it came to nothing.
    pub fn learn_map(&mut self, plan: &mapping::Plan) -> Result<Map> {
        self.map.end();
        let model = self.model.context("learning a map before a calibration")?;
        let mut collector = Collector::OFF;
        collector.begin(self.pole_pairs);
        let mut procedure = WholeMapping { mapping: Mapping::new(&self.config, plan)?, collector, model };
        self.proceed(&mut procedure)?;
        let WholeMapping { mapping, collector, model } = procedure;
        let map = mapping.map().context("done without a map")?;
        let map = collector.signature().map_or(map, |signature| map.aligned(&signature, &model));
        self.map.load(map.table());
        self.use_map(0);
        Ok(map)
    }

    /// Puts the map into effect over a tenth of a second.
    pub fn use_map(&mut self, electrical_turns: i32) {
        for share in 1..=WHOLE {
            self.map.use_from(electrical_turns, self.map.count(), share);
            self.wait(0.1 / f64::from(WHOLE));
        }
    }

    /// Steps until a procedure ends that is served once a millisecond.
    fn proceed(&mut self, procedure: &mut impl Procedure) -> Result<()> {
        for now_ms in 0..300_000 {
            match procedure.serve(&mut self.service, now_ms) {
                State::Running => {}
                State::Done => return Ok(()),
                State::Failed(error) => return Err(error.into()),
            }
            for _ in 0..self.periods(1e-3) {
                self.tick();
            }
        }
        bail!("the procedure did not come to an end")
    }

    /// Empties the queues, as the tasks do.
    pub fn serve(&mut self) {
        while self.service.poll().is_some() {}
        while let Some(measurement) = self.service.measurement() {
            if let Some(control) = &self.config.control {
                self.by_pole.measurement(&measurement, control);
            }
        }
        self.by_pole.tick(true);
    }
}

/// The cogging, what is alike at all poles and what differs.
struct WholeMapping {
    mapping: Mapping,
    collector: Collector,
    model: Model,
}

impl Procedure for WholeMapping {
    fn event(&mut self, event: &Event) {
        self.mapping.event(event);
        if let Event::Record(record) = event
            && record.missed == 0
            && record.status.mode() == Mode::Running
        {
            self.collector.push(&self.model, &record.codes, record.rotor.position());
        }
    }

    fn measurement(&mut self, measurement: &Measurement) {
        self.mapping.measurement(measurement);
    }

    fn step(&mut self, service: &mut Service, now_ms: u32) -> State {
        self.mapping.step(service, now_ms)
    }

    fn cancel(&mut self) {
        self.mapping.cancel();
    }

    fn progress(&self) -> f32 {
        self.mapping.progress()
    }
}

/// Learns the cogging that all poles have and the one that differs from pole to pole.
struct WholeLearning {
    learning: Learning,
    by_pole: ByPole,
    control: control::Config,
}

impl Procedure for WholeLearning {
    fn event(&mut self, event: &Event) {
        self.learning.event(event);
    }

    fn measurement(&mut self, measurement: &Measurement) {
        self.learning.measurement(measurement);
        self.by_pole.measurement(measurement, &self.control);
        self.by_pole.learn(self.learning.direction(), measurement, &self.control);
    }

    fn step(&mut self, service: &mut Service, now_ms: u32) -> State {
        self.learning.step(service, now_ms)
    }

    fn cancel(&mut self) {
        self.learning.cancel();
    }

    fn progress(&self) -> f32 {
        self.learning.progress()
    }
}

/// A drive and its service. On the chip, what connects them are statics; here, too, a drive lives as long as its
/// process.
pub fn connected(config: Config) -> (Drive, Service) {
    let (interrupt, tasks) = Box::leak(Box::new(Channels::new())).split();
    let estimators = [(); 2].map(|()| Box::leak(Box::new(Estimator::blank())));
    (Drive::new(config, interrupt), Service::new(config, tasks, estimators))
}

/// What the timer makes of an output.
pub fn legs(output: &Output, period: u16) -> Legs {
    Legs::timer(output.compare, period, [0, 1, 2].map(|leg| output.legs.contains(leg)))
}

/// Estimated less true angle, electrical degrees, −180 to 180.
pub fn error_deg(estimated: ElectricalAngle, true_rad: f64) -> f64 {
    let turns = f64::from(estimated.to_bits()) / 4_294_967_296.0 - true_rad / std::f64::consts::TAU;
    360.0 * (turns - turns.round())
}
