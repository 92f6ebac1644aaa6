//! Calibration by the drive itself: a few turns at roughly constant speed, and no reference encoder.
//!
//! [`Calibrator`] takes sample after sample, on the chip or from a recording:
//!
//! 1. a turn for each head: its error curve, after section IV.B of the paper ([`curve`]);
//! 2. a turn for the zeros of the heads and the rings, for the averages, and for what the curves have missed;
//! 3. a turn to check: "it is very important to validate the result because the algorithm can converge to a bad
//!    result". The largest residual is held against the margin that the averages leave, and the limits that
//!    [`super::encoder`] will hold every sample to are put between the two.
//!
//! That is four turns and a few pole pairs with one head a ring, six with two. A run that was not fit is refused
//! with the reason. The zero of the angle, which nothing but a reference can tell, stays where the calibration that one
//! starts from has it.

pub mod curve;
mod error;
mod turn;

use super::correct::{NODES, correct_heads, mean, round};
use super::decode::AverageTable;
use super::encoder::{Calibration, Reading};
use super::rings::{Ring, Rings};
use crate::angle::ElectricalAngle;
use crate::trig::sin_cos_f32;
use curve::Average;
pub use error::Error;
use turn::{Path, Residuals};

/// What a calibration is worth. Residual and margin in 2⁻¹⁶ of the distance of two table entries
/// ([`Rings::residual_counts`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// The largest residual of the last turn.
    pub worst_residual: u32,
    /// Half the smallest distance of two entries that are neighbours in the table, 2¹⁵ for ideal rings: what a residual
    /// must reach for a wrong pole pair.
    pub margin: u32,
    /// The smallest share of pole pairs that a curve was averaged from, in percent.
    pub similar_percent: u8,
    /// The largest change of a curve that the turn for the averages brought, in 2⁻¹⁶ pole pairs.
    pub refinement: u16,
}

/// The largest share of the margin, in eighths, that residuals may take up in the last turn.
const MARGIN_EIGHTHS: u32 = 5;

/// The largest fourth harmonic of an unsaturated head's curve, in pole pairs: 2° electrical.
const FOURTH_HARMONIC: f32 = 2.0 / 360.0;

/// The largest error of a head, in pole pairs.
const LARGEST_ERROR: f32 = 1.0 / 16.0;

/// The calibration run: 4616 bytes with one head a ring, 4752 with two. Samples are to be taken at equal intervals.
#[derive(Clone, Debug)]
pub struct Calibrator<const HEADS: usize = 1> {
    rings: Rings,
    calibration: Calibration<HEADS>,
    report: Report,
    stage: Stage<HEADS>,
    turns: u8,
}

#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to put the larger one on")]
enum Stage<const HEADS: usize> {
    Curve { ring: Ring, head: usize, run: curve::Run },
    Averages(Option<Path>, Residuals<HEADS>),
    Check(Check),
    Done,
}

/// The last turn.
#[derive(Clone, Debug)]
struct Check {
    table: AverageTable,
    /// The way since the first sample, and the pole pair that began in.
    path: Option<(Path, u8)>,
    worst_residual: u32,
    worst_apart: [u16; 2],
}

impl<const HEADS: usize> Calibrator<HEADS> {
    /// Calibrates anew an encoder whose zeros are those of `previous`: the calibration stored, or
    /// [`Calibration::ideal`] for the first.
    pub fn new(rings: &Rings, previous: &Calibration<HEADS>) -> Self {
        let mut calibration = previous.clone();
        for ring in [Ring::Reference, Ring::Vernier] {
            for curve in calibration.curves_mut(ring) {
                curve.errors = [0; NODES];
            }
        }
        Self {
            rings: *rings,
            calibration,
            report: Report { similar_percent: 100, ..Report::default() },
            stage: Stage::Curve {
                ring: Ring::Reference,
                head: 0,
                run: curve::Run::new(rings.pole_pairs(Ring::Reference)),
            },
            turns: 0,
        }
    }

    /// Takes a sample; true when all is measured, after which samples are ignored.
    ///
    /// # Errors
    /// Why the run is not fit; a new calibrator is needed.
    pub fn push(&mut self, reading: Reading<HEADS>) -> Result<bool, Error> {
        match &mut self.stage {
            Stage::Curve { ring, head, run } => {
                if run.push(reading.ring(*ring)[*head])? {
                    let (ring, head) = (*ring, *head);
                    let average = run.average()?;
                    self.take_curve(ring, head, &average)?;
                    self.turns += 1;
                    self.stage = self.after_curve(ring, head);
                }
            }
            Stage::Averages(path, residuals) => {
                let (readings, _) = correct(&self.calibration, reading);
                let path = path.get_or_insert_with(|| Path::new(&self.rings, readings));
                let complete = path.push(readings)?;
                residuals.push(path, &self.calibration, reading);
                if complete {
                    self.report.refinement = residuals.finish(&self.rings, &mut self.calibration)?;
                    self.turns += 1;
                    self.stage = Stage::Check(Check::new(&self.rings, &self.calibration));
                }
            }
            Stage::Check(check) => {
                let (readings, apart) = correct(&self.calibration, reading);
                if check.push(&self.rings, readings, apart)? {
                    check.finish(&self.rings, &mut self.calibration, &mut self.report)?;
                    self.turns += 1;
                    self.stage = Stage::Done;
                }
            }
            Stage::Done => {}
        }
        Ok(matches!(self.stage, Stage::Done))
    }

    /// Turns complete, and how many are necessary.
    pub const fn turns(&self) -> (u8, u8) {
        (self.turns, 2 * HEADS as u8 + 2)
    }

    /// The calibration and what it is worth.
    ///
    /// # Errors
    /// [`Error::TooShort`] before [`Self::push`] has returned true.
    pub fn finish(self) -> Result<(Calibration<HEADS>, Report), Error> {
        match self.stage {
            Stage::Done => Ok((self.calibration, self.report)),
            _ => Err(Error::TooShort { turns: self.turns().0, of: self.turns().1 }),
        }
    }

    fn take_curve(&mut self, ring: Ring, head: usize, average: &Average) -> Result<(), Error> {
        let errors = &average.errors;
        if harmonic(errors, 4) > FOURTH_HARMONIC {
            return Err(Error::Saturated { ring, head: head as u8 });
        }
        if errors.iter().any(|error| error.abs() > LARGEST_ERROR) {
            return Err(Error::Nonlinear { ring, head: head as u8 });
        }
        let percent = u32::from(average.similar) * 100 / u32::from(self.rings.pole_pairs(ring));
        self.report.similar_percent = self.report.similar_percent.min(percent as u8);
        self.calibration.curves_mut(ring)[head].errors = errors.map(|error| round(error * 65536.0));
        Ok(())
    }

    fn after_curve(&self, ring: Ring, head: usize) -> Stage<HEADS> {
        let (ring, head) = match (ring, head + 1) {
            (ring, head) if head < HEADS => (ring, head),
            (Ring::Reference, _) => (Ring::Vernier, 0),
            (Ring::Vernier, _) => return Stage::Averages(None, Residuals::default()),
        };
        Stage::Curve { ring, head, run: curve::Run::new(self.rings.pole_pairs(ring)) }
    }
}

impl Check {
    fn new<const HEADS: usize>(rings: &Rings, calibration: &Calibration<HEADS>) -> Self {
        Self {
            table: AverageTable::new(rings, &calibration.averages),
            path: None,
            worst_residual: 0,
            worst_apart: [0; 2],
        }
    }

    /// Takes a sample; true when the turn is complete.
    fn push(&mut self, rings: &Rings, readings: [u16; 2], apart: [u16; 2]) -> Result<bool, Error> {
        let decoded = self.table.decode(readings[0], readings[1]);
        let (path, begun) = self.path.get_or_insert_with(|| (Path::new(rings, readings), decoded.pole_pair));
        let complete = path.push(readings)?;
        let residual = decoded.residual.unsigned_abs();
        let pole_pair = (i32::from(*begun) + path.pole_pairs()) % i32::from(rings.pole_pairs(Ring::Reference));
        if i32::from(decoded.pole_pair) != pole_pair {
            return Err(Error::Margin { worst: residual, margin: residual });
        }
        self.worst_residual = self.worst_residual.max(residual);
        for (worst, apart) in self.worst_apart.iter_mut().zip(apart) {
            *worst = apart.max(*worst);
        }
        Ok(complete)
    }

    /// Puts the limits between what was seen and what would be wrong.
    fn finish<const HEADS: usize>(
        &self,
        rings: &Rings,
        calibration: &mut Calibration<HEADS>,
        report: &mut Report,
    ) -> Result<(), Error> {
        let worst = self.worst_residual;
        let margin = margin(rings, &calibration.averages);
        if worst * 8 > margin * MARGIN_EIGHTHS {
            return Err(Error::Margin { worst, margin });
        }
        report.worst_residual = worst;
        report.margin = margin;
        let limit = worst + (margin - worst) / 3;
        calibration.residual_limit = limit.clamp(1, Calibration::<HEADS>::RESIDUAL_LIMIT.into()) as u16;
        for (ring, (limit, worst)) in [Ring::Reference, Ring::Vernier]
            .into_iter()
            .zip(calibration.head_distance_limits.iter_mut().zip(self.worst_apart))
        {
            if worst > Calibration::<HEADS>::HEAD_DISTANCE_LIMIT {
                return Err(Error::HeadsApart(ring));
            }
            // A quarter more, and 1/64 of a pole pair.
            *limit = (worst + worst / 4 + 1024).min(Calibration::<HEADS>::HEAD_DISTANCE_LIMIT);
        }
        Ok(())
    }
}

/// Half the smallest distance of two neighbours in the table of averages: what a residual must reach for a wrong pole
/// pair, in 2⁻¹⁶ of the distance of two table entries.
pub fn margin(rings: &Rings, averages: &[i16; 64]) -> u32 {
    let pole_pairs = i32::from(rings.pole_pairs(Ring::Reference));
    let average = |lattice| i32::from(averages[usize::from(rings.pole_pair(lattice))]);
    (0..pole_pairs).map(|lattice| ((1 << 16) + average(lattice + 1) - average(lattice)) / 2).min().unwrap_or(0) as u32
}

/// The corrected readings of both rings and how far their heads are apart.
fn correct<const HEADS: usize>(calibration: &Calibration<HEADS>, reading: Reading<HEADS>) -> ([u16; 2], [u16; 2]) {
    let (x, x_apart) = mean(correct_heads(&calibration.reference, reading.reference));
    let (y, y_apart) = mean(correct_heads(&calibration.vernier, reading.vernier));
    ([x, y], [x_apart, y_apart])
}

/// Amplitude of a harmonic of a curve.
fn harmonic(curve: &[f32; NODES], order: usize) -> f32 {
    let (mut sine, mut cosine) = (0.0, 0.0);
    for (node, value) in curve.iter().enumerate() {
        let angle = ElectricalAngle::from_bits(((node * order) as i32) << (32 - NODES.ilog2()));
        let (s, c) = sin_cos_f32(angle);
        sine += value * s;
        cosine += value * c;
    }
    crate::float::root(sine * sine + cosine * cosine) * (2.0 / NODES as f32)
}
