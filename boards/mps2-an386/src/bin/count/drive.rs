//! Everything that the control interrupt does, on a rotor that turns steadily.

use crate::call::{Arguments, Results};
use crate::halls;
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::board::{Output, Sample, TemperatureCode};
use hallservo::commutation::{Commutation, Modulation};
use hallservo::config::Config;
use hallservo::drive::{Channels, Command, Drive, Tasks};
use hallservo::hall::estimate::Estimator;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use mps2_an386::failure;
use static_cell::StaticCell;

pub const ROWS: &[Row] = &[
    Row::new("Drive::step, running", "hallservo", function!(step), running, no_error).budget(150),
    Row::new("Drive::step, field-oriented, current", "hallservo", function!(step), with_current, stays_on).budget(318),
    Row::new("Drive::step, field-oriented, speed", "hallservo", function!(step), with_speed, stays_on).budget(318),
    Row::new("Drive::step, field-oriented, position", "hallservo", function!(step), with_position, stays_on)
        .budget(318),
    Row::new("Drive::step, with a command", "hallservo", function!(step), commanded, no_error),
    Row::new("Drive::step, a Hall at a rail", "hallservo", function!(step), blind, no_error),
];

/// What the interrupt of a board does between reading the ADC and writing the timer. The only caller of the library's
/// function, into which it is inlined as into the interrupt.
#[unsafe(no_mangle)]
#[inline(never)]
pub extern "C" fn step(drive: &mut Drive, sample: &Sample, output: &mut Output) {
    *output = drive.step(sample);
}

struct Bench {
    drive: Drive,
    tasks: Tasks,
    sample: Sample,
    output: Output,
}

/// What the drives follow: a voltage, a current, a speed, a position.
const DEMANDS: usize = 4;
static BENCHES: [AtomicPtr<Bench>; DEMANDS] = [const { AtomicPtr::new(core::ptr::null_mut()) }; DEMANDS];

/// Steps in which a drive arms, without its check.
const ARMING: u32 = 32;

/// Drives that run, with telemetry at 1 kHz: one by sinusoidal, the others by field-oriented commutation.
pub fn init() {
    static PLACES: [StaticCell<Bench>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static ESTIMATORS: [StaticCell<Estimator>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static CHANNELS: [StaticCell<Channels>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    for number in 0..DEMANDS {
        let settings = if number == 0 { Settings::default() } else { field_oriented() };
        let Ok(config) = settings.validate() else { failure() };
        let (interrupt, tasks) = CHANNELS[number].init(Channels::new()).split();
        let drive = Drive::new(config, interrupt);
        let bench = PLACES[number].init(Bench { drive, tasks, sample: Sample::default(), output: Output::OFF });
        bench.sample = sample();
        let demand = demand(number, &config);
        for command in [Command::Install(ESTIMATORS[number].init(halls::new_estimator())), Command::Arm, demand] {
            bench.send(command);
            bench.obeyed();
        }
        for _ in 0..ARMING {
            step(&mut bench.drive, &bench.sample, &mut bench.output);
        }
        BENCHES[number].store(bench, Relaxed);
    }
}

/// With sensors and motor that stand still, whatever is done to them.
pub fn field_oriented() -> Settings {
    let guard = GuardSettings { command_timeout_s: 60.0, arming_check: false, ..GuardSettings::default() };
    Settings {
        commutation: Commutation::FieldOriented,
        control: Some(Control {
            // Nothing answers the drive here: with this resistance, half an ampere explains any voltage.
            resistance_ohm: 12.0,
            field_weakening_a: 2.0,
            following_error_turns: 1e6,
            following_error_rad_s: 1e6,
            guard,
            ..Control::default()
        }),
        ..Settings::default()
    }
}

/// 24 V, 25 °C, no current, the rotor at zero.
pub fn sample() -> Sample {
    Sample {
        halls: halls::model_codes(0),
        currents: [2048; 3],
        bus: 2708,
        temperatures: [TemperatureCode::new(2048); 2],
        ..Sample::default()
    }
}

/// What a drive follows.
pub fn demand(number: usize, config: &Config) -> Command {
    let demand = match (number, &config.control) {
        (1, Some(control)) => control.current(2.0).map(Command::Current),
        (2, Some(control)) => control.speed(300.0).map(Command::Speed),
        (3, Some(control)) => control.position(1e6).map(Command::Position),
        _ => Ok(Command::Drive(Modulation::from_num(0.5))),
    };
    demand.unwrap_or_else(|_| failure())
}

/// Half an ampere flows with the rotor, which is at an electrical angle.
pub fn turn_to(sample: &mut Sample, angle: u32) {
    let turns = f64::from(angle) / 4_294_967_296.0;
    for (k, code) in sample.currents.iter_mut().enumerate() {
        *code = (2048.5 - 124.0 * libm::sin((turns - k as f64 / 3.0) * core::f64::consts::TAU)) as u16;
    }
    sample.halls = halls::model_codes(angle);
}

impl Bench {
    fn send(&mut self, command: Command) {
        if self.tasks.commands.enqueue(command).is_err() {
            failure();
        }
    }

    fn obeyed(&mut self) {
        let reply = loop {
            step(&mut self.drive, &self.sample, &mut self.output);
            if let Some(reply) = self.tasks.replies.dequeue() {
                break reply;
            }
        };
        if reply.is_err() {
            failure();
        }
    }
}

fn bench(number: usize) -> &'static mut Bench {
    // SAFETY: null, or what `init` leaked; one thread, and no reference outlives the function that asked for it.
    unsafe { BENCHES[number].load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

/// One turn in the whole sweep; the tasks keep up.
fn running(index: u32) -> Arguments {
    turning(0, index)
}

fn with_current(index: u32) -> Arguments {
    turning(1, index)
}

fn with_speed(index: u32) -> Arguments {
    turning(2, index)
}

fn with_position(index: u32) -> Arguments {
    turning(3, index)
}

/// What is asked for is not reached, so the voltage comes to its limit.
fn turning(number: usize, index: u32) -> Arguments {
    let bench = bench(number);
    while bench.tasks.measurements.dequeue().is_some() {}
    while bench.tasks.records.dequeue().is_some() {}
    while bench.tasks.replies.dequeue().is_some() {}
    turn_to(&mut bench.sample, index << 18);
    let pointers = [(&raw mut bench.drive).addr(), (&raw const bench.sample).addr(), (&raw mut bench.output).addr(), 0];
    Arguments { r: pointers.map(|address| address as u32), ..Default::default() }
}

/// Every other step, so that those that had to wait are obeyed, too.
fn commanded(index: u32) -> Arguments {
    if index.is_multiple_of(2) {
        let command = if index.is_multiple_of(4) { 0.5 } else { -0.5 };
        bench(0).send(Command::Drive(Modulation::from_num(command)));
    }
    running(index)
}

/// Fewer in a row than make a fault.
fn blind(index: u32) -> Arguments {
    let arguments = running(index);
    if !index.is_multiple_of(8) {
        bench(0).sample.halls[1] = 4095;
    }
    arguments
}

/// The outputs are compared bit for bit elsewhere.
fn no_error(_: &Arguments, _: &Results) -> f64 {
    if bench(0).drive.mode() == Mode::Running { 0.0 } else { failure() }
}

fn stays_on(_: &Arguments, _: &Results) -> f64 {
    for number in 1..DEMANDS {
        let mode = bench(number).drive.mode();
        if mode != Mode::Running {
            defmt::error!("demand {}: {}", number, mode);
            failure();
        }
    }
    0.0
}
