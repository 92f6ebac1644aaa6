//! The field-oriented step with two rings under two heads each beside the Halls, which close the loops.

use crate::call::{Arguments, Results};
use crate::drive::{demand, field_oriented, sample, turn_to};
use crate::halls;
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::angle::{ElectricalAngle, MechanicalAngle, PolePairs};
use hallservo::board::{Output, Sample};
use hallservo::config::Config;
use hallservo::drive::absolute::{AbsoluteChannels, AbsoluteDrive, AbsoluteTasks, Mounting};
use hallservo::drive::{Channels, Command, Drive, Tasks};
use hallservo::hall::estimate::Estimator;
use hallservo::mode::Mode;
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use mps2_an386::failure;
use static_cell::StaticCell;

type Rotor = Encoder<2>;

pub const ROWS: &[Row] = &[
    Row::new("AbsoluteDrive::step, field-oriented, current", "hallservo", function!(absolute_step), current, stays_on)
        .budget(612),
    Row::new("AbsoluteDrive::step, field-oriented, speed", "hallservo", function!(absolute_step), speed, stays_on)
        .budget(612),
    Row::new(
        "AbsoluteDrive::step, field-oriented, position",
        "hallservo",
        function!(absolute_step),
        position,
        stays_on,
    )
    .budget(612),
];

#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn absolute_step(
    drive: &mut AbsoluteDrive<Rotor>,
    sample: &Sample,
    reading: &Reading<2>,
    output: &mut Output,
) {
    *output = drive.step(sample, *reading);
}

struct Bench {
    drive: AbsoluteDrive<Rotor>,
    tasks: Tasks,
    absolute: AbsoluteTasks<Rotor>,
    sample: Sample,
    reading: Reading<2>,
    output: Output,
}

/// Current, speed and position.
const DEMANDS: usize = 3;
static BENCHES: [AtomicPtr<Bench>; DEMANDS] = [const { AtomicPtr::new(core::ptr::null_mut()) }; DEMANDS];
const POLE_PAIRS: u32 = 4;
/// Samples for the tasks, as on the boards: 5 kHz of 40.
const EVERY: u32 = 8;

/// Drives that follow, each with an encoder that a turn has proved.
pub fn init() {
    static PLACES: [StaticCell<Bench>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static ESTIMATORS: [StaticCell<Estimator>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static ENCODERS: [StaticCell<Rotor>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static CHANNELS: [StaticCell<Channels>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    static ABSOLUTE: [StaticCell<AbsoluteChannels<Rotor>>; DEMANDS] = [const { StaticCell::new() }; DEMANDS];
    for number in 0..DEMANDS {
        let Ok(config) = field_oriented().validate() else { failure() };
        let (interrupt, tasks) = CHANNELS[number].init(Channels::new()).split();
        let (ends, absolute) = ABSOLUTE[number].init(AbsoluteChannels::new()).split();
        let drive = AbsoluteDrive::new(Drive::new(config, interrupt), ends, EVERY);
        let reading = reading(0);
        let bench =
            PLACES[number].init(Bench { drive, tasks, absolute, sample: sample(), reading, output: Output::OFF });
        bench.command(Command::Install(ESTIMATORS[number].init(halls::new_estimator())));
        bench.mount(ENCODERS[number].init(encoder()));
        bench.command(Command::Arm);
        bench.command(demand_of(number, &config));
        // A turn of the shaft, which takes the encoder's proof.
        for step in 0..POLE_PAIRS << 12 {
            bench.turn_to(step << 20, step << 18);
            bench.step();
        }
        bench.turn_to(0, 0);
        bench.step();
        if !bench.drive.is_proven() {
            failure();
        }
        BENCHES[number].store(bench, Relaxed);
    }
}

fn demand_of(number: usize, config: &Config) -> Command {
    demand(number + 1, config)
}

fn encoder() -> Rotor {
    let Ok(rings) = Rings::new(37, 45, 12) else { failure() };
    let made = Encoder::new(&rings, &Calibration::ideal(&rings), MechanicalAngle::from_degrees(1.0));
    made.unwrap_or_else(|_| failure())
}

/// The readings at an angle of the shaft; the second head of a ring is opposite.
fn reading(shaft: u32) -> Reading<2> {
    let of = |pairs: u32| [0, 1 << 31].map(|head| (pairs.wrapping_mul(shaft.wrapping_add(head)) >> 16) as u16 & 0xFFF0);
    Reading { reference: of(37), vernier: of(45) }
}

impl Bench {
    fn turn_to(&mut self, electrical: u32, shaft: u32) {
        turn_to(&mut self.sample, electrical);
        self.reading = reading(shaft);
    }

    fn step(&mut self) {
        absolute_step(&mut self.drive, &self.sample, &self.reading, &mut self.output);
        self.drain();
    }

    /// The tasks keep up.
    fn drain(&mut self) {
        while self.tasks.measurements.dequeue().is_some() {}
        while self.tasks.records.dequeue().is_some() {}
        while self.absolute.take().is_some() {}
    }

    fn command(&mut self, command: Command) {
        if self.tasks.commands.enqueue(command).is_err() {
            failure();
        }
        loop {
            self.step();
            match self.tasks.replies.dequeue() {
                None => {}
                Some(Ok(())) => return,
                Some(Err(_)) => failure(),
            }
        }
    }

    /// The encoder counts, and closes the loops.
    fn mount(&mut self, encoder: &'static mut Rotor) {
        let Some(pole_pairs) = PolePairs::new(POLE_PAIRS as u8) else { failure() };
        let mounting = Mounting {
            pole_pairs,
            reversed: false,
            zero: MechanicalAngle::ZERO,
            offset: ElectricalAngle::ZERO,
            tolerance: ElectricalAngle::from_degrees(30.0),
            closes_loops: true,
            falls_back: false,
        };
        let sent = self.absolute.install(encoder).is_ok() && self.absolute.mount(Some(mounting));
        (0..EVERY).for_each(|_| self.step());
        if !sent || !self.absolute.count() {
            failure();
        }
        (0..EVERY).for_each(|_| self.step());
    }
}

fn bench(number: usize) -> &'static mut Bench {
    // SAFETY: null, or what `init` leaked; one thread, and no reference outlives the function that asked for it.
    unsafe { BENCHES[number].load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

fn current(index: u32) -> Arguments {
    turning(0, index)
}

fn speed(index: u32) -> Arguments {
    turning(1, index)
}

fn position(index: u32) -> Arguments {
    turning(2, index)
}

/// A quarter of a turn in the whole sweep, at which the electrical angle begins anew.
fn turning(number: usize, index: u32) -> Arguments {
    let bench = bench(number);
    bench.drain();
    bench.turn_to(index << 18, index << 16);
    let r = [
        (&raw mut bench.drive).addr(),
        (&raw const bench.sample).addr(),
        (&raw const bench.reading).addr(),
        (&raw mut bench.output).addr(),
    ];
    Arguments { r: r.map(|address| address as u32), ..Default::default() }
}

fn stays_on(_: &Arguments, _: &Results) -> f64 {
    for number in 0..DEMANDS {
        let drive = bench(number).drive.drive();
        if drive.mode() != Mode::Running {
            defmt::error!("demand {} with an encoder: {}", number, drive.mode());
            failure();
        }
    }
    0.0
}
