//! A drive without a board: the application of every board and its control interrupt, at the simulated motor, in time
//! of its own.

pub mod fault;
mod firmware;
pub mod flash;
pub mod rings;

use anyhow::{Context as _, Result, anyhow};
use fault::ScheduledEvent;
use firmware::Firmware;
use flash::Flash;
use hallservo::board::{Interlock, Output, Sample, TemperatureCode};
use hallservo::commutation::Commutation;
use hallservo::drive::Drive;
use hallservo::mode::Mode;
use hallservo::settings::{Ceiling, Control, GuardSettings, OnTimeout, Settings};
use hallservo_app::{Housekeeping, Identity, Listener, Stop};
use plant::heads::{Defect, Encoder as Rings};
use plant::{BusParameters, Plant, PlantParameters, Truth, Unevenness};
use rig::motors::Motor;
use std::collections::VecDeque;

/// What the board's electronics draw, A.
const ELECTRONICS_A: f64 = 0.02;
/// Both thermistors at 25 °C, 12 bit.
const COOL: TemperatureCode = TemperatureCode::new(2048);

/// A control step of some six microseconds.
const FASTEST_PWM: Ceiling = ("pwm_hz", 80e3);

/// What no setting exceeds: transistors of 40 V that stand 6 A, and no brake resistor.
const CEILINGS: &[Ceiling] = &[
    FASTEST_PWM,
    ("max_current_a", 6.0),
    ("over_current_a", 7.5),
    ("over_voltage_v", 34.0),
    ("bridge_max_c", 110.0),
    ("chopper_v", 0.0),
];

/// What the simulated board has by default: the motor of Simpkins and Todorov, field-oriented; a command holds for a
/// second.
pub fn defaults() -> Settings {
    let guard = GuardSettings { on_timeout: OnTimeout::Stop, ..GuardSettings::default() };
    let control = Control { guard, ..Control::default() };
    Settings {
        commutation: Commutation::FieldOriented,
        ceilings: CEILINGS,
        control: Some(control),
        ..Settings::default()
    }
}

/// A motor, its magnets so many times as uneven as those of a cheap one; the field of the windings is meant at the
/// largest current.
pub fn uneven(plant: PlantParameters, times: f64, seed: u64) -> PlantParameters {
    if times == 0.0 {
        return plant;
    }
    let cheap = Unevenness { rated_a: Control::default().max_current_a.into(), ..Unevenness::CHEAP };
    plant.with_unevenness(&cheap.scaled(times), seed)
}

/// What a board that fits a motor has by default: nothing of the motor but its pole pairs.
pub fn of_motor(motor: &Motor) -> Settings {
    let ceilings = &[FASTEST_PWM];
    let mut settings = Settings { commutation: Commutation::FieldOriented, ceilings, ..motor.settings() };
    if let Some(control) = &mut settings.control {
        control.guard.command_timeout_s = GuardSettings::default().command_timeout_s;
        control.guard.on_timeout = OnTimeout::Stop;
    }
    settings
}

/// From check to check of the watchdog, ms.
const WATCHDOG_MS: u64 = 20;

/// Sees each sample before the drive does, with how things really are, and may change it.
pub type Observe = Box<dyn FnMut(&mut Sample, &Truth)>;

/// A drive, its tasks and its motor.
pub struct Simulator {
    /// The motor.
    pub plant: Plant,
    /// Somebody who looks on.
    pub observe: Option<Observe>,
    firmware: Box<dyn Firmware>,
    housekeeping: Housekeeping,
    stop: Stop,
    listener: Listener,
    flash: Flash,
    now_ms: u64,
    input: VecDeque<u8>,
    output: Vec<u8>,
    fed: u32,
    last: Output,
    digest: u64,
    /// Of the timer, in counts, and its clock.
    period: u16,
    timer_hz: f64,
    /// What the control interrupt is behind the tasks by, s.
    behind_s: f64,
    /// Control periods in the state running, and the time of those that had another length.
    running: u64,
    ran_s: f64,
    planned: Vec<ScheduledEvent>,
    /// What happens to each sample.
    disturbed: Option<fault::Kind>,
    /// Supply, V, and load, N·m, at power-up.
    usual: (f64, f64),
    /// Control periods for which a hand turns the shaft.
    hand: u32,
}

impl Simulator {
    /// At power-up, an imperfect motor at rest.
    ///
    /// # Errors
    /// What is wrong with the defaults.
    pub fn new(seed: u64, flash: Flash, planned: Vec<ScheduledEvent>) -> Result<Self> {
        Self::at(&PlantParameters::imperfect(seed), seed, flash, planned)
    }

    /// The same at any motor.
    ///
    /// # Errors
    /// What is wrong with the motor's parameters.
    pub fn at(plant: &PlantParameters, seed: u64, flash: Flash, planned: Vec<ScheduledEvent>) -> Result<Self> {
        Self::with(defaults(), plant, seed, flash, planned)
    }

    /// The same with the settings of a board, whose PWM the motor has to have.
    ///
    /// # Errors
    /// What is wrong with the settings or the motor's parameters.
    pub fn with(
        settings: Settings,
        plant: &PlantParameters,
        seed: u64,
        flash: Flash,
        planned: Vec<ScheduledEvent>,
    ) -> Result<Self> {
        Self::with_rings(settings, plant, None, seed, flash, planned)
    }

    /// The same with rings on the motor's shaft.
    ///
    /// # Errors
    /// What is wrong with the settings or the motor's parameters.
    pub fn with_rings(
        settings: Settings,
        plant: &PlantParameters,
        rings: Option<Rings>,
        seed: u64,
        flash: Flash,
        planned: Vec<ScheduledEvent>,
    ) -> Result<Self> {
        let mut settings = settings;
        // The vernier's share in the steps is planned once, for the board's own frequency.
        if let (Some(_), Some((&FASTEST_PWM, others))) = (&rings, settings.ceilings.split_first()) {
            settings.ceilings = others;
        }
        let config = settings.validate().context("the settings")?;
        let usual = (plant.bus.supply_v, plant.motor.load_nm);
        let bus = BusParameters { electronics_a: ELECTRONICS_A, ..plant.bus };
        let plant = PlantParameters { bus, ..*plant };
        let mut plant = Plant::new(&plant, seed).map_err(|error| anyhow!("the motor: {error}"))?;
        plant.place(0.3, 0.0)?;
        let version = env!("CARGO_PKG_VERSION");
        let identity = Identity { board: "simulated", firmware: version, serial: flash.serial() };
        let firmware = firmware::start(identity, settings, flash.clone(), rings)?;
        Ok(Self {
            plant,
            observe: None,
            firmware,
            housekeeping: Housekeeping::new(),
            stop: Stop::new(),
            listener: Listener::new(),
            flash,
            now_ms: 0,
            input: VecDeque::new(),
            output: Vec::new(),
            fed: 0,
            last: Output::OFF,
            digest: 0xcbf2_9ce4_8422_2325,
            period: config.period,
            timer_hz: settings.timer_hz.into(),
            behind_s: 0.0,
            running: 0,
            ran_s: 0.0,
            planned,
            disturbed: None,
            usual,
            hand: 0,
        })
    }

    /// A millisecond of the drive's life.
    pub fn step(&mut self) {
        self.neglect();
        self.tasks();
    }

    /// Something happens, now.
    ///
    /// # Errors
    /// A number that the motor refuses.
    pub fn happen(&mut self, kind: fault::Kind) -> Result<()> {
        match kind {
            fault::Kind::Turn(turns) => return self.turn_by_hand(turns),
            fault::Kind::Hot | fault::Kind::Late => self.disturbed = Some(kind),
            fault::Kind::Mend => return self.mend(),
            fault::Kind::Rings(defect) => return self.break_rings(defect),
            _ => {}
        }
        kind.act(&mut self.plant)
    }

    /// Something breaks of the rings, or they are mended.
    fn break_rings(&mut self, defect: Option<Defect>) -> Result<()> {
        let rings = self.firmware.rings().context("this drive has no rings: simulate it with --encoder 37/45")?;
        match defect {
            Some(defect) => rings.suffer(defect),
            None => rings.mend(),
        }
        Ok(())
    }

    /// Everything is as at power-up, but for the rotor.
    fn mend(&mut self) -> Result<()> {
        self.disturbed = None;
        self.firmware.rings().into_iter().for_each(Rings::mend);
        (0..3).for_each(|hall| self.plant.set_hall_fault(hall, None));
        let (supply_v, load_nm) = self.usual;
        self.plant.set_supply(supply_v)?;
        Ok(self.plant.set_load(load_nm)?)
    }

    /// Time since power-up, ms.
    pub const fn now_ms(&self) -> u64 {
        self.now_ms
    }

    /// Bytes that the drive has not taken yet.
    pub fn backlog(&self) -> usize {
        self.input.len()
    }

    /// A hand takes the shaft, turns it by so many turns, negative ones backwards, and lets it go: a turn takes a
    /// second.
    ///
    /// # Errors
    /// A number of turns that is not finite.
    pub fn turn_by_hand(&mut self, turns: f64) -> Result<()> {
        self.plant.set_dyno(Some(std::f64::consts::TAU.copysign(turns)))?;
        self.hand = (turns.abs() / self.plant.period_s()).round() as u32;
        Ok(())
    }

    /// A period of the hand, which stops the shaft before it lets it go.
    fn hold(&mut self) {
        if self.hand > 0 {
            self.hand -= 1;
            if self.hand == 0 {
                let stopped = self.plant.set_dyno(Some(0.0)).and_then(|()| self.plant.set_dyno(None));
                debug_assert!(stopped.is_ok(), "both speeds are finite");
            }
        }
    }

    /// A millisecond in which the control interrupt does not come.
    pub fn stall(&mut self) {
        self.tasks();
    }

    /// A millisecond in which the tasks have no time.
    pub fn neglect(&mut self) {
        self.behind_s += 1e-3;
        while self.behind_s > 0.5 * self.plant.period_s() {
            self.behind_s -= self.plant.period_s();
            self.period();
        }
    }

    /// The tasks' share of a millisecond, as a main loop would do it.
    fn tasks(&mut self) {
        self.now_ms += 1;
        let tasks = self.firmware.tasks();
        tasks.tick(self.now_ms, self.housekeeping.read());
        if let Some(dealt) = tasks.dealt_with() {
            self.stop.release(&dealt);
        }
        let taken = tasks.receive(self.input.make_contiguous());
        self.input.drain(..taken);
        let mut bytes = [0; 64];
        loop {
            match tasks.transmit(&mut bytes) {
                0 => break,
                length => self.output.extend(&bytes[..length]),
            }
        }
        if self.now_ms.is_multiple_of(WATCHDOG_MS) && tasks.is_alive() {
            self.fed += 1;
        }
    }

    /// The control interrupt.
    fn period(&mut self) {
        let plant::Codes { halls, currents, bus } = self.plant.sample();
        let mut sample = Sample { halls, currents, bus, temperatures: [COOL; 2], ..Sample::default() };
        if let Some(kind) = self.disturbed {
            kind.disturb(&mut sample);
        }
        if let Some(observe) = &mut self.observe {
            observe(&mut sample, &self.plant.truth());
        }
        self.housekeeping.update(&sample);
        let interlock = self.stop.holds().then_some(Interlock::Stop);
        self.last = self.firmware.step(&sample, interlock, self.plant.mechanical_angle_rad());
        let [a, b, c] = self.last.compare;
        for word in [a, b, c, self.last.legs.bits().into()] {
            self.digest = (self.digest ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3);
        }
        self.plant.advance(&rig::legs(&self.last, self.period));
        self.hold();
        if self.firmware.drive().mode() == Mode::Running {
            self.running += 1;
            self.inject();
        }
        if self.firmware.drive().period() != self.period {
            self.retime();
        }
    }

    /// The timer takes up what the drive's settings say, as on a board.
    fn retime(&mut self) {
        self.ran_s += self.running as f64 * self.plant.period_s();
        self.running = 0;
        self.period = self.firmware.drive().period();
        let pwm_hz = self.timer_hz / (2.0 * f64::from(self.period));
        self.plant.set_pwm(pwm_hz).expect("what the settings allow, the motor's bridge can do");
    }

    /// Faults whose time has come.
    fn inject(&mut self) {
        let seconds = self.ran_s + self.running as f64 * self.plant.period_s();
        while let Some(at) = self.planned.iter().position(|planned| planned.after_s <= seconds) {
            let kind = self.planned.swap_remove(at).kind;
            // The numbers are finite, and the motor takes any.
            let done = self.happen(kind);
            debug_assert!(done.is_ok(), "{kind:?}: {done:?}");
        }
    }

    /// Bytes to the drive.
    pub fn write(&mut self, bytes: &[u8]) {
        self.input.extend(bytes);
        bytes.iter().for_each(|byte| self.listener.hear(*byte, true, &self.stop));
    }

    /// Bytes from the drive since the last call.
    pub fn read(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.output)
    }

    /// What the control interrupt wrote to the timer last.
    pub const fn output(&self) -> &Output {
        &self.last
    }

    /// A digest (FNV-1a, a word at a time) of all that it ever wrote: two drives with the same have turned their motors
    /// alike.
    pub const fn digest(&self) -> u64 {
        self.digest
    }

    /// What its flash holds.
    pub fn flash(&self) -> Vec<u8> {
        self.flash.bytes()
    }

    /// The drive, to look at.
    pub fn drive(&self) -> &Drive {
        self.firmware.drive()
    }

    /// The rings on its shaft, to break them.
    pub fn rings(&mut self) -> Option<&mut Rings> {
        self.firmware.rings()
    }

    /// How often the watchdog was fed.
    pub const fn fed(&self) -> u32 {
        self.fed
    }
}
