//! An angle to three sinusoidal duties of 12 bit, and the whole way there from three Halls.

use crate::call::{Arguments, Results};
use crate::halls::{self, clarke};
use crate::row::{Row, function};
use crate::trig::angle;
use core::f64::consts::TAU;
use core::sync::atomic::{AtomicU16, AtomicU32, Ordering::Relaxed};
use hallservo::angle::{ElectricalAngle, Position};
use hallservo::commutation::{
    Modulation, sinusoidal,
    sinusoidal::{Axes, PhaseOrder},
};
use hallservo::hall::{Codes, estimate::Estimator, track};
use hallservo::pwm::Limits;
use micromath::F32Ext;
use mps2_an386::failure;
use static_cell::StaticCell;

const PERIOD: u16 = 4096;
const HALF: i32 = 2048;
const MODULATION: f64 = 0.9;

type Duties = [u16; 3];

pub const ROWS: &[Row] = &[
    Row::new("angle → three duties, LSB", "hallservo", function!(duties), angle_amplitude, error).budget(28),
    Row::new("angle → three duties, LSB", "idsp", function!(duties_idsp), angle_amplitude, error),
    Row::new("angle → three duties, LSB", "micromath", function!(duties_micromath), angle_amplitude, error),
    Row::new("angle → three duties, LSB", "libm", function!(duties_libm), angle_amplitude, error),
    Row::new("three Halls → turns → three duties, LSB", "hallservo", function!(whole), codes, error).budget(75),
    Row::new("the same, tracked and predicted", "hallservo", function!(whole_tracked), codes, error),
    Row::new("three Halls → turns → three duties, LSB", "idsp", function!(whole_idsp), peer_codes, error),
    Row::new("three Halls → turns → three duties, LSB", "micromath", function!(whole_micromath), peer_codes, error),
    Row::new("three Halls → turns → three duties, LSB", "libm", function!(whole_libm), peer_codes, error),
];

/// What lies between the sensors and the duties.
struct Bare {
    estimator: &'static Estimator,
    position: Position,
    largest_jump: ElectricalAngle,
    tracking: track::Config,
    tracker: track::Tracker,
    axes: Axes,
}

/// What a peer keeps from call to call.
#[derive(Default)]
struct Turns {
    position: i64,
    angle: f32,
    turns: i32,
}

#[unsafe(no_mangle)]
extern "C" fn duties(angle: i32, axes: &Axes, duties: &mut Duties) {
    let angle = ElectricalAngle::from_bits(angle);
    *duties = sinusoidal::compare(angle, axes);
}

#[unsafe(no_mangle)]
extern "C" fn duties_idsp(angle: i32, _: usize, duties: &mut Duties, amplitude: i32) {
    let (cosine, sine) = idsp::cossin(angle);
    *duties = inverse_clarke(cosine, sine, amplitude);
}

#[unsafe(no_mangle)]
extern "C" fn duties_micromath(_: usize, _: usize, duties: &mut Duties, angle: f32, amplitude: f32) {
    *duties = inverse_clarke_f32(F32Ext::cos(angle), F32Ext::sin(angle), amplitude);
}

#[unsafe(no_mangle)]
extern "C" fn duties_libm(_: usize, _: usize, duties: &mut Duties, angle: f32, amplitude: f32) {
    *duties = inverse_clarke_f32(libm::cosf(angle), libm::sinf(angle), amplitude);
}

/// Where the angle is implausible, everything stays.
#[unsafe(no_mangle)]
extern "C" fn whole(codes: &Codes, bare: &mut Bare, duties: &mut Duties) {
    let angle = bare.estimator.angle_unchecked(codes);
    let jump = angle - bare.position.angle() + bare.largest_jump;
    if jump.to_bits() as u32 <= 2 * bare.largest_jump.to_bits() as u32 {
        bare.position = bare.position.advance_to(angle);
        *duties = sinusoidal::compare(angle, &bare.axes);
    }
}

#[unsafe(no_mangle)]
extern "C" fn whole_tracked(codes: &Codes, bare: &mut Bare, duties: &mut Duties) {
    // A jump makes it coast.
    let _ = bare.tracker.step(&bare.tracking, bare.estimator.angle_unchecked(codes));
    *duties = sinusoidal::compare(bare.tracker.predicted(&bare.tracking), &bare.axes);
}

#[unsafe(no_mangle)]
extern "C" fn whole_idsp(codes: &Codes, turns: &mut Turns, duties: &mut Duties, amplitude: i32) {
    let (y, x) = clarke(codes);
    let angle = idsp::atan2(y, x);
    let step = angle.wrapping_sub(turns.position as i32);
    turns.position += i64::from(step);
    let (cosine, sine) = idsp::cossin(angle);
    *duties = inverse_clarke(cosine, sine, amplitude);
}

#[unsafe(no_mangle)]
extern "C" fn whole_micromath(codes: &Codes, turns: &mut Turns, duties: &mut Duties, amplitude: f32) {
    let (y, x) = clarke(codes);
    let angle = F32Ext::atan2(y as f32, x as f32);
    turns.unwrap(angle);
    *duties = inverse_clarke_f32(F32Ext::cos(angle), F32Ext::sin(angle), amplitude);
}

#[unsafe(no_mangle)]
extern "C" fn whole_libm(codes: &Codes, turns: &mut Turns, duties: &mut Duties, amplitude: f32) {
    let (y, x) = clarke(codes);
    let angle = libm::atan2f(y as f32, x as f32);
    turns.unwrap(angle);
    *duties = inverse_clarke_f32(libm::cosf(angle), libm::sinf(angle), amplitude);
}

impl Turns {
    #[inline(always)]
    fn unwrap(&mut self, angle: f32) {
        let step = angle - self.angle;
        if step > core::f32::consts::PI {
            self.turns -= 1;
        } else if step < -core::f32::consts::PI {
            self.turns += 1;
        }
        self.angle = angle;
    }
}

/// Duties of a vector of 31 bits times an amplitude in 2⁻¹⁶ counts.
#[inline(always)]
fn inverse_clarke(cosine: i32, sine: i32, amplitude: i32) -> Duties {
    const HALF_SQRT_3: i64 = 1_859_775_393; // in 2⁻³¹
    const ROUND: i32 = 1 << 15;
    let times = |factor: i32| ((i64::from(factor) * i64::from(amplitude)) >> 31) as i32;
    let (alpha, beta) = (times(cosine), times(sine));
    let beta = ((i64::from(beta) * HALF_SQRT_3) >> 31) as i32;
    let counts = |x: i32| (HALF + ((x + ROUND) >> 16)) as u16;
    [counts(alpha), counts(beta - alpha / 2), counts(-beta - alpha / 2)]
}

#[inline(always)]
fn inverse_clarke_f32(cosine: f32, sine: f32, amplitude: f32) -> Duties {
    const HALF_SQRT_3: f32 = 0.866_025_4;
    let (alpha, beta) = (amplitude * cosine, amplitude * sine * HALF_SQRT_3);
    let counts = |x: f32| (HALF as f32 + 0.5 + x) as u16;
    [counts(alpha), counts(beta - 0.5 * alpha), counts(-beta - 0.5 * alpha)]
}

static DUTIES: [AtomicU16; 3] = [const { AtomicU16::new(0) }; 3];
static AXES: StaticCell<Axes> = StaticCell::new();
static BARE: StaticCell<Bare> = StaticCell::new();
static TURNS: StaticCell<Turns> = StaticCell::new();
/// Addresses of the three before.
static PLACES: [AtomicU32; 3] = [const { AtomicU32::new(0) }; 3];

/// Makes what the rows use, once the Halls are there.
pub fn init() {
    let Some(tracking) = track::Config::new(4, ElectricalAngle::from_degrees(60.0), 0.0) else { failure() };
    let Ok(limits) = Limits::new(PERIOD, 0, PERIOD) else { failure() };
    let amplitude = limits.amplitude(Modulation::from_num(MODULATION));
    let axes = Axes::new(amplitude, PhaseOrder::FORWARD, HALF as u16);
    let estimator = halls::estimator();
    let bare = Bare {
        estimator,
        position: Position::default(),
        largest_jump: ElectricalAngle::from_degrees(60.0),
        tracking,
        tracker: track::Tracker::default(),
        axes,
    };
    let places = [
        (&raw mut *AXES.init(axes)).addr(),
        (&raw mut *swing_in(BARE.init(bare))).addr(),
        (&raw mut *TURNS.init(Turns::default())).addr(),
    ];
    for (place, address) in PLACES.iter().zip(places) {
        place.store(address as u32, Relaxed);
    }
}

/// One turn, for the tracker to take up the speed of the sweep.
fn swing_in(bare: &'static mut Bare) -> &'static mut Bare {
    for index in 0..1 << 14 {
        let codes = halls::model_codes(index << 18);
        // What it returns tells of the first angle, if that is a jump.
        let _ = bare.tracker.step(&bare.tracking, bare.estimator.angle_unchecked(&codes));
    }
    bare
}

fn place(number: usize) -> u32 {
    PLACES[number].load(Relaxed)
}

fn counts() -> f64 {
    MODULATION * f64::from(HALF)
}

/// r0: angle, r1: our amplitude, r2: duties, r3: a peer's amplitude; s0, s1: angle and amplitude.
fn angle_amplitude(index: u32) -> Arguments {
    let angle = angle(index);
    Arguments {
        r: [angle.r[0], place(0), DUTIES.as_ptr().addr() as u32, libm::ldexp(counts(), 16) as u32],
        s: [(angle.turns * TAU) as f32, counts() as f32],
        ..angle
    }
}

/// r0: codes of a rotor that turns steadily, r1: our state, r2: duties.
fn codes(index: u32) -> Arguments {
    let mut arguments = halls::codes_at(index << 18);
    arguments.r[1] = place(1);
    arguments.r[2] = DUTIES.as_ptr().addr() as u32;
    arguments
}

/// The same for a peer: r1: its state, r3 and s0: its amplitude.
fn peer_codes(index: u32) -> Arguments {
    let mut arguments = codes(index);
    arguments.r[1] = place(2);
    arguments.r[3] = libm::ldexp(counts(), 16) as u32;
    arguments.s[0] = counts() as f32;
    arguments
}

fn error(arguments: &Arguments, _: &Results) -> f64 {
    let mut worst = 0.0_f64;
    for (k, duty) in DUTIES.iter().enumerate() {
        let wave = libm::cos((arguments.turns - k as f64 / 3.0) * TAU);
        let exact = f64::from(HALF) + counts() * wave;
        worst = worst.max((f64::from(duty.load(Relaxed)) - exact).abs());
    }
    worst
}
