//! Sine, arcsine and arctangent by tables of line segments, in integers.
//!
//! Each table is made at compile time from its formula and holds for every segment its start and its slope, so that
//! a value costs one look-up of two words and one multiply-add. Every input is legal. The error bounds in the
//! documentation are against the exact function in f64 and are asserted by sweeps over the input range.

use crate::angle::ElectricalAngle;
use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use fixed::types::I2F30;

/// A piece of a piecewise linear function: `start + slope · (offset in the segment)`, wrapping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Segment {
    /// Value at the begin of the segment.
    pub start: i32,
    /// Increase for one step of the argument within the segment.
    pub slope: i32,
}

impl Segment {
    /// The segment through two points that are `2^bits` steps of the argument apart, both values wrapping.
    pub(crate) const fn through(start: i32, end: i32, bits: u32) -> Self {
        let rise = end.wrapping_sub(start);
        Self { start, slope: (rise.wrapping_add(1 << (bits - 1))) >> bits }
    }

    /// The segment that follows a curve through three points, the second half way: the chord, moved by half of what
    /// the curve rises above its middle, which halves the largest error.
    pub(crate) const fn along(start: i32, middle: i32, end: i32, bits: u32) -> Self {
        let chord = Self::through(start, end, bits);
        let above = middle.wrapping_sub(start.wrapping_add(end.wrapping_sub(start) / 2));
        Self { start: chord.start.wrapping_add(above / 2), slope: chord.slope }
    }

    /// The value `offset` steps into the segment.
    #[inline(always)]
    pub(crate) const fn at(self, offset: u32) -> i32 {
        self.start.wrapping_add(self.slope.wrapping_mul(offset as i32))
    }
}

/// Sine of an angle; |error| ≤ 4e-5, RMS 1.9e-5, and |sine| ≤ 1 + 4e-5.
#[inline(always)]
pub const fn sin(angle: ElectricalAngle) -> I2F30 {
    let bits = angle.to_bits() as u32;
    if cfg!(feature = "small") {
        return I2F30::from_bits(folded_sine(bits));
    }
    I2F30::from_bits(SINE[(bits >> 24) as usize].at((bits >> SINE_OFFSET_LOW) & (SINE_STEPS - 1)))
}

/// The sine by its first half wave, which the other mirrors: a table of 1 KiB instead of 2.5, which a small chip can keep
/// where no wait states are.
#[inline(always)]
const fn folded_sine(bits: u32) -> i32 {
    let sine = HALF_SINE[(bits >> 24 & 127) as usize].at((bits >> SINE_OFFSET_LOW) & (SINE_STEPS - 1));
    let sign = bits as i32 >> 31;
    (sine ^ sign).wrapping_sub(sign)
}

/// Cosine of an angle, with the error of [`sin`].
#[inline(always)]
pub const fn cos(angle: ElectricalAngle) -> I2F30 {
    sin(ElectricalAngle::from_bits(angle.to_bits().wrapping_add(1 << 30)))
}

/// Sine and cosine of an angle, each with the error of [`sin`], for four instructions more.
#[inline(always)]
pub const fn sin_cos(angle: ElectricalAngle) -> (I2F30, I2F30) {
    let bits = angle.to_bits() as u32;
    if cfg!(feature = "small") {
        return (sin(angle), cos(angle));
    }
    let (index, offset) = ((bits >> 24) as usize, (bits >> SINE_OFFSET_LOW) & (SINE_STEPS - 1));
    (I2F30::from_bits(SINE[index].at(offset)), I2F30::from_bits(SINE[index + QUARTER].at(offset)))
}

/// The same for tasks: with the feature `small` in one copy.
#[cfg_attr(not(feature = "small"), inline(always))]
#[cfg_attr(feature = "small", inline(never))]
pub(crate) const fn sin_cos_of_tasks(angle: ElectricalAngle) -> (I2F30, I2F30) {
    sin_cos(angle)
}

/// A sine as a float. One conversion and one multiplication, where `to_num`, made for every format, shifts 64 bits
/// about.
#[inline(always)]
pub(crate) const fn float(sine: I2F30) -> f32 {
    sine.to_bits() as f32 * (1.0 / 1_073_741_824.0)
}

/// Sine and cosine of an angle as floats, each with the error of [`sin`].
#[cfg_attr(not(feature = "small"), inline(always))]
#[cfg_attr(feature = "small", inline(never))]
pub(crate) const fn sin_cos_f32(angle: ElectricalAngle) -> (f32, f32) {
    let (sine, cosine) = sin_cos_of_tasks(angle);
    (float(sine), float(cosine))
}

/// Arcsine, −90° to 90°; |error| ≤ 1e-4 rad, RMS 2.6e-5 rad. Arguments beyond ±1 give ±90°.
///
/// Away from zero the argument is taken as its distance from one, in segments that halve from octave to octave,
/// because the slope of the arcsine grows without bound there.
pub const fn asin(sine: I2F30) -> ElectricalAngle {
    const ONE: u32 = 1 << 30;
    let bits = sine.to_bits();
    let magnitude = bits.unsigned_abs();
    let angle = if magnitude >= ONE {
        ElectricalAngle::QUARTER.to_bits()
    } else if magnitude < ONE / 2 {
        ASINE_LOW[(magnitude >> 22) as usize & (ASINE_LOW.len() - 1)].at((magnitude >> 12) & ASINE_OFFSET)
    } else {
        let distance = ONE - magnitude;
        let octave = distance.leading_zeros();
        // The leading one sits in bit 31; the next four bits name the segment and ten more the place in it.
        let mantissa = distance << octave;
        let segment = (mantissa >> 27) & 15;
        ASINE_HIGH[(octave & 31) as usize][segment as usize].at((mantissa >> 17) & ASINE_OFFSET)
    };
    ElectricalAngle::from_bits(if bits < 0 { -angle } else { angle })
}

/// Angle of the vector (`x`, `y`); |error| ≤ 8.5e-5 rad for any vector, RMS 2.8e-5 rad. The null vector gives 0.
#[inline(always)]
pub const fn atan2(y: i32, x: i32) -> ElectricalAngle {
    let (y, x) = normalise(y, x);
    let direction = Direction::of(y, x);
    let ratio = ratio(direction.part, direction.whole);
    if cfg!(feature = "small") {
        folded_angle(direction.quadrant, ratio)
    } else {
        segment_angle(direction.quadrant, ratio, &ATAN2)
    }
}

/// [`atan2`] for cores without a divide instruction; the quotient comes from a table of reciprocals and one step of
/// Newton's method. |error| ≤ 1.3e-4 rad, RMS 3.3e-5 rad.
#[inline(always)]
pub const fn atan2_without_division(y: i32, x: i32) -> ElectricalAngle {
    let (y, x) = normalise(y, x);
    let direction = Direction::of(y, x);
    segment_angle(direction.quadrant, ratio_without_division(direction.part, direction.whole), &ATAN2)
}

/// Scales a vector up until its longer component has 31 bits, so that the quotient has full precision.
#[inline(always)]
const fn normalise(y: i32, x: i32) -> (i32, i32) {
    // The magnitude of i32::MIN is out of range; one bit less is nothing at this size.
    let (y, x) = (if y == i32::MIN { -i32::MAX } else { y }, if x == i32::MIN { -i32::MAX } else { x });
    let shift = (y.unsigned_abs() | x.unsigned_abs() | 1).leading_zeros() - 1;
    (y << shift, x << shift)
}

/// A table of the arctangent over the whole turn: four quadrants of 64 segments of the quotient |y| / (|x| + |y|),
/// along which the angle rises almost evenly and without a decision where |x| = |y|. Bit 1 of a quadrant's number is y
/// < 0, bit 0 is x < 0. A calibrated drive has its own table, which also holds what its sensors do to the angle (see
/// [`crate::hall::estimate`]).
pub type QuadrantTable = [Segment; 4 << QUADRANT_BITS];

/// log₂ of the number of segments in a quadrant.
pub const QUADRANT_BITS: u32 = 6;

/// Bits of the quotient within a segment.
pub(crate) const QUOTIENT_LOW: u32 = 16 - QUADRANT_BITS;

/// A vector as [`QuadrantTable`]s know it.
#[derive(Clone, Copy)]
pub(crate) struct Direction {
    /// Number of the quadrant; bit 1: y < 0, bit 0: x < 0.
    quadrant: u32,
    /// |y|.
    part: u32,
    /// |x| + |y|.
    whole: u32,
}

impl Direction {
    /// The magnitude of a negative number is taken as its ones' complement: a bit too small, an instruction saved, and
    /// it never overflows.
    #[inline(always)]
    pub(crate) const fn of(y: i32, x: i32) -> Self {
        let part = (y ^ (y >> 31)) as u32;
        let rest = (x ^ (x >> 31)) as u32;
        Self { quadrant: (y as u32 >> 31) * 2 + (x as u32 >> 31), part, whole: part + rest }
    }

    /// |x| + |y|: the length, but for a factor from 1 to √2.
    #[inline(always)]
    pub(crate) const fn length(self) -> u32 {
        self.whole
    }

    /// The table's value; accurate if the length has at least 29 bits. One division where the core divides.
    #[inline(always)]
    pub(crate) const fn angle(self, table: &QuadrantTable) -> ElectricalAngle {
        let quotient = if cfg!(hardware_divide) { ratio(self.part, self.whole) } else { self.ratio_without_division() };
        segment_angle(self.quadrant, quotient, table)
    }

    #[inline(always)]
    const fn ratio_without_division(self) -> u32 {
        ratio_without_division(self.part, self.whole)
    }
}

/// part / whole in 2⁻¹⁶, below one: rounding the divisor up keeps the quotient in range and the divisor from zero.
#[inline(always)]
const fn ratio(part: u32, whole: u32) -> u32 {
    part / ((whole >> 16) + 1)
}

/// [`ratio`] by multiplication: a reciprocal good to eight bits, made good to fifteen by one step of Newton's method.
#[inline(always)]
const fn ratio_without_division(part: u32, whole: u32) -> u32 {
    let shift = whole.leading_zeros();
    let top = (whole << shift) >> 16;
    // 2³¹ / divisor has 16 bits; what guess · divisor lacks of 2³¹ is at most 2²³.
    let guess = RECIPROCAL[((top >> 8) & 127) as usize] as i32;
    let lacking = 0x8000_0000_u32.wrapping_sub((guess as u32).wrapping_mul(top + 1)) as i32;
    let reciprocal = (guess + (((lacking >> 9) * guess) >> 22)) as u32;
    let quotient = ((part << shift) >> 16).wrapping_mul(reciprocal) >> 15;
    if quotient < 0xFFFF { quotient } else { 0xFFFF }
}

#[inline(always)]
const fn segment_angle<const N: usize>(quadrant: u32, ratio: u32, table: &[Segment; N]) -> ElectricalAngle {
    let index = (quadrant << QUADRANT_BITS) + ((ratio >> QUOTIENT_LOW) & ((1 << QUADRANT_BITS) - 1));
    ElectricalAngle::from_bits(table[index as usize].at(ratio & ((1 << QUOTIENT_LOW) - 1)))
}

/// The angle by the first quadrant of [`ATAN2`], which the others mirror.
#[inline(always)]
const fn folded_angle(quadrant: u32, ratio: u32) -> ElectricalAngle {
    let angle = segment_angle(0, ratio, &FIRST_QUADRANT).to_bits();
    let right = if quadrant & 1 != 0 { i32::MIN.wrapping_sub(angle) } else { angle };
    ElectricalAngle::from_bits(if quadrant & 2 != 0 { right.wrapping_neg() } else { right })
}

/// The mean of the exact quotients that [`ratio`] returns as `quotient`: it drops half a bit on average, and by its
/// divisor, about 19 000 and half a bit too large, another 1.7 bits of the whole.
const fn centred(quotient: f64) -> f64 {
    quotient + (1.7 * quotient + 0.5) / 65536.0
}

/// The vector (y, x) at the start of a segment of a [`QuadrantTable`], or so many halves of one after it.
pub(crate) fn segment_vector(index: usize, halves: usize) -> (f32, f32) {
    let half_steps = (index & ((1 << QUADRANT_BITS) - 1)) * 2 + halves;
    let quadrant = index >> QUADRANT_BITS;
    let quotient = half_steps as f32 / (2 << QUADRANT_BITS) as f32;
    // As [`centred`], for a chip that computes with floats of this size only.
    let y = quotient + (1.7 * quotient + 0.5) / 65_536.0;
    let x = 1.0 - y;
    (if quadrant & 2 != 0 { -y } else { y }, if quadrant & 1 != 0 { -x } else { x })
}

/// The exact angles at the start, in the middle and at the end of a segment of a [`QuadrantTable`], in turns, −½ to ½.
pub(crate) const fn segment_turns(index: usize) -> [f64; 3] {
    let half_steps = (index & ((1 << QUADRANT_BITS) - 1)) * 2;
    let quadrant = index >> QUADRANT_BITS;
    [
        quadrant_turns(quadrant, half_steps),
        quadrant_turns(quadrant, half_steps + 1),
        quadrant_turns(quadrant, half_steps + 2),
    ]
}

/// The angle at a number of half segments into a quadrant, unfolded as [`Direction`] folds.
const fn quadrant_turns(quadrant: usize, half_steps: usize) -> f64 {
    let y = centred(half_steps as f64 / (2 << QUADRANT_BITS) as f64);
    let x = 1.0 - y;
    let fold = if y < x { atan(y / x) } else { FRAC_PI_2 - atan(x / y) } / TAU;
    let right = if quadrant & 1 != 0 { 0.5 - fold } else { fold };
    if quadrant & 2 != 0 { -right } else { right }
}

/// The arctangent itself, for unit vectors.
const ATAN2: QuadrantTable = {
    let mut table = [Segment { start: 0, slope: 0 }; 4 << QUADRANT_BITS];
    let mut index = 0;
    while index < table.len() {
        let [start, middle, end] = segment_turns(index);
        table[index] = Segment::along(turns_to_bits(start), turns_to_bits(middle), turns_to_bits(end), QUOTIENT_LOW);
        index += 1;
    }
    table
};

/// What a small chip has of it.
const FIRST_QUADRANT: [Segment; 1 << QUADRANT_BITS] = {
    let mut table = [Segment { start: 0, slope: 0 }; 1 << QUADRANT_BITS];
    let mut index = 0;
    while index < table.len() {
        table[index] = ATAN2[index];
        index += 1;
    }
    table
};

const SINE_STEPS: u32 = 1 << 12;
const SINE_OFFSET_LOW: u32 = 24 - 12;

/// Segments of a quarter turn.
const QUARTER: usize = 64;

/// 256 segments of a turn and another quarter turn for the cosine. Chords lie inside the arc; scaling them by 1 + h²/16
/// halves the largest error.
static SINE: [Segment; 256 + QUARTER] = {
    const STEP: f64 = TAU / 256.0;
    const SCALE: f64 = (1u64 << 30) as f64 * (1.0 + STEP * STEP / 16.0);
    let mut table = [Segment { start: 0, slope: 0 }; 256 + QUARTER];
    let mut index = 0;
    while index < table.len() {
        let start = round(SCALE * sine(index as f64 * STEP));
        let end = round(SCALE * sine((index + 1) as f64 * STEP));
        table[index] = Segment::through(start as i32, end as i32, SINE_STEPS.ilog2());
        index += 1;
    }
    table
};

/// Half a turn of it.
static HALF_SINE: [Segment; 128] = {
    let mut table = [Segment { start: 0, slope: 0 }; 128];
    let mut index = 0;
    while index < table.len() {
        table[index] = SINE[index];
        index += 1;
    }
    table
};

/// Both tables of the arcsine resolve 1024 places in a segment.
const ASINE_OFFSET: u32 = (1 << 10) - 1;

/// The arcsine from 0 to ½ in 128 segments.
static ASINE_LOW: [Segment; 128] = {
    let mut table = [Segment { start: 0, slope: 0 }; 128];
    let mut index = 0;
    while index < 128 {
        let start = turns_to_bits(arcsine(index as f64 / 256.0) / TAU);
        let end = turns_to_bits(arcsine((index + 1) as f64 / 256.0) / TAU);
        table[index] = Segment::through(start, end, 10);
        index += 1;
    }
    table
};

/// The arcsine at 1 − d: one row for each number of leading zeros of d in 2⁻³⁰, sixteen segments an octave.
static ASINE_HIGH: [[Segment; 16]; 32] = {
    let mut table = [[Segment { start: 0, slope: 0 }; 16]; 32];
    let mut octave = 0;
    while octave < 32 {
        let mut segment = 0;
        while segment < 16 {
            let octave_start = (1u64 << (31 - octave)) as f64 / (1u64 << 30) as f64;
            let start = 1.0 - octave_start * (1.0 + segment as f64 / 16.0);
            let end = 1.0 - octave_start * (1.0 + (segment + 1) as f64 / 16.0);
            table[octave][segment] =
                Segment::through(turns_to_bits(arcsine(start) / TAU), turns_to_bits(arcsine(end) / TAU), 10);
            segment += 1;
        }
        octave += 1;
    }
    table
};

/// 2³¹ / d in the middle of each 128th of d from 2¹⁵ to 2¹⁶.
static RECIPROCAL: [u16; 128] = {
    let mut table = [0; 128];
    let mut index = 0;
    while index < 128 {
        table[index] = round((1u64 << 31) as f64 / ((index as f64 + 128.5) * 256.0)) as u16;
        index += 1;
    }
    table
};

const fn turns_to_bits(turns: f64) -> i32 {
    round(turns * (1u64 << 32) as f64) as i32
}

const fn round(x: f64) -> i64 {
    if x < 0.0 { (x - 0.5) as i64 } else { (x + 0.5) as i64 }
}

/// Sine at compile time, by its series after reduction to ±π/4.
const fn sine(x: f64) -> f64 {
    let quadrant = round(x / FRAC_PI_2);
    let x = x - quadrant as f64 * FRAC_PI_2;
    let even = quadrant % 2 == 0;
    let (mut term, mut sum, mut k) = if even { (x, x, 1.0) } else { (1.0, 1.0, 0.0) };
    while k < 20.0 {
        term = -term * x * x / ((k + 1.0) * (k + 2.0));
        sum += term;
        k += 2.0;
    }
    if quadrant.rem_euclid(4) >= 2 { -sum } else { sum }
}

/// Arctangent of 0 to 1 at compile time: halved angles until the series converges fast.
const fn atan(x: f64) -> f64 {
    if x == 1.0 {
        return FRAC_PI_4;
    }
    let (mut x, mut scale) = (x, 1.0);
    while x > 0.05 {
        x /= 1.0 + square_root(1.0 + x * x);
        scale *= 2.0;
    }
    let (mut power, mut sum, mut k) = (x, x, 1.0);
    while k < 25.0 {
        power = -power * x * x;
        k += 2.0;
        sum += power / k;
    }
    scale * sum
}

/// Arcsine of 0 to 1 at compile time; a rounding beyond that range counts as its end.
const fn arcsine(x: f64) -> f64 {
    if x <= 0.0 {
        0.0
    } else if x >= 1.0 {
        FRAC_PI_2
    } else if x < 0.707 {
        atan(x / square_root(1.0 - x * x))
    } else {
        PI / 2.0 - atan(square_root((1.0 - x) * (1.0 + x)) / x)
    }
}

/// Square root at compile time, by Newton's method.
const fn square_root(x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let mut root = if x > 1.0 { x } else { 1.0 };
    let mut steps = 0;
    while steps < 60 {
        root = 0.5 * (root + x / root);
        steps += 1;
    }
    root
}

#[cfg(test)]
mod tests;
