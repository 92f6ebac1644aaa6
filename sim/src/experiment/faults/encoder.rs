//! The faults that take an absolute encoder to be found: the Halls' turns against it, one of its own heads, and swapped
//! Halls.
//!
//! Two Halls that are swapped show a rotor that turns the other way, each of them healthy and, as far as they are
//! equal, in agreement with the others. Only where the swap makes the angle leap, or with something that has seen the
//! true one, can that be told.

use super::kind::MOST_WRONG;
use super::summary::{Found, Summary, settings};
use crate::experiment::vernier::{Build, calibrate, read};
use anyhow::{Context, Result, anyhow, bail};
use hallservo::angle::{ElectricalAngle, MechanicalAngle};
use hallservo::board::{Legs, Sample, TemperatureCode};
use hallservo::commutation::Commutation;
use hallservo::config::Config;
use hallservo::drive::absolute::{AbsoluteChannels, AbsoluteDrive, AbsoluteTasks};
use hallservo::drive::{Command, Reply};
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo::service::{Event, Service};
use hallservo::settings::Settings;
use hallservo::vernier::encoder::Encoder;
use hallservo::vernier::rings::{Ring, Rings};
use hallservo::vernier::turns::TurnCheck;
use plant::construction::Construction;
use plant::{Plant, PlantParameters};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rig::{connected, legs};
use std::f64::consts::TAU;

/// Two heads over each ring.
const HEADS: usize = 2;
/// Pole pairs of the reference ring: within one of them, a turning rotor shows that a head does not follow.
const POLE_PAIRS: f64 = 37.0;
/// Periods until the task has seen and told a disagreement: its own period and the drive's, twice for good measure.
const TOLD: u32 = 160;
/// Slip of the Halls, electrical turns a period: half a degree.
const SLIP: f64 = 0.5 / 360.0;
/// Periods in which it is beyond the 30° that are tolerated.
const APART: u32 = 60;
/// Longest time that the rotor needs for a pole pair of a ring at the slowest speed.
const LONGEST: u32 = 8000;

/// A drive with an encoder, at a motor with rings on its shaft.
struct Machine {
    plant: Plant,
    /// Shows the Halls what they would see elsewhere.
    ghost: Plant,
    /// Electrical turns that the Halls are ahead of the rotor, and by how many more each period.
    slipped: f64,
    slip: f64,
    frozen: Option<(Ring, usize, Option<u16>)>,
    swapped: Option<(usize, usize)>,
    drive: AbsoluteDrive<Encoder<HEADS>>,
    service: Service,
    tasks: AbsoluteTasks<Encoder<HEADS>>,
    construction: Construction,
    rings: Rings,
    config: Config,
    periods: u64,
    /// Of the last command.
    reply: Option<Reply>,
}

impl Machine {
    fn new(seed: u64) -> Result<Self> {
        let settings = Settings { commutation: Commutation::FieldOriented, ..settings() };
        let config = settings.validate()?;
        let build = Build { eccentricity: 0.02, head_angle: 40.0, pairs: true };
        let (rings, mut construction) = (build.rings()?, build.construction(seed));
        let (calibration, _) = calibrate::<HEADS>(&build, &mut construction, seed)?;
        let encoder = Encoder::new(&rings, &calibration, MechanicalAngle::from_degrees(1.0))?;
        let (drive, service) = connected(config);
        let (absolute_interrupt, mut absolute_tasks) = Box::leak(Box::new(AbsoluteChannels::new())).split();
        absolute_tasks.install(Box::leak(Box::new(encoder))).map_err(|_| anyhow!("no room for the encoder"))?;
        let parameters = PlantParameters::imperfect(seed);
        let plant = |seed| Plant::new(&parameters, seed);
        Ok(Self {
            plant: plant(seed)?,
            ghost: plant(!seed)?,
            slipped: 0.0,
            slip: 0.0,
            frozen: None,
            swapped: None,
            drive: AbsoluteDrive::new(drive, absolute_interrupt, config.record_every()),
            service,
            tasks: absolute_tasks,
            construction,
            rings,
            config,
            periods: 0,
            reply: None,
        })
    }

    /// One period of the drive, and a look of the tasks every millisecond. Whether the bridge is off.
    fn step(&mut self) -> Result<bool> {
        let truth = self.plant.truth();
        let mut reading = read(&self.rings, &mut self.construction, truth.mechanical_angle_rad);
        if let Some((ring, head, held)) = &mut self.frozen {
            let heads = match ring {
                Ring::Reference => &mut reading.reference,
                Ring::Vernier => &mut reading.vernier,
            };
            heads[*head] = *held.get_or_insert(heads[*head]);
        }
        let plant::Codes { mut halls, currents, bus } = self.plant.sample();
        self.slipped += self.slip;
        if self.slipped != 0.0 {
            let ahead = self.slipped * TAU / f64::from(self.config.pole_pairs.get());
            self.ghost.place(truth.mechanical_angle_rad + ahead, 0.0)?;
            halls = self.ghost.sample().halls;
        }
        if let Some((one, other)) = self.swapped {
            halls.swap(one, other);
        }
        let sample =
            Sample { halls, currents, bus, temperatures: [TemperatureCode::new(2048); 2], ..Sample::default() };
        let output = self.drive.step(&sample, reading);
        self.plant.advance(&legs(&output, self.config.period));
        self.periods += 1;
        if self.periods.is_multiple_of(40) {
            self.serve();
        }
        Ok(output.legs == Legs::NONE)
    }

    fn serve(&mut self) {
        while let Some(event) = self.service.poll() {
            if let Event::Reply(reply) = event {
                self.reply = Some(reply);
            }
        }
        while self.tasks.poll(&mut self.service).is_some() {}
    }

    fn run(&mut self, periods: u32) -> Result<()> {
        (0..periods).try_for_each(|_| self.step().map(|_| ()))
    }

    /// Takes the shaft to a speed in 2000 periods: an encoder does not believe in a leap.
    fn ramp_to(&mut self, speed_rad_s: f64) -> Result<()> {
        let start = self.plant.truth().speed_rad_s;
        for k in 1..=2000 {
            let speed = start + (speed_rad_s - start) * f64::from(k) / 2000.0;
            self.plant.set_dyno(Some(speed))?;
            self.step()?;
        }
        Ok(())
    }

    fn command(&mut self, command: Command) -> Result<()> {
        self.service.send(command)?;
        for _ in 0..100 {
            self.step()?;
            if let Some(reply) = self.reply.take() {
                return Ok(reply?);
            }
        }
        bail!("the drive did not answer")
    }

    fn mode(&self) -> Mode {
        self.drive.drive().mode()
    }

    /// Compares Halls and encoder anew, as after a power-up.
    fn watch(&mut self) -> Result<()> {
        let pole_pairs = self.config.pole_pairs;
        let angle = self.drive.angle().context("no encoder")?.map_err(|fault| anyhow!("{fault:?}"))?;
        let offset = TurnCheck::offset(pole_pairs, angle, self.drive.drive().tracker().angle());
        self.tasks.watch(Some(TurnCheck { pole_pairs, offset, tolerance: ElectricalAngle::from_degrees(30.0) }));
        Ok(())
    }
}

/// What is done to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Injection {
    /// The Halls' counter goes wrong by some turns while the bridge is off.
    SlippedAtRest,
    /// The Halls run ahead or behind, by half a degree a period.
    Slipping,
    HeadFrozen,
    HallsSwapped,
}

impl Injection {
    fn name(self) -> &'static str {
        match self {
            Self::SlippedAtRest | Self::Slipping => "Halls' turns against the encoder",
            Self::HeadFrozen => "encoder's head frozen",
            Self::HallsSwapped => "two Halls swapped, with an encoder",
        }
    }

    fn is(self, fault: Fault) -> bool {
        match self {
            Self::SlippedAtRest | Self::Slipping => fault == Fault::Turns,
            Self::HeadFrozen => fault == Fault::Encoder,
            Self::HallsSwapped => matches!(fault, Fault::Turns | Fault::Hall(_) | Fault::AngleJump),
        }
    }
}

/// What came of an injection: the fault, and control periods and electrical turns of the rotor until then.
#[derive(Clone, Copy, Debug, Default)]
struct Trial {
    fault: Option<Fault>,
    periods: u32,
    turns: f64,
}

impl Trial {
    fn outcome(self, injection: Injection) -> Found {
        let right = self.fault.is_some_and(|fault| injection.is(fault));
        Found {
            reported: self.fault.map_or("nothing".into(), |fault| fault.to_string()),
            right,
            named: self.fault.is_some(),
            misnamed: !right && self.fault.is_some(),
            seconds: f64::from(self.periods) / 40e3,
            turns: self.turns,
            at: "with an encoder".into(),
            ..Found::default()
        }
    }
}

/// A machine and what befalls it.
pub(super) struct EncoderCampaign {
    machine: Machine,
    random: Pcg64,
    summary: Summary,
}

impl EncoderCampaign {
    pub fn new(seed: u64) -> Result<Self> {
        let mut machine = Machine::new(seed)?;
        machine.command(Command::Calibrate)?;
        while machine.mode() != Mode::Ready {
            if let Mode::Faulted(fault) = machine.mode() {
                bail!("{fault}");
            }
            machine.run(400)?;
        }
        machine.run(20_000)?;
        let summary = Summary::new(seed, 3);
        Ok(Self { machine, random: Pcg64::seed_from_u64(seed ^ 0x5eed), summary })
    }

    pub fn run(mut self, injections: u32) -> Result<Summary> {
        for _ in 0..injections {
            self.machine.watch()?;
            // The first comparison is what all others are held against.
            self.machine.run(TOLD)?;
            use Injection::{HallsSwapped, HeadFrozen, SlippedAtRest, Slipping};
            // Each kind as often as the others.
            let kinds = [HallsSwapped, HallsSwapped, HeadFrozen, HeadFrozen, SlippedAtRest, Slipping];
            let injection = *kinds.choose(&mut self.random).context("no kinds")?;
            if injection == SlippedAtRest {
                self.slip_at_rest()?;
            } else {
                self.turn()?;
            }
            if let Mode::Faulted(fault) = self.machine.mode() {
                self.summary.false_alarm(format!("{fault:?}, with an encoder"), format!("seed {}", self.summary.seed));
            } else {
                let found = self.inject(injection)?;
                self.summary.count(injection.name(), found.outcome(injection), MOST_WRONG);
            }
            self.recover()?;
        }
        Ok(self.summary)
    }

    /// Runs at a random speed for a random time.
    fn turn(&mut self) -> Result<()> {
        let speed = self.random.random_range(30.0..75.0) * if self.random.random_bool(0.5) { 1.0 } else { -1.0 };
        let speed = self.machine.config.control.as_ref().context("no control")?.speed(speed)?;
        self.machine.command(Command::Arm)?;
        // The time-out counts while the bridge is checked, too.
        while self.machine.drive.drive().limits().contains(Limits::CHECKING) {
            self.machine.command(Command::Speed(speed))?;
            self.machine.run(200)?;
        }
        self.machine.command(Command::Speed(speed))?;
        for k in 0..self.random.random_range(2000..4000) {
            self.machine.step()?;
            self.summary.quiet_periods += 1;
            if k % 400 == 399 {
                self.machine.command(Command::Speed(speed))?;
            }
        }
        Ok(())
    }

    fn inject(&mut self, injection: Injection) -> Result<Trial> {
        match injection {
            Injection::SlippedAtRest => {
                self.machine.command(Command::Arm)?;
                self.until(TOLD, f64::INFINITY)
            }
            Injection::Slipping => {
                self.machine.slip = if self.random.random_bool(0.5) { SLIP } else { -SLIP };
                self.until(APART + TOLD, f64::INFINITY)
            }
            Injection::HeadFrozen => self.freeze(),
            Injection::HallsSwapped => {
                let first = self.random.random_range(0..3);
                self.machine.swapped = Some((first, (first + 1) % 3));
                self.until(LONGEST, 1.0)
            }
        }
    }

    fn slip_at_rest(&mut self) -> Result<()> {
        let turns = *[-2.0, -1.0, 1.0, 2.0, 3.0].choose(&mut self.random).context("no turns")?;
        let periods = self.random.random_range(200..1000);
        self.machine.slip = turns / f64::from(periods);
        self.machine.run(periods)?;
        // From here on the Halls show where the rotor is, but for the count.
        (self.machine.slip, self.machine.slipped) = (0.0, 0.0);
        self.machine.run(400)
    }

    fn freeze(&mut self) -> Result<Trial> {
        let ring = *[Ring::Reference, Ring::Vernier].choose(&mut self.random).context("no ring")?;
        self.machine.frozen = Some((ring, self.random.random_range(0..HEADS), None));
        let pole_pairs = f64::from(self.machine.config.pole_pairs.get());
        self.until(LONGEST, pole_pairs / POLE_PAIRS)
    }

    /// Until a fault, for so many periods or electrical turns at most.
    fn until(&mut self, periods: u32, turns: f64) -> Result<Trial> {
        let electrical = |machine: &Machine| {
            machine.plant.truth().mechanical_angle_rad / TAU * f64::from(machine.config.pole_pairs.get())
        };
        let start = electrical(&self.machine);
        let mut found = Trial::default();
        while found.periods < periods && found.turns < turns {
            let off = self.machine.step()?;
            found.periods += 1;
            found.turns = (electrical(&self.machine) - start).abs();
            if let Mode::Faulted(fault) = self.machine.mode() {
                self.summary.bridge_off_within_one_period &= off;
                found.fault = Some(fault);
                break;
            }
        }
        Ok(found)
    }

    /// Mends everything and comes to rest.
    fn recover(&mut self) -> Result<()> {
        let machine = &mut self.machine;
        (machine.slip, machine.slipped, machine.frozen, machine.swapped) = (0.0, 0.0, None, None);
        // An encoder that has lost its place finds it where the shaft turns.
        for speed in [20.0, 20.0, 0.0, 0.0] {
            machine.ramp_to(speed)?;
        }
        machine.plant.set_dyno(None)?;
        match machine.mode() {
            Mode::Faulted(_) => machine.command(Command::Clear),
            Mode::Running => machine.command(Command::Disarm),
            _ => Ok(()),
        }
    }
}
