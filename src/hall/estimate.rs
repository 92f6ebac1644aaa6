//! The electrical angle from all three sensors, in the control interrupt.
//!
//! With calibrated sensors the normalised signals are `r = F·(cos θ, sin θ) + s·c`, where row i of F is
//! `(−sin ψᵢ, cos ψᵢ)` and c is whatever the three have in common: a drifting supply, a stray field, and at exactly
//! 120° the third harmonic. `s = (1, 1, 1)` for sensors 120° apart. At 60° the middle sensor is a sensor at 240° upside
//! down, so there `s = (1, −1, 1)`: the third harmonic is rejected, a common offset only seen. The inverse of the 3×3
//! matrix `(F, s)` gives cosine, sine and c in nine multiply-adds straight from the ADC codes; c costs at most a few
//! per cent of noise over the best estimate that trusts it to be zero, and is the check that the sensors agree.
//!
//! The angle is then the arctangent, from a table of the quotient |y| / (|x| + |y|). The table is this drive's own:
//! where harmonics, unequal placements and the alignment φ make the true angle differ from the arctangent, the table
//! holds the true angle. So all of them are corrected without an instruction, and the estimate does not need the
//! amplitude.
//!
//! Error: below 1.5e-4 rad for a perfect model and ideal codes; the quantisation of a 12-bit full-scale code is 3e-4
//! rad. One division; its divisor is at least one by construction.

mod inverse;

use crate::angle::ElectricalAngle;
use crate::hall::model::{Model, Sensor};
use crate::hall::plausibility::{Implausible, Window};
use crate::hall::{Channel, Codes, Halls};
use crate::trig::{self, Direction, QuadrantTable, Segment};
use core::fmt;
use core::sync::atomic::{Ordering, compiler_fence};
pub use inverse::DISAGREEMENT;
use inverse::Inverse;

/// Smallest |cos| + |sin| that is an angle, in calibrated amplitudes: less than half of what a healthy magnet gives.
const WEAKEST: f32 = 0.45;
/// Largest such sum: √2 times [`crate::hall::plausibility::PLAUSIBLE`].
const STRONGEST: f32 = 2.2;

/// Largest noise of the estimate over the bound for perfectly placed sensors that a placement may cost.
pub const WORST_NOISE_GAIN: f32 = 1.5;

/// The same for two sensors; 90° apart they have 1.22, 120° or 60° apart √2.
pub const WORST_NOISE_GAIN_OF_TWO: f32 = 2.5;

/// Why sensors cannot give an angle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum BadModel {
    /// The ADC has 1 to 16 bits.
    AdcBits(u8),
    /// Not a number, an amplitude below four codes, an offset outside the ADC's range, or harmonics of more than half
    /// the amplitude.
    Sensor(Channel),
    /// So placed, the sensors do not determine the angle; with the noise over the bound of perfect placement.
    Placement {
        /// Angle noise relative to perfectly placed sensors; infinite where two dimensions collapse.
        noise_gain: f32,
    },
}

impl fmt::Display for BadModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AdcBits(bits) => write!(f, "an ADC of {bits} bits is not supported: 1 to 16"),
            Self::Sensor(channel) => write!(
                f,
                "{channel} swings by less than 8 codes, its middle is outside the ADC's range, or its third and fifth \
                 harmonic are more than half of its swing"
            ),
            Self::Placement { noise_gain } => {
                write!(f, "the Halls are placed so that the angle is {noise_gain:.1} times as noisy as it could be")
            }
        }
    }
}

impl core::error::Error for BadModel {}

/// A row of the inverse, in units of the ADC codes: `gains · codes + bias`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Row {
    gains: [i32; 3],
    bias: i32,
}

impl Row {
    /// Weights of the normalised signals, with `unit` for one.
    fn new(weights: [f32; 3], unit: f32, model: &Model) -> Self {
        let (mut gains, mut middle) = ([0; 3], 0);
        for ((gain, weight), sensor) in gains.iter_mut().zip(weights).zip(&model.sensors) {
            *gain = crate::float::nearest(unit * weight / sensor.amplitude);
            // Offsets are taken in 2⁻¹² codes.
            middle += i64::from(*gain) * i64::from((sensor.offset * 4096.0) as i32);
        }
        Self { gains, bias: (-middle >> 12) as i32 }
    }

    /// Intermediate sums may wrap; the result does not while every code is in its window.
    #[inline(always)]
    const fn dot(&self, codes: &Codes) -> i32 {
        self.bias
            .wrapping_add(self.gains[0].wrapping_mul(codes[0] as i32))
            .wrapping_add(self.gains[1].wrapping_mul(codes[1] as i32))
            .wrapping_add(self.gains[2].wrapping_mul(codes[2] as i32))
    }
}

/// What two sensors give alone, in units of a power of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pair {
    cosine: Row,
    sine: Row,
    /// log₂ of what one amplitude is.
    unit_bits: u32,
}

impl Pair {
    fn new(lost: Channel, model: &Model, adc_bits: u8) -> Self {
        let inverse = Inverse::without(lost, model);
        // Finite and at least two to the sixth: the window has 16 bits, an amplitude at least two.
        let unit_bits = (inverse.unit(model, Window::all(adc_bits)) as u32).max(64).ilog2();
        let row = |row| Row::new(row, (1_u32 << unit_bits) as f32, model);
        Self { cosine: row(inverse.cosine), sine: row(inverse.sine), unit_bits }
    }
}

/// The integer form of a [`Model`]: 2.3 KiB, most of it the table, behind which comes what is rarely used.
#[derive(Clone, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Estimator {
    /// What no code may leave: the smallest window around those of the three sensors.
    window: Window,
    windows: [Window; 3],
    cosine: Row,
    sine: Row,
    disagreement: Row,
    /// Its bias is larger by the limit, so that one comparison tests both ends.
    disagreement_span: u32,
    weakest: u32,
    strength_span: u32,
    table: QuadrantTable,
    /// Cosine and sine from two sensors, for each that may be lost, with what an electrical angle is to them.
    pairs: [Pair; 3],
    alignment: ElectricalAngle,
    reversed: bool,
    // With no gap before the table: the compiler would clear it on the stack and copy it, with what is in the gap.
    adc_bits: u8,
    lost: Option<Channel>,
}

impl Estimator {
    /// The estimator for a model of sensors behind an ADC of `adc_bits`.
    ///
    /// # Errors
    /// [`BadModel`], when a parameter is impossible or the placement leaves the angle more than
    /// [`WORST_NOISE_GAIN`] times as noisy as three well-placed sensors.
    pub fn new(model: &Model, adc_bits: u8) -> Result<Self, BadModel> {
        let mut estimator = Self::blank();
        estimator.rebuild(model, adc_bits, None)?;
        Ok(estimator)
    }

    /// The estimator for the two sensors that remain when one is lost; error below 5e-4 rad for a perfect model. The
    /// angle is up to [`WORST_NOISE_GAIN_OF_TWO`] times as noisy, a common offset is not rejected, and the loss of
    /// another sensor shows only in the strength of the signals, which [`pair`](crate::hall::pair) looks at.
    ///
    /// # Errors
    /// [`BadModel`], when a parameter is impossible, or the two are so close to the same or opposite phase that the
    /// noise is more than [`WORST_NOISE_GAIN_OF_TWO`] times that of three well-placed sensors.
    pub fn without(lost: Channel, model: &Model, adc_bits: u8) -> Result<Self, BadModel> {
        let mut estimator = Self::blank();
        estimator.rebuild(model, adc_bits, Some(lost))?;
        Ok(estimator)
    }

    /// As [`Self::new`], or [`Self::without`] the one that is lost, in place, which spares a small stack several KiB.
    /// Unchanged after an error.
    pub(crate) fn rebuild(&mut self, model: &Model, adc_bits: u8, lost: Option<Channel>) -> Result<(), BadModel> {
        let lost = lost.or(model.absent());
        let (windows, inverse) = check(model, adc_bits, lost)?;
        self.fill(model, adc_bits, &windows, &inverse, lost);
        Ok(())
    }

    fn fill(&mut self, model: &Model, adc_bits: u8, windows: &[Window; 3], inverse: &Inverse, lost: Option<Channel>) {
        let window = Window::around(windows);
        let unit = inverse.unit(model, window);
        let row = |row: [f32; 3]| Row::new(row, unit, model);
        let strength = |relative: f32| (relative * unit) as u32;
        (self.window, self.windows) = (window, *windows);
        self.cosine = row(inverse.cosine);
        self.sine = row(inverse.sine);
        self.disagreement = row(inverse.common);
        let limit = (DISAGREEMENT * unit) as i32;
        self.disagreement.bias = self.disagreement.bias.wrapping_add(limit);
        self.disagreement_span = 2 * limit as u32;
        self.weakest = strength(WEAKEST);
        self.strength_span = strength(STRONGEST) - strength(WEAKEST);
        fill_table(&mut self.table, model, inverse);
        self.adc_bits = adc_bits;
        for (lost, pair) in (0..).zip(&mut self.pairs) {
            *pair = Pair::new(Channel(lost), model, adc_bits);
        }
        (self.alignment, self.reversed, self.lost) = (model.alignment, model.reversed, lost);
    }

    /// Memory for an estimator: it finds every code implausible.
    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub const fn blank() -> Self {
        const ROW: Row = Row { gains: [0; 3], bias: 0 };
        const TABLE: QuadrantTable = [Segment { start: 0, slope: 0 }; 4 << trig::QUADRANT_BITS];
        Self {
            window: Window::NOTHING,
            windows: [Window::NOTHING; 3],
            cosine: ROW,
            sine: ROW,
            disagreement: ROW,
            disagreement_span: 0,
            weakest: 0,
            strength_span: 0,
            table: TABLE,
            adc_bits: 16,
            pairs: [Pair { cosine: ROW, sine: ROW, unit_bits: 0 }; 3],
            alignment: ElectricalAngle::ZERO,
            reversed: false,
            lost: None,
        }
    }

    /// The electrical angle.
    ///
    /// # Errors
    /// [`Implausible`], when a code is at a rail or out of its sensor's range, or the three contradict each other.
    #[inline(always)]
    pub fn angle(&self, codes: &Codes) -> Result<ElectricalAngle, Implausible> {
        if !self.agree(codes) {
            return Err(self.explain(codes, Implausible::Inconsistent));
        }
        self.angle_in_range(codes)
    }

    /// Whether the three do not contradict each other.
    #[inline(always)]
    pub fn agree(&self, codes: &Codes) -> bool {
        self.disagreement.dot(codes) as u32 <= self.disagreement_span
    }

    /// The same without the comparison of the three with each other: for a single sample among others that are
    /// compared.
    ///
    /// # Errors
    /// As [`Self::angle`], but for [`Implausible::Inconsistent`].
    #[inline(always)]
    pub fn angle_in_range(&self, codes: &Codes) -> Result<ElectricalAngle, Implausible> {
        let window = self.window;
        if !(window.contains(codes[0]) && window.contains(codes[1]) && window.contains(codes[2])) {
            return Err(self.explain(codes, Implausible::Inconsistent));
        }
        let seen = &[codes[0], codes[1], codes[2]];
        let cosine = self.cosine.dot(seen);
        // One row after the other: mixed, as the compiler would, they need more registers than there are.
        compiler_fence(Ordering::SeqCst);
        let direction = Direction::of(self.sine.dot(seen), cosine);
        if direction.length().wrapping_sub(self.weakest) > self.strength_span {
            let weak = direction.length() < self.weakest;
            return Err(self.explain(codes, if weak { Implausible::Weak } else { Implausible::Strong }));
        }
        Ok(direction.angle(&self.table))
    }

    /// The same as [`Self::angle`] without the checks, for codes that are known to be in range.
    #[inline(always)]
    pub fn angle_unchecked(&self, codes: &Codes) -> ElectricalAngle {
        Direction::of(self.sine.dot(codes), self.cosine.dot(codes)).angle(&self.table)
    }

    /// The angle from the two sensors other than `lost`, for the time until a new estimator takes its place, and their
    /// strength: [`Self::NOMINAL_STRENGTH`] for a calibrated magnet, which grows with the square of the signals.
    /// Harmonics are not corrected, so that with a third harmonic of 5 % the angle is up to 7° off and the strength 30
    /// %. `None` where the estimator knows of two sensors only.
    #[cold]
    pub fn angle_without(&self, lost: Channel, codes: &Codes) -> Option<(ElectricalAngle, u32)> {
        let pair = self.pairs.get(usize::from(lost.0)).filter(|_| self.lost.is_none())?;
        let (y, x) = (pair.sine.dot(codes), pair.cosine.dot(codes));
        let square = i64::from(y) * i64::from(y) + i64::from(x) * i64::from(x);
        let strength = square >> (2 * pair.unit_bits - Self::NOMINAL_STRENGTH.ilog2());
        let angle = trig::atan2(y, x) - self.alignment;
        Some((if self.reversed { -angle } else { angle }, u32::try_from(strength).unwrap_or(u32::MAX)))
    }

    /// Angle of the Halls where the rotor's is 0.
    pub(crate) const fn alignment(&self) -> ElectricalAngle {
        self.alignment
    }

    /// Whether it was made for this ADC, this direction and so many Halls.
    pub(crate) const fn is_for(&self, adc_bits: u8, reversed: bool, halls: Halls) -> bool {
        let third_is_used = !matches!(self.lost, Some(Channel::THIRD));
        self.adc_bits == adc_bits && self.reversed == reversed && !(third_is_used && matches!(halls, Halls::Two))
    }

    /// Strength of two sensors as calibrated.
    pub const NOMINAL_STRENGTH: u32 = 1024;

    /// The sensor that the estimator does without.
    pub const fn lost(&self) -> Option<Channel> {
        self.lost
    }

    /// The first sensor whose code is not in its own window, or else what is wrong with all three.
    #[cold]
    #[inline(never)]
    fn explain(&self, codes: &Codes, otherwise: Implausible) -> Implausible {
        let mut first = otherwise;
        // Without an index: compiled for size, the compiler would not see that it is in range.
        for (channel, (window, &code)) in self.windows.iter().zip(codes).enumerate().rev() {
            if !window.contains(code) {
                first = Window::explain(Channel(channel as u8), code, self.adc_bits);
            }
        }
        first
    }
}

/// Whether an estimator can be made of the model, of three sensors or two, without the work of making it.
///
/// # Errors
/// Those of [`Estimator::new`].
pub fn validate(model: &Model, adc_bits: u8) -> Result<(), BadModel> {
    validate_without(model, adc_bits, model.absent())
}

/// The same for a model whose sensors have to be good but for one.
pub(crate) fn validate_without(model: &Model, adc_bits: u8, lost: Option<Channel>) -> Result<(), BadModel> {
    check(model, adc_bits, lost).map(|_| ())
}

fn check(model: &Model, adc_bits: u8, lost: Option<Channel>) -> Result<([Window; 3], Inverse), BadModel> {
    let windows = windows(model, adc_bits, lost)?;
    let (inverse, worst) = match lost {
        None => (Inverse::new(model), WORST_NOISE_GAIN),
        Some(lost) => (Inverse::without(lost, model), WORST_NOISE_GAIN_OF_TWO),
    };
    let noise_gain = inverse.noise_gain();
    if noise_gain > worst { Err(BadModel::Placement { noise_gain }) } else { Ok((windows, inverse)) }
}

fn windows(model: &Model, adc_bits: u8, lost: Option<Channel>) -> Result<[Window; 3], BadModel> {
    if !(1..=16).contains(&adc_bits) {
        return Err(BadModel::AdcBits(adc_bits));
    }
    let rail = ((1_u32 << adc_bits) - 1) as f32;
    let mut windows = [Window::all(adc_bits); 3];
    for ((channel, window), sensor) in (0..).map(Channel).zip(&mut windows).zip(&model.sensors) {
        if lost == Some(channel) {
            continue;
        }
        let possible = sensor.amplitude >= 4.0
            && (0.0..=rail).contains(&sensor.offset)
            && sensor.third.abs() + sensor.fifth.abs() <= 0.5;
        let found = Window::new(sensor.offset, sensor.amplitude, adc_bits).filter(|_| possible);
        *window = found.ok_or(BadModel::Sensor(channel))?;
    }
    Ok(windows)
}

/// Makes the table hold, for every quotient, the electrical angle at which the model delivers it.
fn fill_table(table: &mut QuadrantTable, model: &Model, inverse: &Inverse) {
    let mut end = 0;
    for (index, segment) in table.iter_mut().enumerate() {
        let angle = |halves| {
            let (y, x) = trig::segment_vector(index, halves);
            model.electrical(hall_angle(model, inverse, y, x)).to_bits()
        };
        // Within a quadrant a segment begins where the last one ended.
        let start = if index % (1 << trig::QUADRANT_BITS) == 0 { angle(0) } else { end };
        end = angle(2);
        *segment = Segment::along(start, angle(1), end, trig::QUOTIENT_LOW);
    }
}

/// The Hall angles that an estimator tells of codes, which need not be whole.
pub(crate) fn hall_angles(
    model: &Model,
    codes: impl Iterator<Item = [f32; 3]>,
) -> impl Iterator<Item = ElectricalAngle> {
    let inverse = model.absent().map_or_else(|| Inverse::new(model), |lost| Inverse::without(lost, model));
    let signal = |code: f32, sensor: &Sensor| {
        if sensor.amplitude > 0.0 { (code - sensor.offset) / sensor.amplitude } else { 0.0 }
    };
    codes.map(move |codes| {
        let (cosine, sine) = inverse.apply(core::array::from_fn(|k| signal(codes[k], &model.sensors[k])));
        hall_angle(model, &inverse, sine, cosine)
    })
}

/// The Hall angle at which the model's (cosine, sine) points along (`x`, `y`).
fn hall_angle(model: &Model, inverse: &Inverse, y: f32, x: f32) -> ElectricalAngle {
    let mut hall = ElectricalAngle::from_radians(crate::float::atan2(y, x));
    // Each step divides the error by the size of the harmonics; five reach the bits of a float.
    for _ in 0..5 {
        let (cosine, sine) = inverse.apply(core::array::from_fn(|k| model.sensors[k].wave(hall)));
        hall += ElectricalAngle::from_radians(crate::float::atan2(y * cosine - x * sine, x * cosine + y * sine));
    }
    hall
}

#[cfg(test)]
mod tests;
