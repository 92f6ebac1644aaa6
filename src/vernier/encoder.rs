//! The whole encoder: readings in, absolute angle out, or the reason why there is none.
//!
//! [`Encoder`] is the configuration, made once of the rings and a [`Calibration`]; [`State`] is what one encoder
//! remembers from sample to sample; [`Encoder::step`] is for the interrupt. See [`super::continuity`] for what is
//! checked against the past and how an encoder that has lost its position finds it again.

use super::continuity::{Fault, Limits, State};
use super::correct::{Curve, Linearity, mean};
use super::decode::{AverageTable, Decoded};
use super::rings::{Ring, Rings};
use crate::angle::{ElectricalAngle, MechanicalAngle};
use crate::math::within;
use core::fmt;

/// One sample of every head. One head a ring, or two on opposite sides of the shaft, which cancels eccentricity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reading<const HEADS: usize = 1> {
    /// The heads over the reference ring, in 2⁻¹⁶ pole pairs.
    pub reference: [u16; HEADS],
    /// The heads over the vernier ring, in 2⁻¹⁶ pole pairs.
    pub vernier: [u16; HEADS],
}

impl<const HEADS: usize> Reading<HEADS> {
    /// The heads over a ring.
    pub const fn ring(&self, ring: Ring) -> [u16; HEADS] {
        match ring {
            Ring::Reference => self.reference,
            Ring::Vernier => self.vernier,
        }
    }
}

/// What is known of one built encoder: the result of [`super::calibrate`], and what a drive stores. 272 bytes with one
/// head a ring, 408 with two.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Calibration<const HEADS: usize = 1> {
    /// Error of each head over the reference ring.
    pub reference: [Curve; HEADS],
    /// Error of each head over the vernier ring.
    pub vernier: [Curve; HEADS],
    /// The average residual over each pole pair of the reference ring, in 2⁻¹⁶ of the distance of two table entries.
    pub averages: [i16; 64],
    /// The largest residual accepted, in the same unit; at most 3/4 of the margin.
    pub residual_limit: u16,
    /// Largest distance between the corrected readings of a ring's heads, reference ring first, in 2⁻¹⁶ pole pairs; at
    /// most 3/8 of a pole pair.
    pub head_distance_limits: [u16; 2],
}

impl<const HEADS: usize> Calibration<HEADS> {
    /// The largest [`Self::residual_limit`]: beyond it the neighbouring entry is about as likely.
    pub const RESIDUAL_LIMIT: u16 = 3 << 13;
    /// The largest of [`Self::head_distance_limits`].
    pub const HEAD_DISTANCE_LIMIT: u16 = 3 << 13;

    /// For perfect rings, and heads spread evenly around the shaft whose electrical zeros are aligned at the first
    /// head; the limits at their largest.
    pub fn ideal(rings: &Rings) -> Self {
        let curves = |ring| {
            core::array::from_fn(|head| {
                // A head a fraction of a turn on reads that fraction of all pole pairs less.
                let pairs = u64::from(rings.pole_pairs(ring));
                let phase = ((pairs * head as u64) << 32) / HEADS as u64;
                Curve::shifted(ElectricalAngle::from_bits(phase.wrapping_neg() as i32))
            })
        };
        Self {
            reference: curves(Ring::Reference),
            vernier: curves(Ring::Vernier),
            averages: [0; 64],
            residual_limit: Self::RESIDUAL_LIMIT,
            head_distance_limits: [Self::HEAD_DISTANCE_LIMIT; 2],
        }
    }

    /// The error curves of a ring's heads.
    pub fn curves(&self, ring: Ring) -> &[Curve; HEADS] {
        match ring {
            Ring::Reference => &self.reference,
            Ring::Vernier => &self.vernier,
        }
    }

    /// The error curves of a ring's heads.
    pub fn curves_mut(&mut self, ring: Ring) -> &mut [Curve; HEADS] {
        match ring {
            Ring::Reference => &mut self.reference,
            Ring::Vernier => &mut self.vernier,
        }
    }
}

/// Why no encoder can be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EncoderError {
    /// The calibration's `residual_limit` is 0 or above [`Calibration::RESIDUAL_LIMIT`].
    ResidualLimit(u16),
    /// One of the calibration's `head_distance_limits` is above [`Calibration::HEAD_DISTANCE_LIMIT`].
    HeadDistanceLimit(u16),
    /// The shaft may not turn backwards in the largest step, nor further than `largest`.
    LargestStep {
        /// What was asked for.
        found: MechanicalAngle,
        /// A quarter of the shorter pole pair.
        largest: MechanicalAngle,
    },
}

impl fmt::Display for EncoderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ResidualLimit(found) => {
                write!(f, "the calibration's residual limit is {found}, not 1 to {}", Calibration::<1>::RESIDUAL_LIMIT)
            }
            Self::HeadDistanceLimit(found) => {
                write!(
                    f,
                    "the calibration lets heads be {found} apart, more than {}",
                    Calibration::<1>::HEAD_DISTANCE_LIMIT
                )
            }
            Self::LargestStep { found, largest } => write!(
                f,
                "the largest step between samples is {found}, not above 0° and up to {largest}, 1/4 of a pole pair"
            ),
        }
    }
}

impl core::error::Error for EncoderError {}

/// The encoder's configuration: 1080 bytes with one head a ring, 1592 with two.
///
/// The layout is kept as written: what is read in every step is near the begin, where one instruction loads two words.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Encoder<const HEADS: usize = 1> {
    residual_limit: u32,
    head_distance_limits: [u16; 2],
    table: AverageTable,
    reference: [Linearity; HEADS],
    vernier: [Linearity; HEADS],
    limits: Limits,
}

impl<const HEADS: usize> Encoder<HEADS> {
    /// The encoder of these rings, on a shaft that turns at most `largest_step` between two samples.
    ///
    /// `largest_step` must be above zero and at most a quarter of the shorter pole pair: with 45 pole pairs at 20 kHz
    /// that allows 6666 rpm.
    ///
    /// # Errors
    /// Names the limit that is out of range.
    pub fn new(
        rings: &Rings,
        calibration: &Calibration<HEADS>,
        largest_step: MechanicalAngle,
    ) -> Result<Self, EncoderError> {
        let residual_limit = calibration.residual_limit;
        if residual_limit == 0 || residual_limit > Calibration::<HEADS>::RESIDUAL_LIMIT {
            return Err(EncoderError::ResidualLimit(residual_limit));
        }
        for limit in calibration.head_distance_limits {
            if limit > Calibration::<HEADS>::HEAD_DISTANCE_LIMIT {
                return Err(EncoderError::HeadDistanceLimit(limit));
            }
        }
        Ok(Self {
            reference: calibration.reference.each_ref().map(Linearity::new),
            vernier: calibration.vernier.each_ref().map(Linearity::new),
            table: AverageTable::new(rings, &calibration.averages),
            residual_limit: u32::from(residual_limit),
            head_distance_limits: calibration.head_distance_limits,
            limits: Limits::new(rings, largest_step)
                .map_err(|largest| EncoderError::LargestStep { found: largest_step, largest })?,
        })
    }

    /// The readings of both rings, corrected and averaged over their heads, and how far these are apart.
    #[inline(always)]
    pub fn correct(&self, reading: Reading<HEADS>) -> ([u16; 2], [u16; 2]) {
        let (x, x_apart) =
            mean::<HEADS>(core::array::from_fn(|head| self.reference[head].correct(reading.reference[head])));
        let (y, y_apart) =
            mean::<HEADS>(core::array::from_fn(|head| self.vernier[head].correct(reading.vernier[head])));
        ([x, y], [x_apart, y_apart])
    }

    /// The absolute angle of one sample on its own, without memory and without any check but that of the margin,
    /// which is the caller's: see [`Decoded::residual`].
    #[inline(always)]
    pub fn decode(&self, reading: Reading<HEADS>) -> Decoded {
        let ([x, y], _) = self.correct(reading);
        self.table.decode(x, y)
    }

    /// Takes one sample. An angle that is returned is right to within the margin of the rings, however one head, one
    /// magnet or the wiring fails after the encoder has proved itself ([`State::is_proven`]); see
    /// [`super::continuity`].
    ///
    /// # Errors
    /// The reason why this sample's angle is not believed. The next may be.
    #[inline(always)]
    pub fn step(&self, state: &mut State, reading: Reading<HEADS>) -> Result<Decoded, Fault> {
        let ([x, y], apart) = self.correct(reading);
        let decoded = self.table.decode(x, y);
        if self.contradiction(decoded, apart).is_none() && state.follow(decoded.angle) {
            Ok(decoded)
        } else {
            self.doubt(state, reading)
        }
    }

    /// A sample that is not simply the next: decoded once more, to keep the usual way short.
    #[cold]
    #[inline(never)]
    fn doubt(&self, state: &mut State, reading: Reading<HEADS>) -> Result<Decoded, Fault> {
        let ([x, y], apart) = self.correct(reading);
        let decoded = self.table.decode(x, y);
        state.doubt(&self.limits, decoded, x, self.contradiction(decoded, apart))
    }

    /// Takes a sample that could not be read: a head reported a fault, a transfer failed.
    ///
    /// # Errors
    /// Always [`Fault::Unread`].
    pub fn miss(&self, state: &mut State) -> Result<Decoded, Fault> {
        state.miss(&self.limits);
        Err(Fault::Unread)
    }

    /// What is wrong with a sample by itself.
    #[inline(always)]
    fn contradiction(&self, decoded: Decoded, apart: [u16; 2]) -> Option<Fault> {
        if HEADS > 1 && apart[0] > self.head_distance_limits[0] {
            Some(Fault::HeadsApart(Ring::Reference))
        } else if HEADS > 1 && apart[1] > self.head_distance_limits[1] {
            Some(Fault::HeadsApart(Ring::Vernier))
        } else if !within(decoded.residual, self.residual_limit) {
            Some(Fault::Residual)
        } else {
            None
        }
    }
}
