//! What whole turns tell of the two rings together: their zeros, the averages, what the curves have missed.
//!
//! Over any motion u = q·x − p·y is constant for ideal rings, x and y being counted on over the pole pairs: the motion
//! itself drops out, so no speed has to be constant here. What is left of u is the error of both rings:
//!
//! - its mean is the distance of their zeros;
//! - its mean over each pole pair of the reference ring is the paper's average of z;
//! - its mean over all visits to a place in the pole pair is the error of that ring's head alone, because coprime rings
//!   meet every place of the one together with every place of the other. That corrects the curves by what an uneven
//!   speed has left in them.

use super::error::Error;
use crate::angle::ElectricalAngle;
use crate::vernier::correct::{NODES, correct_heads, round};
use crate::vernier::encoder::{Calibration, Reading};
use crate::vernier::rings::{Ring, Rings};

/// The places of both rings in 2⁻¹⁶ pole pairs, counted on over the pole pairs.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    pairs: [i32; 2],
    last: [u16; 2],
    places: [i32; 2],
    begun: i32,
}

impl Path {
    /// Begins with the first corrected readings, reference first.
    pub fn new(rings: &Rings, readings: [u16; 2]) -> Self {
        let places = readings.map(i32::from);
        Self {
            pairs: [Ring::Reference, Ring::Vernier].map(|ring| i32::from(rings.pole_pairs(ring))),
            last: readings,
            places,
            begun: places[0],
        }
    }

    /// Goes on to the next readings; true when a turn is complete.
    ///
    /// # Errors
    /// More than a quarter of a pole pair in one step.
    pub fn push(&mut self, readings: [u16; 2]) -> Result<bool, Error> {
        for ((place, last), reading) in self.places.iter_mut().zip(&mut self.last).zip(readings) {
            let step = i32::from(reading.wrapping_sub(*last) as i16);
            if step.abs() > 1 << 14 {
                return Err(Error::TooFast);
            }
            *place += step;
            *last = reading;
        }
        let way = self.places[0] - self.begun;
        let complete = way.abs() >= self.pairs[0] << 16;
        if complete {
            // A turn less on both rings changes nothing else.
            for (place, pairs) in self.places.iter_mut().zip(self.pairs) {
                *place -= way.signum() * (pairs << 16);
            }
        }
        Ok(complete)
    }

    /// u, in 2⁻¹⁶ of the distance of two table entries.
    pub fn difference(&self) -> i32 {
        self.pairs[1] * self.places[0] - self.pairs[0] * self.places[1]
    }

    /// Whole pole pairs of the reference ring since the one in which the path began, modulo the turn.
    pub fn pole_pairs(&self) -> i32 {
        (self.places[0] >> 16).rem_euclid(self.pairs[0])
    }
}

/// A mean in the making.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    sum: i64,
    count: u32,
}

impl Mean {
    /// Takes a value.
    pub fn push(&mut self, value: i32) {
        self.sum += i64::from(value);
        self.count += 1;
    }

    /// The mean; 0 of nothing.
    pub fn get(&self) -> f32 {
        self.sum as f32 / self.count.max(1) as f32
    }
}

/// One turn's values of u, by pole pair of the reference and by place under each head, and how far heads are apart.
#[derive(Clone, Debug)]
pub struct Residuals<const HEADS: usize> {
    all: Mean,
    by_pole_pair: [Mean; 64],
    by_place: [[[Mean; NODES]; HEADS]; 2],
    apart: [[Mean; HEADS]; 2],
}

impl<const HEADS: usize> Default for Residuals<HEADS> {
    fn default() -> Self {
        Self {
            all: Mean::default(),
            by_pole_pair: [Mean::default(); 64],
            by_place: [[[Mean::default(); NODES]; HEADS]; 2],
            apart: [[Mean::default(); HEADS]; 2],
        }
    }
}

impl<const HEADS: usize> Residuals<HEADS> {
    /// Takes a sample, to whose corrected readings the path has come.
    pub fn push(&mut self, path: &Path, calibration: &Calibration<HEADS>, reading: Reading<HEADS>) {
        let difference = path.difference();
        self.all.push(difference);
        self.by_pole_pair[path.pole_pairs() as usize & 63].push(difference);
        for (index, ring) in RINGS.into_iter().enumerate() {
            let readings = reading.ring(ring);
            for (means, reading) in self.by_place[index].iter_mut().zip(readings) {
                // The nearest node; the last half of the last interval belongs to the first.
                let node = ((usize::from(reading) + (1 << 15) / NODES) * NODES) >> 16;
                means[node % NODES].push(difference);
            }
            let heads = correct_heads(calibration.curves(ring), readings);
            for (mean, head) in self.apart[index].iter_mut().zip(heads) {
                mean.push((head.wrapping_sub(heads[0]) as i16).into());
            }
        }
    }

    /// Puts zeros, averages and corrections of the curves into the calibration; returns the largest of the latter, in
    /// 2⁻¹⁶ pole pairs.
    ///
    /// # Errors
    /// An average is further than the margin from where it should be.
    pub fn finish(&self, rings: &Rings, calibration: &mut Calibration<HEADS>) -> Result<u16, Error> {
        let zero = self.align(rings, calibration);
        // The path began in the pole pair that belongs to this entry.
        let lattice = libm::roundf(zero / 65536.0);
        let pairs = usize::from(rings.pole_pairs(Ring::Reference));
        let first = usize::from(rings.pole_pair(lattice as i32));
        let mean = self.all.get();
        for (index, average) in self.by_pole_pair[..pairs].iter().enumerate() {
            let average = average.get() - mean;
            if average.abs() > 32767.0 {
                return Err(Error::Margin { worst: average.abs() as u32, margin: 1 << 15 });
            }
            calibration.averages[(first + index) % pairs] = round(average);
        }
        let offset = (zero - lattice * 65536.0) / pairs as f32;
        for curve in &mut calibration.vernier {
            curve.phase -= in_bits(offset);
        }
        Ok(self.refine(rings, calibration))
    }

    /// Moves the zeros of each ring's heads to that of the first, and returns what that makes of the mean of u.
    fn align(&self, rings: &Rings, calibration: &mut Calibration<HEADS>) -> f32 {
        let mut zero = self.all.get();
        for (index, ring) in RINGS.into_iter().enumerate() {
            for (curve, apart) in calibration.curves_mut(ring).iter_mut().zip(&self.apart[index]) {
                curve.phase += in_bits(apart.get());
                zero -= apart.get() / HEADS as f32 * weight(rings, ring);
            }
        }
        zero
    }

    /// Adds to the curves what they have missed.
    fn refine(&self, rings: &Rings, calibration: &mut Calibration<HEADS>) -> u16 {
        let mut largest = 0;
        for (index, ring) in RINGS.into_iter().enumerate() {
            for (curve, means) in calibration.curves_mut(ring).iter_mut().zip(&self.by_place[index]) {
                let missed = means.map(|mean| (mean.get() - self.all.get()) / weight(rings, ring));
                let constant = missed.iter().sum::<f32>() / NODES as f32;
                for (error, missed) in curve.errors.iter_mut().zip(missed) {
                    let missed = round(missed - constant);
                    *error = error.saturating_add(missed);
                    largest = largest.max(missed.unsigned_abs());
                }
            }
        }
        largest
    }
}

const RINGS: [Ring; 2] = [Ring::Reference, Ring::Vernier];

/// What a pole pair more on this ring adds to u = q·x − p·y.
fn weight(rings: &Rings, ring: Ring) -> f32 {
    match ring {
        Ring::Reference => f32::from(rings.pole_pairs(Ring::Vernier)),
        Ring::Vernier => -f32::from(rings.pole_pairs(Ring::Reference)),
    }
}

/// 2⁻¹⁶ pole pairs as an angle.
fn in_bits(place: f32) -> ElectricalAngle {
    ElectricalAngle::from_turns(place / 65536.0)
}
