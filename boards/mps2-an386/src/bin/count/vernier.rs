//! Two rings to the absolute angle: 12-bit readings of ideal rings with 37 and 45 pole pairs; ours, and the paper's three
//! methods.

/// The paper's methods, as the host tests them.
#[path = "../../../../../baseline/src/rings.rs"]
#[allow(dead_code, reason = "the host's tests use all of it")]
mod baseline;

use crate::call::Arguments;
use crate::row::{Row, function};
use crate::trig::{angle_error, turns};
use baseline::{Found, PairTable, ZeroTable, decode_by_search};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::continuity::State;
use hallservo::vernier::decode::IdealTable;
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use mps2_an386::failure;
use static_cell::{ConstStaticCell, StaticCell};

pub const ROWS: &[Row] = &[
    Row::new("two rings → angle", "hallservo", function!(vernier), readings, |a, r| angle_error(a, turns(r.r0)))
        .budget(18),
    Row::new("the same, corrected and checked", "hallservo", function!(vernier_step), turning, |a, r| {
        angle_error(a, turns(r.r0))
    })
    .budget(60),
    Row::new("two rings → angle", "paper, all pairs stored", function!(all_pairs), for_pairs, |a, r| {
        angle_error(a, turns(r.r0))
    }),
    Row::new("two rings → angle", "paper, all computed", function!(search), for_search, |a, r| {
        angle_error(a, turns(r.r0))
    }),
    Row::new("two rings → angle", "paper, 37 stored", function!(combined), for_combined, |a, r| {
        angle_error(a, turns(r.r0))
    }),
];

/// The angle of a place on the reference ring by one product.
fn angle(found: Found, reference: u16) -> i32 {
    const SCALE: u64 = (1 << 48) / (37 << 12);
    let position = (u32::from(found.pole_pair) << 12) + u32::from(reference);
    ((u64::from(position) * SCALE) >> 16) as i32
}

#[unsafe(no_mangle)]
extern "C" fn all_pairs(reference: u16, vernier: u16, table: &PairTable<'static>) -> i32 {
    angle(table.decode(reference >> 4, vernier >> 4), reference >> 4)
}

#[unsafe(no_mangle)]
extern "C" fn search(reference: u16, vernier: u16, rings: &Rings) -> i32 {
    angle(decode_by_search(rings, reference >> 4, vernier >> 4), reference >> 4)
}

#[unsafe(no_mangle)]
extern "C" fn combined(reference: u16, vernier: u16, table: &ZeroTable) -> i32 {
    angle(table.decode(reference >> 4, vernier >> 4), reference >> 4)
}

#[unsafe(no_mangle)]
extern "C" fn vernier(reference: u16, vernier: u16, table: &IdealTable) -> i32 {
    table.decode(reference, vernier).angle.to_bits()
}

#[unsafe(no_mangle)]
extern "C" fn vernier_step(encoder: &Encoder, state: &mut State, reading: &Reading) -> i32 {
    encoder.step(state, *reading).map_or(0, |decoded| decoded.angle.to_bits())
}

struct Bench {
    rings: Rings,
    pairs: PairTable<'static>,
    zeros: ZeroTable,
    table: IdealTable,
    encoder: Encoder,
    state: State,
    reading: Reading,
}

static BENCH: AtomicPtr<Bench> = AtomicPtr::new(core::ptr::null_mut());

/// An encoder that has proved itself by a turn.
pub fn init() {
    static PLACE: StaticCell<Bench> = StaticCell::new();
    let Ok(rings) = Rings::new(37, 45, 12) else { failure() };
    let Ok(encoder) = Encoder::new(&rings, &Calibration::ideal(&rings), MechanicalAngle::from_degrees(1.0)) else {
        failure()
    };
    static PAIRS: ConstStaticCell<[u16; 37 << 12]> = ConstStaticCell::new([0; 37 << 12]);
    let Some(pairs) = PairTable::new(rings, PAIRS.take()) else { failure() };
    let (table, zeros, state) = (IdealTable::new(&rings), ZeroTable::new(rings), State::default());
    let bench = PLACE.init(Bench { rings, pairs, zeros, table, encoder, state, reading: reading(0) });
    // The sweep goes on where this ends.
    for index in 0..TURN {
        bench.reading = reading(index.wrapping_mul(STEP));
        if vernier_step(&bench.encoder, &mut bench.state, &bench.reading) == 0 && index != 0 {
            failure();
        }
    }
    if !bench.state.is_proven() {
        failure();
    }
    BENCH.store(bench, Relaxed);
}

/// Samples of a turn, and what the shaft turns in one.
const TURN: u32 = 1000;
const STEP: u32 = u32::MAX / TURN + 1;

/// The readings at a shaft angle.
fn reading(angle: u32) -> Reading {
    let of = |pole_pairs: u32| [(angle.wrapping_mul(pole_pairs) >> 16) as u16 & 0xFFF0];
    Reading { reference: of(37), vernier: of(45) }
}

fn bench() -> &'static mut Bench {
    // SAFETY: a static that only the row that is being counted uses.
    unsafe { BENCH.load(Relaxed).as_mut() }.unwrap_or_else(|| failure())
}

/// r0, r1: readings, r2: a table.
fn with_table(index: u32, table: usize) -> Arguments {
    let angle = index.wrapping_mul(0x9E37_79B9);
    let Reading { reference: [x], vernier: [y] } = reading(angle);
    Arguments { r: [x.into(), y.into(), table as u32, 0], turns: turns(angle), ..Default::default() }
}

fn readings(index: u32) -> Arguments {
    with_table(index, (&raw const bench().table).addr())
}

fn for_pairs(index: u32) -> Arguments {
    with_table(index, (&raw const bench().pairs).addr())
}

fn for_search(index: u32) -> Arguments {
    with_table(index, (&raw const bench().rings).addr())
}

fn for_combined(index: u32) -> Arguments {
    with_table(index, (&raw const bench().zeros).addr())
}

/// r0: the encoder, r1: its state, r2: the next reading of a shaft that turns steadily.
fn turning(index: u32) -> Arguments {
    let bench = bench();
    let angle = TURN.wrapping_add(index).wrapping_mul(STEP);
    bench.reading = reading(angle);
    let address = |place: *const u8| place.addr() as u32;
    let r = [
        address((&raw const bench.encoder).cast()),
        address((&raw const bench.state).cast()),
        address((&raw const bench.reading).cast()),
        0,
    ];
    Arguments { r, turns: turns(angle), ..Default::default() }
}
