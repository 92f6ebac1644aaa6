//! The field-oriented step where it has most to do: fast, accelerating and turning back on the way, with the alignment
//! refined and a table against cogging; stalled; and with a command.

use crate::call::{Arguments, Results};
use crate::drive::step;
use crate::halls;
use crate::motor::{INERTIA_KGM2, Motor};
use crate::row::{Row, SWEEP, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::angle::{ElectricalAngle, PolePairs};
use hallservo::board::{Output, Sample, TemperatureCode};
use hallservo::commutation::Commutation;
use hallservo::config::Config;
use hallservo::control::cogging;
use hallservo::control::config::Config as Control;
use hallservo::control::impedance::{Impedance, Motion, Request};
use hallservo::drive::{Channels, Command, Drive, Tasks};
use hallservo::hall::estimate::Estimator;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use hallservo::settings::{Control as ControlSettings, GuardSettings};
use hallservo::turn::{Live, Table, WHOLE};
use mps2_an386::failure;
use static_cell::StaticCell;

pub const ROWS: &[Row] = &[
    Row::new("field-oriented, fast, current", "hallservo", function!(step), fast::<CURRENT>, stays_on).budget(318),
    Row::new("field-oriented, fast, speed", "hallservo", function!(step), fast::<SPEED>, stays_on).budget(318),
    Row::new("field-oriented, fast, position", "hallservo", function!(step), fast::<POSITION>, stays_on).budget(318),
    Row::new("field-oriented, fast, impedance", "hallservo", function!(step), fast::<IMPEDANCE>, stays_on).budget(323),
    Row::new("field-oriented, stalled, current", "hallservo", function!(step), stalled::<CURRENT>, stays_on)
        .budget(318),
    Row::new("field-oriented, stalled, speed", "hallservo", function!(step), stalled::<SPEED>, stays_on).budget(318),
    Row::new("field-oriented, stalled, position", "hallservo", function!(step), stalled::<POSITION>, stays_on)
        .budget(318),
    Row::new("field-oriented, stalled, impedance", "hallservo", function!(step), stalled::<IMPEDANCE>, stays_on)
        .budget(318),
    Row::new("field-oriented, with a table, current", "hallservo", function!(step), anti_cogging::<CURRENT>, stays_on)
        .budget(318),
    Row::new("field-oriented, with a table, speed", "hallservo", function!(step), anti_cogging::<SPEED>, stays_on)
        .budget(318),
    Row::new(
        "field-oriented, with a table, position",
        "hallservo",
        function!(step),
        anti_cogging::<POSITION>,
        stays_on,
    )
    .budget(318),
    Row::new(
        "field-oriented, with a table, impedance",
        "hallservo",
        function!(step),
        anti_cogging::<IMPEDANCE>,
        stays_on,
    )
    .budget(318),
    Row::new("field-oriented, fast, with a map and all tables, speed", "hallservo", function!(step), mapped, stays_on)
        .budget(362),
    Row::new("field-oriented, fast, with two currents, speed", "hallservo", function!(step), with_two, stays_on)
        .budget(655),
    Row::new("field-oriented, with a command", "hallservo", function!(step), commanded, stays_on),
];

const CURRENT: usize = 0;
const SPEED: usize = 1;
const POSITION: usize = 2;
/// A spring and a damper.
const IMPEDANCE: usize = 3;
/// A speed, with a map of the magnets.
const MAPPED: usize = 4;
/// A speed, with vectors for which one current is not sampled.
const TWO: usize = 5;
const DEMANDS: usize = 6;

/// A, rad/s and turns, one after the other. A current of 3 A ends where the voltage does; on the way to a speed or a
/// far position it turns back; near ones are reached, one by three steps of the trajectory.
const FOLLOWED: [[f64; PARTS as usize]; 3] = [
    [0.5, 0.5, -0.5, -0.5, 2.0, 2.0, -3.0, -3.0, 3.0, 0.5, -0.5, 3.0, 0.01, -0.01, 3.0, -3.0],
    [400.0, 400.0, -400.0, -400.0, 0.0, -200.0, 399.0, 400.0, 401.0, -500.0, -500.0, 5.0, -5.0, 0.0, 400.0, -400.0],
    [30.0, 30.0, -30.0, -30.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.100_24, 0.13, 0.0, -0.08, 30.0, 30.0, -30.0],
];

/// Where the reference of a spring goes, turns, with what speed, rad/s, and whether at once: to a position, one that
/// moves, with a speed, up to a stop, and within a range.
const REFERENCES: [Motion; PARTS as usize] = [
    travel(None, 400.0, None),
    travel(None, 400.0, None),
    travel(None, -400.0, None),
    travel(None, -400.0, None),
    travel(Some(0.0), 0.0, None),
    travel(Some(5.0), 0.0, None),
    travel(Some(-5.0), 0.0, None),
    travel(Some(0.1), 0.0, None),
    Motion::Within { least_turns: Some(-0.01), most_turns: Some(0.01) },
    Motion::Within { least_turns: None, most_turns: Some(-0.5) },
    Motion::Within { least_turns: Some(0.3), most_turns: None },
    travel(None, 300.0, Some(2.0)),
    travel(None, -300.0, Some(0.0)),
    Motion::To {
        position_turns: Some(0.5),
        speed_rad_s: 100.0,
        stop_turns: None,
        max_speed_rad_s: Some(f32::INFINITY),
        max_acceleration_rad_s2: Some(f32::INFINITY),
    },
    travel(Some(100.0), 0.0, None),
    travel(Some(-100.0), 0.0, None),
];

const fn travel(position_turns: Option<f64>, speed_rad_s: f32, stop_turns: Option<f64>) -> Motion {
    Motion::To { position_turns, speed_rad_s, stop_turns, max_speed_rad_s: None, max_acceleration_rad_s2: None }
}

/// Parts of a sweep, each with its demand.
const PARTS: u32 = 16;
const PART: u32 = SWEEP / PARTS;

struct Bench {
    drive: Drive,
    tasks: Tasks,
    sample: Sample,
    output: Output,
    motor: Motor,
    config: Config,
    control: Control,
    impedance: Option<&'static mut Impedance>,
    table: Option<&'static mut cogging::Table>,
    estimator: Option<&'static mut Estimator>,
    /// What a sweep has seen: speeds either way, the alignment moved.
    fastest: [f32; 2],
    trimmed: bool,
    /// Steps with a vector for which one current is not sampled.
    long: u32,
    /// The highest compare value of a phase that is sampled.
    sampled: u16,
}

static MAP: Live = Live::new();
static COGGING: Live = Live::new();
static BENCHES: [AtomicPtr<Bench>; DEMANDS] = [const { AtomicPtr::new(core::ptr::null_mut()) }; DEMANDS];

/// Armed drives.
pub fn init() {
    static PLACES: [StaticCell<Bench>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static ESTIMATORS: [[StaticCell<Estimator>; DEMANDS]; 2] = [const { [const { StaticCell::new() }; DEMANDS] }; 2];
    static IMPEDANCES: [[StaticCell<Impedance>; DEMANDS]; 2] = [const { [const { StaticCell::new() }; DEMANDS] }; 2];
    static TABLES: [StaticCell<cogging::Table>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static CHANNELS: [StaticCell<Channels>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    // No timeout is reached, but it is looked at.
    // The motor is there for its arithmetic, and is not followed: no check of it may end the count.
    let guard = GuardSettings { command_timeout_s: 60.0, arming_check: false, ..GuardSettings::default() };
    let control = ControlSettings {
        inertia_kgm2: INERTIA_KGM2,
        max_acceleration_rad_s2: 1.5e4,
        following_error_turns: 1e6,
        following_error_rad_s: 1e6,
        guard,
        ..ControlSettings::default()
    };
    let settings = Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() };
    for number in 0..DEMANDS {
        let settings = Settings {
            sampling_window_s: if number == TWO { 10e-6 } else { settings.sampling_window_s },
            least_low_side_s: if number == TWO { 1e-6 } else { 0.0 },
            ..settings
        };
        let Ok(config) = settings.validate() else { failure() };
        let Some(control) = config.control else { failure() };
        let Ok(limits) = settings.limits(config.period) else { failure() };
        let (interrupt, tasks) = CHANNELS[number].init(Channels::new()).split();
        let mut table = cogging::Table::ZERO;
        for (point, current) in table.0.iter_mut().enumerate() {
            *current = (point * 97 % 401) as i16 - 200;
        }
        let drive = Drive::new(config, interrupt);
        let bench = PLACES[number].init(Bench {
            drive: if number == MAPPED { drive.with_map(&MAP).with_cogging(&COGGING) } else { drive },
            tasks,
            // 24 V.
            sample: Sample { bus: 2708, ..Sample::default() },
            output: Output::OFF,
            motor: Motor::new(),
            config,
            control,
            impedance: Some(IMPEDANCES[1][number].init(Impedance::NONE)),
            table: Some(TABLES[number].init(table)),
            estimator: Some(ESTIMATORS[0][number].init(halls::new_estimator())),
            fastest: [0.0; 2],
            trimmed: false,
            long: 0,
            sampled: limits.high(),
        });
        bench.heat(0);
        bench.command(Command::Install(ESTIMATORS[1][number].init(halls::new_estimator())));
        bench.command(Command::Arm);
        // The drive has one, so that it gives one back.
        let Ok(impedance) = bench.config.impedance(&Request::default()) else { failure() };
        bench.command(Command::Impedance(IMPEDANCES[0][number].init(impedance)));
        bench.prove();
        BENCHES[number].store(bench, Relaxed);
    }
}

impl Bench {
    /// A period on.
    fn advance(&mut self) {
        self.motor.step(&self.output);
        self.motor.sense(&mut self.sample);
        while self.tasks.measurements.dequeue().is_some() {}
        while self.tasks.records.dequeue().is_some() {}
        self.long += u32::from(self.output.compare.iter().any(|&compare| compare > self.sampled));
        let [forward, backward] = &mut self.fastest;
        *forward = forward.max(self.motor.speed);
        *backward = backward.max(-self.motor.speed);
    }

    fn send(&mut self, command: Command) {
        if self.tasks.commands.enqueue(command).is_err() {
            failure();
        }
    }

    /// Sends a command; steps until it has been obeyed, which are not counted.
    fn command(&mut self, command: Command) {
        self.send(command);
        let reply = loop {
            self.advance();
            step(&mut self.drive, &self.sample, &mut self.output);
            if let Some(reply) = self.tasks.replies.dequeue() {
                break reply;
            }
        };
        if reply.is_err() {
            failure();
        }
    }

    /// Turns for so long that the drive believes its commutation, which is not counted: only then the alignment is trimmed.
    fn prove(&mut self) {
        let speed = self.demand(SPEED, 0);
        self.command(speed);
        for _ in 0..SWEEP {
            self.advance();
            step(&mut self.drive, &self.sample, &mut self.output);
        }
        while self.tasks.replies.dequeue().is_some() {}
    }

    /// Cold, or bridge and motor so warm that they reduce the current a little.
    fn heat(&mut self, part: u32) {
        self.sample.temperatures =
            if part.is_multiple_of(2) { [2048; 2] } else { [600, 450] }.map(TemperatureCode::new);
    }

    /// At the begin of each part its demand; then the next period.
    fn prepare(&mut self, followed: usize, index: u32) -> Arguments {
        if index.is_multiple_of(PART) {
            let part = index / PART;
            self.heat(part);
            let demand = self.demand(followed, part);
            self.command(demand);
        }
        self.advance();
        self.trimmed |= self.drive.trim() != ElectricalAngle::ZERO;
        let pointers =
            [(&raw mut self.drive).addr(), (&raw const self.sample).addr(), (&raw mut self.output).addr(), 0];
        Arguments { r: pointers.map(|address| address as u32), ..Default::default() }
    }
}

impl Bench {
    fn demand(&mut self, followed: usize, part: u32) -> Command {
        let followed = if followed >= MAPPED { SPEED } else { followed };
        if followed == IMPEDANCE {
            return self.impedance(part);
        }
        let value = FOLLOWED[followed][part as usize];
        let demand = match followed {
            CURRENT => self.control.current(value as f32).map(Command::Current),
            SPEED => self.control.speed(value as f32).map(Command::Speed),
            _ => self.control.position(value).map(Command::Position),
        };
        demand.unwrap_or_else(|_| failure())
    }

    fn impedance(&mut self, part: u32) -> Command {
        let place = self.tasks.impedances.dequeue().or(self.impedance.take());
        let request = Request { feed_forward_nm: 1e-3, motion: REFERENCES[part as usize], ..Request::default() };
        let (Some(place), Ok(impedance)) = (place, self.config.impedance(&request)) else { failure() };
        *place = impedance;
        Command::Impedance(place)
    }

    /// Takes a table into use, or none.
    fn set_anti_cogging(&mut self, table: Option<&'static mut cogging::Table>) {
        self.command(Command::AntiCogging(table));
        self.table = self.tasks.tables.dequeue().or(self.table.take());
    }

    /// That a sweep has met what it is there for: 200 Hz electrical either way, and the alignment moved.
    fn was_fast(&self) {
        if self.fastest.iter().any(|&speed| speed < 315.0) || !self.trimmed {
            defmt::error!("not fast enough, or never trimmed: {} {}", self.fastest, self.trimmed);
            failure();
        }
    }
}

fn bench(number: usize) -> &'static mut Bench {
    // SAFETY: null, or what `init` leaked; one thread, and no reference outlives the function that asked for it.
    unsafe { BENCHES[number].load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

/// There and back at several hundred hertz electrical.
fn fast<const FOLLOWED: usize>(index: u32) -> Arguments {
    let bench = bench(FOLLOWED);
    bench.motor.locked = false;
    let arguments = bench.prepare(FOLLOWED, index);
    if index == SWEEP - 1 {
        bench.was_fast();
    }
    arguments
}

/// The same with a table against cogging.
fn anti_cogging<const FOLLOWED: usize>(index: u32) -> Arguments {
    let bench = bench(FOLLOWED);
    if index == 0 {
        let table = bench.table.take();
        bench.set_anti_cogging(table);
    }
    fast::<FOLLOWED>(index)
}

/// The same with a map of the magnets in effect, and with all that there is against cogging.
fn mapped(index: u32) -> Arguments {
    if index == 0 {
        let Some(pole_pairs) = PolePairs::new(4) else { failure() };
        for (live, most) in [(&MAP, 800), (&COGGING, 200)] {
            let points =
                (0..Table::points_for(pole_pairs)).map(|point| (point * 97 % (2 * most + 1)) as i16 - most as i16);
            let Some(table) = Table::of_points(pole_pairs, points) else { failure() };
            live.load(&table);
            live.use_from(1, live.count(), WHOLE);
        }
    }
    if !MAP.is_used() || !COGGING.is_used() {
        failure();
    }
    anti_cogging::<MAPPED>(index)
}

/// With vectors of which a part is too long for three currents.
fn with_two(index: u32) -> Arguments {
    let arguments = fast::<TWO>(index);
    if index == SWEEP - 1 && bench(TWO).long < SWEEP / 20 {
        defmt::error!("long vectors in {} steps only", bench(TWO).long);
        failure();
    }
    arguments
}

/// The rotor is held.
fn stalled<const FOLLOWED: usize>(index: u32) -> Arguments {
    let bench = bench(FOLLOWED);
    bench.motor.locked = true;
    bench.prepare(FOLLOWED, index)
}

/// While the speed is followed, now and then a new model, which an adaptation has learnt, or a table, or another speed.
fn commanded(index: u32) -> Arguments {
    let bench = bench(SPEED);
    while bench.tasks.replies.dequeue().is_some() {}
    if let Some(estimator) = bench.tasks.retired.dequeue() {
        bench.estimator = Some(estimator);
    }
    if let Some(table) = bench.tasks.tables.dequeue() {
        bench.table = Some(table);
    }
    let arguments = fast::<SPEED>(index);
    match index % 64 {
        40 => {
            let Some(estimator) = bench.estimator.take() else { failure() };
            bench.send(Command::Install(estimator));
        }
        48 => {
            let table = bench.table.take();
            bench.send(Command::AntiCogging(table));
        }
        56 => {
            let speed = bench.demand(SPEED, index / PART);
            bench.send(speed);
        }
        _ => {}
    }
    arguments
}

fn stays_on(_: &Arguments, _: &Results) -> f64 {
    for number in 0..DEMANDS {
        let mode = bench(number).drive.mode();
        if mode != Mode::Running {
            defmt::error!("demand {}: {}", number, mode);
            failure();
        }
    }
    0.0
}
