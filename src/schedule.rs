//! Rates of the work that a drive with current control does not do in every step.

use crate::angle::Position;

/// Steps of the whole schedule.
pub const CYCLE: u32 = 32;

/// Steps from one to the next of what is done in every other schedule only.
pub(crate) const LONG: u32 = 2 * CYCLE;

/// Steps from one chance of a record to the next.
pub(crate) const RECORDS: u32 = CYCLE;

/// Steps from one computation of the outer loops to the next: 5 kHz at 40 kHz. At a bandwidth of 60 Hz that costs 3° of
/// phase.
pub const OUTER: u32 = 8;

/// A position in the unit of the outer loops: what a speed moves on by in a step of theirs is its number.
pub(crate) const fn coarse(position: Position) -> Position {
    Position::from_bits(position.to_bits() >> OUTER.ilog2())
}
