//! Two rings to the absolute angle: 12-bit readings of ideal rings with 37 and 45 pole pairs.

use crate::call::Arguments;
use crate::row::{Row, function};
use crate::trig::{angle_error, turns};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::angle::MechanicalAngle;
use hallservo::vernier::continuity::State;
use hallservo::vernier::decode::IdealTable;
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use mps2_an386::failure;
use static_cell::StaticCell;

pub const ROWS: &[Row] = &[
    Row::new("two rings → angle", "hallservo", function!(vernier), readings, |a, r| angle_error(a, turns(r.r0)))
        .budget(18),
    Row::new("the same, corrected and checked", "hallservo", function!(vernier_step), turning, |a, r| {
        angle_error(a, turns(r.r0))
    })
    .budget(60),
];

#[unsafe(no_mangle)]
extern "C" fn vernier(reference: u16, vernier: u16, table: &IdealTable) -> i32 {
    table.decode(reference, vernier).angle.to_bits()
}

#[unsafe(no_mangle)]
extern "C" fn vernier_step(encoder: &Encoder, state: &mut State, reading: &Reading) -> i32 {
    encoder.step(state, *reading).map_or(0, |decoded| decoded.angle.to_bits())
}

struct Bench {
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
    let (table, state) = (IdealTable::new(&rings), State::default());
    let bench = PLACE.init(Bench { table, encoder, state, reading: reading(0) });
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

/// r0, r1: readings, r2: the table.
fn readings(index: u32) -> Arguments {
    let angle = index.wrapping_mul(0x9E37_79B9);
    let Reading { reference: [x], vernier: [y] } = reading(angle);
    let table = (&raw const bench().table).addr() as u32;
    Arguments { r: [x.into(), y.into(), table, 0], turns: turns(angle), ..Default::default() }
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
