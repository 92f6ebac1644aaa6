//! Why a run gives no calibration.

use crate::vernier::rings::Ring;
use core::fmt;

/// Why a run gives no calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// The recording ended before everything was measured.
    TooShort {
        /// Turns complete.
        turns: u8,
        /// Turns necessary.
        of: u8,
    },
    /// Less than 32 samples to a pole pair, or a sample was left out.
    TooFast,
    /// The shaft has turned back.
    Reversed,
    /// The speed changed too much: too few pole pairs are like the others.
    Unsteady {
        /// Pole pairs that are.
        kept: u8,
        /// Pole pairs of the ring.
        of: u8,
    },
    /// A head's error has the fourth harmonic of a signal that is cut off at its peaks.
    Saturated {
        /// The head's ring.
        ring: Ring,
        /// Which of its heads, counted from 0; the text counts from 1.
        head: u8,
    },
    /// A head's error is larger than 1/16 of a pole pair.
    Nonlinear {
        /// The head's ring.
        ring: Ring,
        /// Which of its heads, counted from 0; the text counts from 1.
        head: u8,
    },
    /// The heads of a ring are more than 3/8 of a pole pair apart at some shaft angles.
    HeadsApart(Ring),
    /// The rings contradict each other by too much of the margin.
    Margin {
        /// The largest residual, in 2⁻¹⁶ of the distance of two table entries.
        worst: u32,
        /// The margin in the same unit.
        margin: u32,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { turns, of } => {
                write!(f, "the run is too short: {turns} of {of} turns")
            }
            Self::TooFast => f.write_str("the shaft turns too fast for the sampling, or samples are missing"),
            Self::Reversed => f.write_str("the shaft has turned back"),
            Self::Unsteady { kept, of } => {
                write!(f, "the speed is too unsteady: only {kept} of {of} pole pairs are alike")
            }
            Self::Saturated { ring, head } => {
                write!(f, "head {} of the {ring:?} ring is saturated: too close to the magnet", u16::from(*head) + 1)
            }
            Self::Nonlinear { ring, head } => {
                write!(f, "head {} of the {ring:?} ring errs by more than 22.5° electrical", u16::from(*head) + 1)
            }
            Self::HeadsApart(ring) => write!(
                f,
                "the heads of the {ring:?} ring are more than 3/8 of a pole pair apart: misplaced or very eccentric"
            ),
            Self::Margin { worst, margin } => write!(
                f,
                "the rings contradict each other by {worst} of a margin of {margin}: eccentric, or heads misplaced"
            ),
        }
    }
}

impl core::error::Error for Error {}
