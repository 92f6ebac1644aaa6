//! A short recording at up to the control rate: four channels, taken in the control interrupt after the drive's step,
//! around a trigger.
//!
//! The memory of a recording travels by reference: a task hands it over with a [`Plan`] in it ([`Scope::begin`]), the
//! interrupt fills it ([`Recorder::take`]) and hands it back when it is complete. Without a recording the interrupt
//! looks whether one has come, and nothing else.

mod channel;
mod recorder;
mod recording;
mod setup;
mod tasks;

pub use channel::Channel;
pub use recorder::Recorder;
pub use recording::Recording;
pub use setup::{Error, Plan, Setup, Trigger};
pub use tasks::{Busy, Channels, Scope, State};

/// Channels of a recording.
pub const CHANNELS: usize = 4;
/// Rows that its memory holds: as many as a board with little memory has room for.
pub const ROWS: usize = if cfg!(feature = "small") { 128 } else { 512 };

/// Whether the memory is that of the calibration's sums, which a recording borrows from the
/// [`Service`](crate::service::Service).
pub const BORROWS: bool = cfg!(feature = "small");

/// The channels at one instant, as raw numbers; [`Channel::scale`] has their units.
pub type Row = [i32; CHANNELS];

#[cfg(test)]
mod tests;
