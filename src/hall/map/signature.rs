//! Which pole the rotor is at, by what the Halls show of each magnet beside the angle: how strong it is, and what the
//! sensors have in common where it passes them.
//!
//! A pole is found by the [map](super::Finder) only while inertia carries the rotor on, as the angle alone cannot tell a
//! magnet out of its place from a rotor that cogging has moved. A slow rotor, or one that a hand turns, is found by this:
//! the signals less the calibrated model's at the tracked angle, less what an error of that angle could explain, which
//! lies along the [slopes](crate::hall::model::Sensor::slope). What is left has nothing to do with how the rotor moves.
//!
//! It is averaged in [`CELLS`] of the mechanical turn at most, and from each cell is taken what it has in common with the
//! same part of the other electrical turns: sensors that drift, harmonics that the model lacks, and the field of a steady
//! current are alike at all poles. So it takes a whole turn, in pieces of any order and direction.
//!
//! Poles are told apart as by a [`Finder`](super::Finder): of what two of them leave over, aⱼ and aₖ,
//! ρ = (aₖ − aⱼ) / Σ(sₖ − sⱼ)² is 1 where j is right and −1 where k is.

use super::Map;
use super::find::{ALIKE_DEG, FIT, SIGMAS, Verdict};
use crate::angle::{ElectricalAngle, PolePairs, Position, TURN};
use crate::hall::model::Model;
use crate::hall::{Codes, Halls};
use core::f32::consts::PI;

/// Most cells of a mechanical turn, and most pole pairs: four cells in each of eleven electrical turns, two in 22.
pub const CELLS: usize = 44;
/// log₂ of the most cells of an electrical turn.
const MOST_BITS: u32 = 3;
/// Sensors.
const SENSORS: usize = 3;
/// Bytes of a signature of the most cells.
pub const LONGEST: usize = SENSORS * CELLS;
/// Stored values for one amplitude.
const UNIT: f32 = 256.0;
/// RMS of a signature that tells something, share of the amplitude: half a stored value.
const LEAST_TOLD: f32 = 0.5 / UNIT;
/// Samples in each cell, at least.
const LEAST: u16 = 8;
/// Samples are apart by a cell over this, at least, or a rotor at rest would weigh one place most.
const FINENESS: u32 = 16;
/// Times that as many samples again are waited for, before all begins anew.
const DOUBLINGS: u8 = 6;
/// What may be left over at a pole that is sure, beside the noise, as a share of what the nearest other one differs by.
const LEFT: f32 = 0.05;

/// How the cells lie over the mechanical turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Grid {
    poles: usize,
    /// log₂ of the cells in an electrical turn.
    bits: u32,
}

impl Grid {
    /// `None` for more pole pairs than cells.
    fn new(pole_pairs: PolePairs) -> Option<Self> {
        let poles = usize::from(pole_pairs.get());
        let bits = (CELLS / poles).checked_ilog2()?.min(MOST_BITS);
        Some(Self { poles, bits })
    }

    const fn cells(self) -> usize {
        self.poles << self.bits
    }

    const fn sectors(self) -> usize {
        1 << self.bits
    }

    fn cell(self, position: Position) -> usize {
        let pole = (position.to_bits() >> 32).rem_euclid(self.poles as i64) as usize;
        let sector = (position.to_bits() as u32).unbounded_shr(32 - self.bits) as usize;
        (pole << self.bits) + sector
    }

    /// A place within a cell, from its begin to its end.
    fn position(self, cell: usize, share: f32) -> Position {
        let width = TURN / self.sectors() as f32;
        Position::from_bits(((cell as i64) << (32 - self.bits)) + (share * width) as i64)
    }

    /// The cell so many electrical turns further on.
    const fn further(self, cell: usize, poles: usize) -> usize {
        (cell + (poles << self.bits)) % self.cells()
    }
}

/// What a rotor's magnets show: for each sensor and cell, in 2⁻⁸ of the amplitude.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signature {
    grid: Grid,
    cells: [[i8; SENSORS]; CELLS],
}

impl Signature {
    /// Of values as [`Self::values`] has them, each a byte. `None` where their number does not fit the pole pairs.
    pub fn of_bytes(pole_pairs: PolePairs, bytes: &[u8]) -> Option<Self> {
        let grid = Grid::new(pole_pairs)?;
        if bytes.len() != SENSORS * grid.cells() {
            return None;
        }
        let mut cells = [[0; SENSORS]; CELLS];
        cells.as_flattened_mut().iter_mut().zip(bytes).for_each(|(value, byte)| *value = i8::from_le_bytes([*byte]));
        Some(Self { grid, cells })
    }

    /// Cell by cell from the map's begin, the sensors' values.
    pub fn values(&self) -> &[i8] {
        self.cells.get(..self.grid.cells()).unwrap_or(&self.cells).as_flattened()
    }

    /// The same where the angle counts the other way.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let mut reversed = *self;
        reversed.cells.get_mut(..self.grid.cells()).unwrap_or_default().reverse();
        reversed
    }

    /// What the magnets differ by at each sensor, share of the amplitude RMS.
    pub fn rms(&self) -> [f32; SENSORS] {
        let cells = 0..self.grid.cells();
        let mut squares = [0.0; SENSORS];
        for value in cells.clone().map(|cell| self.at(cell, 0)) {
            squares.iter_mut().zip(value).for_each(|(square, value)| *square += value * value);
        }
        squares.map(|square| crate::float::root(square / cells.len() as f32))
    }

    /// Whether it tells anything: where all poles are alike, as the only one is, nothing but noise is left of it.
    pub fn tells(&self) -> bool {
        self.rms().iter().any(|&rms| rms > LEAST_TOLD)
    }

    /// What a calibration's alignment is off by, electrical turns, for magnets that a `map` without a mean has. It took the
    /// angle of the codes' mean over all poles at an angle of the field, Σ rₖ δₖ / Σ rₖ, where a strong magnet (rₖ) counts
    /// for more than a weak one, and not the mean of their angles (δₖ). Nothing for two sensors, and where there is no
    /// more than a cell for an electrical turn: over that, no strength shows.
    pub(super) fn misalignment(&self, model: &Model, map: &Map) -> f32 {
        let (cells, sectors) = (self.grid.cells(), self.grid.sectors());
        if sectors < 2 || model.halls() == Halls::Two {
            return 0.0;
        }
        // The mean over a cell takes this from what turns with the angle.
        let half = PI / sectors as f32;
        let seen = libm::sinf(half) / half;
        let sum: f32 = (0..cells).map(|cell| self.stronger(cell, model) * self.mean_error(cell, map)).sum();
        sum / (seen * cells as f32)
    }

    /// How much stronger a magnet is than the same part of the other poles' mean, as a share.
    fn stronger(&self, cell: usize, model: &Model) -> f32 {
        let hall = model.hall(self.grid.position(cell, 0.5).angle());
        // What all signals would grow by, but for what an error of the angle could explain.
        let waves = without_slope(model, hall, model.sensors.each_ref().map(|sensor| sensor.wave(hall)));
        dot(&self.at(cell, 0), &waves) / dot(&waves, &waves).max(f32::MIN_POSITIVE)
    }

    /// Mean of a map over a cell, electrical turns.
    fn mean_error(&self, cell: usize, map: &Map) -> f32 {
        let at = |share: f32| map.error(self.grid.position(cell, share)).to_bits() as f32;
        [0.125, 0.375, 0.625, 0.875].into_iter().map(at).sum::<f32>() / (4.0 * TURN)
    }

    /// In amplitudes, where the rotor is so many electrical turns further than its position says.
    fn at(&self, cell: usize, poles: usize) -> [f32; SENSORS] {
        self.cells[self.grid.further(cell, poles) % CELLS].map(|value| f32::from(value) / UNIT)
    }
}

/// Averages what the Halls show over the mechanical turn: 700 bytes.
#[derive(Clone, Debug)]
pub struct Collector {
    grid: Option<Grid>,
    /// Sums in each cell, and of how many samples; the sum of all squares.
    sums: [[f32; SENSORS]; CELLS],
    counts: [u16; CELLS],
    squares: f32,
    /// Where the last sample was taken.
    last: Position,
    /// Samples in all, and with how many the next verdict is due.
    samples: u32,
    due: u32,
    doublings: u8,
}

impl Collector {
    /// Takes nothing until it is [begun](Self::begin).
    pub const OFF: Self = Self {
        grid: None,
        sums: [[0.0; SENSORS]; CELLS],
        counts: [0; CELLS],
        squares: 0.0,
        last: Position::from_bits(0),
        samples: 0,
        due: 0,
        doublings: 0,
    };

    /// Begins anew; stays off for a rotor of more pole pairs than there are cells.
    pub fn begin(&mut self, pole_pairs: PolePairs) {
        *self = Self::OFF;
        self.grid = Grid::new(pole_pairs);
    }

    /// Takes the codes of sensors of a model at a tracked position.
    pub fn push(&mut self, model: &Model, codes: &Codes, position: Position) {
        let Some(grid) = self.grid else { return };
        let apart = position.to_bits().wrapping_sub(self.last.to_bits()).unsigned_abs();
        if self.samples > 0 && apart < (1 << (32 - grid.bits)) / u64::from(FINENESS) {
            return;
        }
        let cell = grid.cell(position) % CELLS;
        let Some(count) = self.counts[cell].checked_add(1) else { return };
        (self.last, self.samples, self.counts[cell]) = (position, self.samples.saturating_add(1), count);
        let shown = beside_the_angle(model, codes, position);
        self.sums[cell].iter_mut().zip(shown).for_each(|(sum, shown)| *sum += shown);
        self.squares += square(shown, [0.0; SENSORS]);
    }

    /// Whether every cell has its samples.
    fn is_complete(&self) -> bool {
        let used = self.grid.and_then(|grid| self.counts.get(..grid.cells()));
        used.is_some_and(|counts| counts.iter().all(|&count| count >= LEAST))
    }

    /// What has been seen of this rotor, once the turn is complete.
    pub fn signature(&self) -> Option<Signature> {
        let seen = self.seen().filter(|_| self.is_complete())?;
        let mut signature = Signature { grid: seen.grid, cells: [[0; SENSORS]; CELLS] };
        for (index, cell) in signature.cells.iter_mut().enumerate().take(seen.grid.cells()) {
            *cell = seen.at(index).map(|value| crate::float::nearest(value * UNIT).clamp(-127, 127) as i8);
        }
        Some(signature)
    }

    fn seen(&self) -> Option<Seen<'_>> {
        let grid = self.grid?;
        let mut seen = Seen { grid, collector: self, common: [[0.0; SENSORS]; 1 << MOST_BITS] };
        for cell in 0..grid.cells() {
            let mean = seen.mean(cell);
            for (common, mean) in seen.common[cell % grid.sectors()].iter_mut().zip(mean) {
                *common += mean / grid.poles as f32;
            }
        }
        Some(seen)
    }

    /// Judges the poles by a signature of this rotor, where it is time for that: every time that a turn is complete, of
    /// one that is `used`, or else with ever more samples.
    #[inline(never)]
    pub fn judge(&mut self, signature: &Signature, map: &Map, used: Option<i32>) -> Option<Verdict> {
        if self.samples < self.due || !self.is_complete() {
            return None;
        }
        let verdict = self.seen().filter(|seen| seen.grid == signature.grid)?.verdict(signature, map, used)?;
        self.doublings += 1;
        self.due = self.samples.saturating_mul(2);
        if used.is_some() || verdict.sure || self.doublings > DOUBLINGS {
            self.begin(PolePairs::new(map.pole_pairs())?);
        }
        Some(verdict)
    }
}

/// What was collected, and what it has in common at all poles.
struct Seen<'a> {
    grid: Grid,
    collector: &'a Collector,
    common: [[f32; SENSORS]; 1 << MOST_BITS],
}

impl Seen<'_> {
    fn count(&self, cell: usize) -> f32 {
        f32::from(self.collector.counts[cell % CELLS].max(1))
    }

    fn mean(&self, cell: usize) -> [f32; SENSORS] {
        let count = self.count(cell);
        self.collector.sums[cell % CELLS].map(|sum| sum / count)
    }

    fn at(&self, cell: usize) -> [f32; SENSORS] {
        let (mean, common) = (self.mean(cell), &self.common[cell % self.grid.sectors()]);
        [0, 1, 2].map(|k| mean[k] - common[k])
    }

    /// What noise leaves over of the means: samples of all cells have the same.
    fn noise(&self) -> f32 {
        let cells = || 0..self.grid.cells();
        let of_means: f32 = cells().map(|cell| self.count(cell) * square(self.mean(cell), [0.0; SENSORS])).sum();
        let of_one = (self.collector.squares - of_means) / self.collector.samples.max(1) as f32;
        cells().map(|cell| of_one / self.count(cell)).sum()
    }

    /// Sum of squares over the turn of what a signature, where it is `scale` and begins at a pole, leaves over.
    fn left(&self, signature: &Signature, pole: usize, scale: f32) -> f32 {
        let cells = 0..self.grid.cells();
        cells.map(|cell| square(self.at(cell), signature.at(cell, pole).map(|value| scale * value))).sum()
    }

    fn verdict(&self, signature: &Signature, map: &Map, used: Option<i32>) -> Option<Verdict> {
        let poles = self.grid.poles;
        let least = || {
            (0..poles)
                .min_by(|&one, &other| self.left(signature, one, 1.0).total_cmp(&self.left(signature, other, 1.0)))
        };
        let chosen = used.and_then(|used| usize::try_from(used).ok()).or_else(least)?;
        let left = self.left(signature, chosen, 1.0);
        let apart = |pole: usize| -> f32 {
            (0..self.grid.cells()).map(|cell| square(signature.at(cell, pole), signature.at(cell, chosen))).sum()
        };
        let of_none: f32 = (0..self.grid.cells()).map(|cell| square(signature.at(cell, 0), [0.0; SENSORS])).sum();
        // What a pole, or no signature, leaves over more than the chosen one, and what they are apart.
        let none = (self.left(signature, chosen, 0.0) - left, of_none);
        let others = (0..poles)
            .filter(|&pole| map.difference_deg(pole as i32 - chosen as i32) > ALIKE_DEG)
            .map(|pole| (self.left(signature, pole, 1.0) - left, apart(pole)))
            .chain([none]);
        let values = (SENSORS * self.grid.cells()) as f32;
        let (mut fit, mut sigmas, mut nearest) = (f32::MAX, f32::MAX, f32::MAX);
        for (more, apart) in others {
            let apart = apart.max(f32::MIN_POSITIVE);
            fit = fit.min(more / apart);
            // Noise, which the better of the two leaves over, moves ρ by twice its size over the root of what they are apart.
            let moved = 2.0 * crate::float::root(apart * left.min(left + more) / values);
            sigmas = sigmas.min(more / moved.max(f32::MIN_POSITIVE));
            nearest = nearest.min(apart);
        }
        Some(Verdict {
            electrical_turns: chosen as i32,
            fit,
            left_deg: f32::NAN,
            sure: fit >= FIT && sigmas >= SIGMAS && left - self.noise() <= LEFT * nearest,
            misfit: fit <= -FIT && sigmas <= -SIGMAS,
        })
    }
}

/// Square of the distance of two.
fn square(one: [f32; SENSORS], other: [f32; SENSORS]) -> f32 {
    one.iter().zip(other).map(|(one, other)| (one - other) * (one - other)).sum()
}

/// The signals less the model's, in amplitudes, without what an error of the angle could explain.
fn beside_the_angle(model: &Model, codes: &Codes, position: Position) -> [f32; SENSORS] {
    let hall = model.hall(position.angle());
    let left = [0, 1, 2].map(|k| (f32::from(codes[k]) - model.sensors[k].code(hall)) / model.sensors[k].amplitude);
    without_slope(model, hall, left)
}

/// A change of the signals without what an error of the angle could explain.
fn without_slope(model: &Model, hall: ElectricalAngle, change: [f32; SENSORS]) -> [f32; SENSORS] {
    let slopes = model.sensors.each_ref().map(|sensor| sensor.slope(hall));
    let error = dot(&change, &slopes) / dot(&slopes, &slopes).max(f32::MIN_POSITIVE);
    [0, 1, 2].map(|k| change[k] - error * slopes[k])
}

fn dot(one: &[f32; SENSORS], other: &[f32; SENSORS]) -> f32 {
    one.iter().zip(other).map(|(a, b)| a * b).sum()
}
