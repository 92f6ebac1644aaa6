//! The adaptation's filter, while it learns on a rotor that turns steadily, and while something is wrong.

use crate::call::Arguments;
use crate::halls;
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::hall::adapt::{Adapter, Observation, Settings, Status};
use mps2_an386::failure;
use static_cell::StaticCell;

pub const ROWS: &[Row] = &[
    Row::new("adaptation, one update", "hallservo", function!(adapt), turning, |_, _| 0.0).budget(1500),
    Row::new("the same, after lost samples", "hallservo", function!(adapt), skipping, |_, _| 0.0).budget(1700),
    Row::new("the same, with outliers", "hallservo", function!(adapt), spiking, |_, _| 0.0).budget(1700),
    Row::new("the same, the rotor pushed", "hallservo", function!(adapt), pushing, |_, _| 0.0).budget(1800),
    Row::new("the same, with a Hall lost", "hallservo", function!(adapt), losing, |_, _| 0.0).budget(1700),
    Row::new("the same, all of it at once", "hallservo", function!(adapt), everything, |_, _| 0.0).budget(2200),
    Row::new("the same, on two Halls", "hallservo", function!(adapt), everything_on_two, |_, _| 0.0).budget(1700),
];

#[unsafe(no_mangle)]
extern "C" fn adapt(adapter: &mut Adapter, observation: &Observation) -> u32 {
    u32::from(matches!(adapter.update(observation), Status::Adapting | Status::ModelReady))
}

struct Bench {
    adapter: Adapter,
    /// What every row begins with.
    fresh: Adapter,
    observation: Observation,
    angle: u32,
    begun: u32,
    random: u32,
}

static BENCH: AtomicPtr<Bench> = AtomicPtr::new(core::ptr::null_mut());

/// 10 Hz electrical at a thousand samples a second.
const STEP: u32 = u32::MAX / 100;

/// A filter that has begun to learn.
pub fn init() {
    static PLACE: StaticCell<Bench> = StaticCell::new();
    let Ok(config) = Settings::default().validate() else { failure() };
    let Ok(adapter) = Adapter::new(&config, &halls::model()) else { failure() };
    let observation = Observation { codes: halls::model_codes(0), elapsed: 1, torque_nm: 0.0 };
    let bench = PLACE.init(Bench { fresh: adapter.clone(), adapter, observation, angle: 0, begun: 0, random: 1 });
    let mut learns = 0;
    for _ in 0..300 {
        bench.turn();
        learns = adapt(&mut bench.adapter, &bench.observation);
    }
    if learns == 0 {
        failure();
    }
    bench.fresh = bench.adapter.clone();
    bench.begun = bench.angle;
    BENCH.store(bench, Relaxed);
}

impl Bench {
    fn turn(&mut self) {
        self.angle = self.angle.wrapping_add(STEP);
        self.observation.codes = halls::model_codes(self.angle);
    }
}

fn turning(index: u32) -> Arguments {
    next(index, 1, &[])
}

/// Now and then one Hall says something else.
fn spiking(index: u32) -> Arguments {
    next(index, 1, if index.is_multiple_of(37) { &[(1, 2048)] } else { &[] })
}

/// One to nineteen samples lost, before every observation.
fn skipping(index: u32) -> Arguments {
    next(index, 2 + (index % 19) as u16, &[])
}

/// Now and then the rotor is elsewhere, by up to 6° or by anything.
fn pushing(index: u32) -> Arguments {
    if index.is_multiple_of(301) {
        push(if index.is_multiple_of(2) { 5 } else { 0 });
    }
    next(index, 1, &[])
}

/// From here on one Hall says nothing.
fn losing(index: u32) -> Arguments {
    next(index, 1, &[(1, 0)])
}

/// Gaps, spikes, a Hall that is stuck or at the rail for a while, and pushes.
fn everything(index: u32) -> Arguments {
    next(index, disturb(index), wrong(index))
}

/// The same without one of the Halls.
fn everything_on_two(index: u32) -> Arguments {
    let arguments = next(index, disturb(index), wrong(index));
    bench().observation.codes[2] = 4095;
    arguments
}

/// Pushes; returns the periods since the last observation.
fn disturb(index: u32) -> u16 {
    match index % 1009 {
        0 => push(5),
        200 => push(6),
        400 => push(4),
        600 => push(0),
        _ => {}
    }
    if index % 512 < 256 && index.is_multiple_of(5) { 1 + (index % 22) as u16 } else { 1 }
}

fn wrong(index: u32) -> &'static [(usize, u16)] {
    match index % 397 {
        0 | 50 => &[(0, 2300)],
        100..106 => &[(1, 1900)],
        200 | 201 => &[(1, 0)],
        300 => &[(0, 2000), (1, 2500)],
        _ => &[],
    }
}

/// Turns the rotor at random, by up to half a turn over 2 to this.
fn push(shift: u32) {
    let bench = bench();
    bench.random = bench.random.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    bench.angle = bench.angle.wrapping_add_signed(bench.random.cast_signed() >> shift);
}

fn bench() -> &'static mut Bench {
    // SAFETY: a static that only the row that is being counted uses, one borrow after the other.
    unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

/// r0: the filter, r1: the observation after so many samples, some Halls saying something else.
fn next(index: u32, elapsed: u16, wrong: &[(usize, u16)]) -> Arguments {
    let bench = bench();
    // Every row begins with the same filter, and again before too much has gone wrong.
    if index.is_multiple_of(4096) {
        bench.adapter = bench.fresh.clone();
        bench.angle = bench.begun;
    }
    for _ in 0..elapsed {
        bench.turn();
    }
    bench.observation.elapsed = elapsed;
    for &(sensor, code) in wrong {
        bench.observation.codes[sensor] = code;
    }
    let r = [(&raw const bench.adapter).addr() as u32, (&raw const bench.observation).addr() as u32, 0, 0];
    Arguments { r, ..Default::default() }
}
