//! What went wrong, and when. The order of the variants is their number on the wire.

use crate::status::{Activity, Problem, Record};
use hallservo::fault::Fault;
use hallservo::hall::adapt;
use hallservo::mode::Mode;
use serde::{Deserialize, Serialize};

/// What went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Cause {
    /// The drive switched off.
    Fault(Fault),
    /// A record of the flash could not be used.
    Stored(Record, Problem),
    /// A record could not be saved.
    NotSaved(Record),
    /// The adaptation of the sensors' model gave up.
    Adaptation(adapt::Fault),
    /// Ended, for the tool that began it fell silent.
    Abandoned(Activity),
    /// The rotor was found to be much heavier than its inertia in the settings, by a swing about its position: until the
    /// drive is armed again, the position is controlled with less bandwidth.
    Heavier,
    /// The rotor was found to be much lighter than that, for the speed control swung it to and fro: until the drive is armed
    /// again, its gains are smaller.
    Lighter,
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
