//! The whole commissioning of a simulated motor, as `hallctl commission` does it over a line.

use crate::Rig;
use hallservo::config::Config;
use hallservo::drive::{Command, Refusal};
use hallservo::hall::calibrate::{self, report::Report as Sensors};
use hallservo::mode::Mode;
use hallservo::service::Event;
use hallservo::service::commission::{Action, COOLING_MS, COOLINGS, Commission, GENTLER, HOT};
use hallservo::service::identification::{Identification, Plan};
use hallservo::service::identify::Report;
use hallservo::service::procedure::{Error, Procedure, Serve, State};
use hallservo::service::standstill::{Electrical, Standstill};
use hallservo::service::swings::{Rough, Swings};
use hallservo::settings::Settings;

/// A drive at a motor, and the largest current that truly flowed.
pub struct Bench {
    /// The drive and its motor.
    pub rig: Rig,
    /// That current, A.
    pub largest_a: f64,
}

impl Bench {
    /// At rest, not calibrated.
    pub fn new(rig: Rig) -> Self {
        Self { rig, largest_a: 0.0 }
    }

    /// Until it ends, begun anew with the motor cooled where it was too hot; else why it came to nothing, and what the rotor did.
    fn run<P: Procedure>(&mut self, begin: impl Fn(&Config) -> P) -> Result<P, String> {
        let (procedure, state) = self.end_of_cooled(begin)?;
        self.ended(&procedure, state).map(|()| procedure)
    }

    /// How it ends, begun anew with the motor cooled where it was too hot.
    fn end_of_cooled<P: Procedure>(&mut self, begin: impl Fn(&Config) -> P) -> Result<(P, State), String> {
        let mut coolings = 0;
        loop {
            let mut procedure = begin(&self.rig.config);
            let state = self.end_of(&mut procedure);
            let hot = matches!(state, State::Failed(Error::Fault(fault) | Error::Refused(Refusal::Fault(fault)))
                if HOT.contains(&fault));
            if !hot || coolings == COOLINGS {
                return Ok((procedure, state));
            }
            coolings += 1;
            self.clear()?;
            self.wait(f64::from(COOLING_MS) * 1e-3);
        }
    }

    /// Takes back a fault, if there is one.
    fn clear(&mut self) -> Result<(), String> {
        match self.rig.drive.mode() {
            Mode::Faulted(_) => self.rig.command(Command::Clear).map_err(|error| error.to_string()),
            _ => Ok(()),
        }
    }

    fn ended(&self, procedure: &dyn Procedure, state: State) -> Result<(), String> {
        let error = match state {
            State::Done => return Ok(()),
            State::Failed(Error::Fault(fault)) => format!("{fault:?}"),
            State::Failed(error) => format!("{error:?}"),
            State::Running => "endless".into(),
        };
        let speed = self.rig.plant.truth().speed_rad_s;
        Err(format!("{error}, {:.0} % done, at {speed:.1} rad/s", 100.0 * procedure.progress()))
    }

    /// How it ends; `Running` where it does not.
    fn end_of(&mut self, procedure: &mut dyn Procedure) -> State {
        for ms in 0..300_000_u32 {
            let state = procedure.serve(&mut self.rig.service, ms);
            if state != State::Running {
                return state;
            }
            self.millisecond();
        }
        State::Running
    }

    /// Runs for a time, serving the queues.
    pub fn wait(&mut self, seconds: f64) {
        for k in 0..self.rig.periods(seconds) {
            self.step();
            if k.is_multiple_of(self.rig.periods(1e-3)) {
                self.rig.serve();
            }
        }
    }

    /// Gives the drive other settings.
    fn configure(&mut self, settings: &Settings) {
        let config = settings.validate().unwrap();
        self.rig.config = config;
        let lent: &'static mut Config = Box::leak(Box::new(config));
        self.rig.service.configure(lent).unwrap();
        self.wait(0.01);
    }

    /// Calibrates the sensors and waits until the rotor rests.
    ///
    /// # Errors
    /// A fault, or a drive that refuses; within it, what is wrong with the sensors.
    pub fn calibrate(&mut self) -> Result<Result<Sensors, calibrate::Error>, String> {
        self.rig.command(Command::Calibrate).map_err(|error| error.to_string())?;
        let mut result = None;
        for _ in 0..120_000 {
            self.millisecond();
            while let Some(event) = self.rig.service.poll() {
                match event {
                    Event::Calibrated(found) => result = Some(Ok(found.report)),
                    Event::Refused(error) => result = Some(Err(error)),
                    _ => {}
                }
            }
            if let Some(result) = result {
                self.wait(0.01);
                if result.is_err() {
                    self.rig.command(Command::Clear).map_err(|error| error.to_string())?;
                }
                for _ in 0..50 {
                    self.wait(0.1);
                    if self.rig.plant.truth().speed_rad_s.abs() < 0.1 {
                        break;
                    }
                }
                return Ok(result);
            }
            if let Mode::Faulted(fault) = self.rig.drive.mode() {
                return Err(format!("{fault:?} while calibrating"));
            }
        }
        Err("the calibration is stuck".into())
    }

    /// Waits for the rotor, ten seconds at most.
    fn rest(&mut self) {
        for _ in 0..100 {
            self.wait(0.1);
            if self.rig.plant.truth().speed_rad_s.abs() < 0.5 {
                break;
            }
        }
    }

    fn millisecond(&mut self) {
        for _ in 0..self.rig.periods(1e-3) {
            self.step();
        }
    }

    /// One control period.
    pub fn step(&mut self) {
        self.largest_a = self.rig.plant.currents_a().iter().fold(self.largest_a, |most, a| most.max(a.abs()));
        self.rig.tick();
    }
}

/// What commissioning found, and what truly flowed.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// As they are in the end.
    pub settings: Settings,
    /// R and L at standstill.
    pub electrical: Electrical,
    /// What the last calibration said.
    pub sensors: Sensors,
    /// Calibrations that it took.
    pub tries: u32,
    /// Flux linkage and inertia by swings.
    pub rough: Rough,
    /// The identification; none where its measurements do not determine the motor.
    pub report: Option<Report>,
    /// How long it all took.
    pub seconds: f64,
}

/// From the board's settings and a current limit to a drive that knows its motor.
///
/// # Errors
/// The step that failed, and why.
pub fn commission(bench: &mut Bench, settings: Settings, limit_a: f32) -> Result<Outcome, String> {
    let mut commission = Commission::new(settings, Some(limit_a)).map_err(|error| error.to_string())?;
    let (mut electrical, mut sensors, mut rough, mut report, mut tries, mut gentler) = (None, None, None, None, 0, 0);
    loop {
        bench.configure(commission.settings());
        match commission.action() {
            Action::Measure => {
                let standstill = bench
                    .run(|config| Standstill::new(config).unwrap())
                    .map_err(|error| format!("standstill: {error}"))?;
                let found = *standstill.report().ok_or("standstill: no report")?;
                commission.measured(&found).map_err(|error| format!("measured: {error}"))?;
                electrical = Some(found);
            }
            Action::Calibrate => {
                tries += 1;
                let result = bench.calibrate()?;
                commission.calibrated(result.as_ref().map_err(|error| *error)).map_err(|error| error.to_string())?;
                sensors = result.ok().or(sensors);
            }
            Action::Swing => {
                let swings =
                    bench.run(|config| Swings::new(config).unwrap()).map_err(|error| format!("swings: {error}"))?;
                let found = *swings.report().ok_or("swings: no report")?;
                commission.swung(&found).map_err(|error| format!("swung: {error}"))?;
                rough = Some(found);
                bench.wait(0.5);
            }
            Action::Identify => {
                let plan = Plan::new(&bench.rig.config).unwrap();
                let (identification, state) =
                    bench.end_of_cooled(|config| Identification::new(config, &plan).unwrap())?;
                if let State::Failed(Error::Fault(fault)) = state
                    && gentler < GENTLER
                    && Action::Identify.may_be_gentler(fault)
                {
                    gentler += 1;
                    bench.rest();
                    bench.clear()?;
                    commission.be_gentle().map_err(|error| format!("gentler: {error}"))?;
                    continue;
                }
                report = if state == State::Failed(Error::Inconclusive) {
                    None
                } else {
                    bench
                        .ended(&identification, state)
                        .map_err(|error| format!("identification: {error}, {plan:?}"))?;
                    Some(*identification.report().ok_or("identification: no report")?)
                };
                let known = match &report {
                    Some(found) => commission.identified(found),
                    None => commission.unidentified(),
                };
                known.map_err(|error| format!("identified: {error}"))?;
            }
            Action::Done => break,
        }
    }
    let (Some(electrical), Some(sensors), Some(rough)) = (electrical, sensors, rough) else {
        return Err("a step was left out".into());
    };
    let (settings, seconds) = (*commission.settings(), bench.rig.plant.truth().time_s);
    Ok(Outcome { settings, electrical, sensors, tries, rough, report, seconds })
}
