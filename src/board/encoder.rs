//! The seam for an absolute encoder on the shaft.

use crate::angle::MechanicalAngle;
use core::fmt::Debug;

/// An absolute encoder: the shaft's angle from the first sample after power-up, or why there is none. What it needs to
/// know is shared and calibrated by a task; what it remembers from sample to sample is the interrupt's.
///
/// [`Encoder`](crate::vernier::encoder::Encoder), the two-ring vernier, is one. A magnetic encoder on a bus is another:
/// its reading is the word that was last received, its fault the error flag in it.
pub trait AbsoluteEncoder {
    /// What the board reads of it at the instant of the [`Sample`](super::Sample).
    type Reading: Copy;
    /// What is remembered from sample to sample; new after another encoder was installed.
    type State: Default;
    /// Why a sample has no angle.
    type Fault: Copy + PartialEq + Debug;

    /// The angle at the instant of the reading. In the control interrupt: no panic, no waiting.
    ///
    /// # Errors
    /// There is none; for more samples in a row than the drive tolerates, a running drive fails with
    /// [`Fault::Encoder`](crate::fault::Fault::Encoder).
    fn angle(&self, state: &mut Self::State, reading: Self::Reading) -> Result<MechanicalAngle, Self::Fault>;

    /// Whether motion since power-up has shown the angle to be right; an encoder that needs no proof always says so.
    fn is_proven(state: &Self::State) -> bool;
}
