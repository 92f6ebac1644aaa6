//! The adaptation's filter, while it learns on a rotor that turns steadily, and while something is wrong.

use crate::call::Arguments;
use crate::halls;
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::hall::adapt::{Adapter, Observation, Outcome, Settings};
use mps2_an386::failure;
use static_cell::StaticCell;

#[rustfmt::skip]
pub const ROWS: &[Row] = &[
    Row::new("adaptation, one update", "hallservo", function!(adapt), turning, |_, _| 0.0).budget(1500),
    Row::new("the same, after lost samples", "hallservo", function!(adapt), skipping, |_, _| 0.0).budget(1500),
    Row::new("the same, with outliers", "hallservo", function!(adapt), spiking, |_, _| 0.0).budget(1500),
    Row::new("the same, with a Hall stuck for a while", "hallservo", function!(adapt), sticking, |_, _| 0.0).budget(1500),
    Row::new("the same, the rotor pushed", "hallservo", function!(adapt), pushing, |_, _| 0.0).budget(1500),
    Row::new("the same, all of it with lost samples", "hallservo", function!(adapt), all, |_, _| 0.0).budget(1500),
    Row::new("the same, with a Hall lost", "hallservo", function!(adapt), losing, |_, _| 0.0).budget(1500),
    Row::new("the same, and all of it", "hallservo", function!(adapt), all, |_, _| 0.0).budget(1500),
];

#[unsafe(no_mangle)]
extern "C" fn adapt(adapter: &mut Adapter, observation: &Observation) -> u32 {
    u32::from(matches!(adapter.update(observation), Outcome::Learning | Outcome::Learnt))
}

struct Bench {
    adapter: Adapter,
    observation: Observation,
    angle: u32,
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
    let bench = PLACE.init(Bench { adapter, observation, angle: 0, random: 1 });
    let mut learns = 0;
    for _ in 0..300 {
        bench.turn();
        learns = adapt(&mut bench.adapter, &bench.observation);
    }
    if learns == 0 {
        failure();
    }
    BENCH.store(bench, Relaxed);
}

impl Bench {
    fn turn(&mut self) {
        self.angle = self.angle.wrapping_add(STEP);
        self.observation.codes = halls::model_codes(self.angle);
    }
}

fn turning(_: u32) -> Arguments {
    next(1, None)
}

/// Now and then one Hall says something else.
fn spiking(index: u32) -> Arguments {
    next(1, index.is_multiple_of(37).then_some(2048))
}

/// One to nine samples lost, before every observation.
fn skipping(index: u32) -> Arguments {
    next(2 + (index % 9) as u16, None)
}

/// One Hall stays where it is for six samples.
fn sticking(index: u32) -> Arguments {
    next(1, (index % 41 < 6).then_some(1900))
}

/// Now and then the rotor is elsewhere, by up to 11°, or by up to half a turn.
fn pushing(index: u32) -> Arguments {
    if index.is_multiple_of(29) {
        push(if index.is_multiple_of(58) { 6 } else { 1 });
    }
    next(1, None)
}

/// Gaps, spikes, rails and pushes.
fn all(index: u32) -> Arguments {
    match index % 83 {
        0 => push(6),
        20 => push(5),
        40 => push(1),
        _ => {}
    }
    let stuck = match index % 31 {
        0 | 7 => Some(2300),
        12 | 13 => Some(0),
        _ => None,
    };
    next(if index.is_multiple_of(3) { 1 + (index % 22) as u16 } else { 1 }, stuck)
}

/// Turns the rotor at random, by up to a turn over 2 to this.
fn push(shift: u32) {
    // SAFETY: as below.
    let bench = unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure());
    bench.random = bench.random.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    bench.angle = bench.angle.wrapping_add_signed(bench.random.cast_signed() >> shift);
}

/// From here on one Hall says nothing.
fn losing(_: u32) -> Arguments {
    next(1, Some(0))
}

/// r0: the filter, r1: the observation after so many samples.
fn next(elapsed: u16, stuck: Option<u16>) -> Arguments {
    // SAFETY: a static that only the row that is being counted uses.
    let bench = unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure());
    for _ in 0..elapsed {
        bench.turn();
    }
    bench.observation.elapsed = elapsed;
    if let Some(code) = stuck {
        bench.observation.codes[1] = code;
    }
    let r = [(&raw const bench.adapter).addr() as u32, (&raw const bench.observation).addr() as u32, 0, 0];
    Arguments { r, ..Default::default() }
}
