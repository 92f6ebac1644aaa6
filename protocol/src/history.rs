//! What went wrong, and when. The order of the variants is their number on the wire.

use crate::status::{Mode, Problem, Record};
use serde::{Deserialize, Serialize};

/// What went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Cause {
    /// The drive switched off, with this code.
    Fault(u8),
    /// A record of the flash could not be used.
    Stored(Record, Problem),
    /// A record could not be saved.
    NotSaved(Record),
    /// The sensors are not learnt any more. Which sensor, 0 to 2, or 3 for all; and 0 at the rail, 1 lost, 2 its offset,
    /// 3 its amplitude, 4 its placement drifted too far, 5 the third harmonic did, 6 a contradiction.
    Sensor {
        /// The sensor.
        channel: u8,
        /// Why.
        why: u8,
    },
}

/// What went wrong, and when.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Incident {
    /// Since power-up.
    pub at_ms: u64,
    /// State before.
    pub mode: Mode,
    /// What.
    pub cause: Cause,
}

/// An entry of the history.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Incidents since power-up, also those that have been pushed out.
    pub total: u32,
    /// The entry, if there is one of this number.
    pub entry: Option<Incident>,
}
