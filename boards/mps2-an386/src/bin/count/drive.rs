//! Everything that the control interrupt does, on a rotor that turns steadily.

use crate::call::{Arguments, Results};
use crate::halls;
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::commutation::{Modulation, Output};
use hallservo::drive::{Channels, Command, Drive, Sample, Tasks};
use hallservo::hall::estimate::Estimator;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use mps2_an386::failure;
use static_cell::StaticCell;

#[rustfmt::skip]
pub const ROWS: &[Row] = &[
    Row::new("Drive::step, running", "hallservo", function!(step), running, no_error).budget(150),
    Row::new("Drive::step, with a command", "hallservo", function!(step), commanded, no_error),
    Row::new("Drive::step, a Hall at a rail", "hallservo", function!(step), blind, no_error),
];

/// What the interrupt of a board does between reading the ADC and writing the timer. The only caller of the library's
/// function, into which it is inlined as into the interrupt.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn step(drive: &mut Drive, sample: &Sample, output: &mut Output) {
    *output = drive.step(sample);
}

struct Bench {
    drive: Drive,
    tasks: Tasks,
    sample: Sample,
    output: Output,
}

static BENCH: AtomicPtr<Bench> = AtomicPtr::new(core::ptr::null_mut());

/// A drive that runs, with telemetry at 1 kHz.
pub fn init() {
    static PLACE: StaticCell<Bench> = StaticCell::new();
    static ESTIMATOR: StaticCell<Estimator> = StaticCell::new();
    static CHANNELS: StaticCell<Channels> = StaticCell::new();
    let Ok(config) = Settings::default().validate() else { failure() };
    let (interrupt, tasks) = CHANNELS.init(Channels::new()).split();
    let drive = Drive::new(config, interrupt);
    let bench = PLACE.init(Bench { drive, tasks, sample: Sample::default(), output: Output::OFF });
    bench.sample.halls = halls::model_codes(0);
    let modulation = Modulation::from_num(0.5);
    for command in [Command::Install(ESTIMATOR.init(halls::new_estimator())), Command::Arm, Command::Drive(modulation)]
    {
        bench.send(command);
        let reply = loop {
            step(&mut bench.drive, &bench.sample, &mut bench.output);
            if let Some(reply) = bench.tasks.replies.dequeue() {
                break reply;
            }
        };
        if reply.is_err() {
            failure();
        }
    }
    BENCH.store(bench, Relaxed);
}

impl Bench {
    fn send(&mut self, command: Command) {
        if self.tasks.commands.enqueue(command).is_err() {
            failure();
        }
    }
}

fn bench() -> &'static mut Bench {
    // SAFETY: null, or what `init` leaked; one thread, and no reference outlives the function that asked for it.
    unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

/// One turn in the whole sweep; the tasks keep up.
fn running(index: u32) -> Arguments {
    let bench = bench();
    while bench.tasks.records.dequeue().is_some() {}
    while bench.tasks.replies.dequeue().is_some() {}
    bench.sample.halls = halls::model_codes(index << 18);
    let pointers = [(&raw mut bench.drive).addr(), (&raw const bench.sample).addr(), (&raw mut bench.output).addr(), 0];
    Arguments { r: pointers.map(|address| address as u32), ..Default::default() }
}

/// Every other step, so that those that had to wait are obeyed, too.
fn commanded(index: u32) -> Arguments {
    if index.is_multiple_of(2) {
        let command = if index.is_multiple_of(4) { 0.5 } else { -0.5 };
        bench().send(Command::Drive(Modulation::from_num(command)));
    }
    running(index)
}

/// Fewer in a row than make a fault.
fn blind(index: u32) -> Arguments {
    let arguments = running(index);
    if !index.is_multiple_of(8) {
        bench().sample.halls[1] = 4095;
    }
    arguments
}

/// The outputs are compared bit for bit elsewhere.
fn no_error(_: &Arguments, _: &Results) -> f64 {
    if bench().drive.mode() == Mode::Running { 0.0 } else { failure() }
}
