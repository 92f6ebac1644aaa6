//! Rates of the work that a drive with current control does not do in every step.

/// Steps of the whole schedule.
pub const CYCLE: u32 = 32;

/// Steps from one to the next of what is done in every other schedule only.
pub(crate) const LONG: u32 = 2 * CYCLE;

/// Steps from one chance of a record to the next.
pub(crate) const RECORDS: u32 = CYCLE;

/// Steps from one computation of the outer loops to the next: 5 kHz at 40 kHz. At a bandwidth of 60 Hz that costs 3° of
/// phase.
pub const OUTER: u32 = 8;
