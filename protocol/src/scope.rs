//! A short recording at up to the control rate.

use hallservo::scope::{self, CHANNELS, Setup, State};
use serde::{Deserialize, Serialize};

/// Rows in one answer, which it has room for whatever they are.
pub const ROWS_AT_ONCE: usize = 11;

/// What can be asked of the scope. A recording belongs to the tool that has begun it, until that ends it or asks
/// nothing of the scope for two seconds; any tool may look.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ScopeAsk {
    /// How it is: [`Answer::Scope`](crate::Answer::Scope).
    Status,
    /// Begin a recording; the one before is lost.
    Begin {
        /// A number that the tool draws at random: it reads no other recording instead.
        id: u32,
        /// What is to be recorded.
        setup: Setup,
    },
    /// Rows of a complete recording: [`Answer::ScopeRows`](crate::Answer::ScopeRows).
    Rows {
        /// Of the recording.
        id: u32,
        /// Number of the first, from zero, the oldest.
        first: u16,
    },
    /// Gives up the recording, be it complete or not.
    End,
}

/// How the scope is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScopeStatus {
    /// Of the recording.
    pub id: u32,
    /// The tool that has begun it; 0 where there is none.
    pub client: u32,
    /// Whether it waits, is triggered or complete.
    pub state: State,
    /// Rows that the memory has room for.
    pub capacity: u16,
    /// What is recorded, where there is a recording.
    pub setup: Option<Setup>,
    /// Value of one unit of each channel's raw numbers.
    pub scales: [f32; CHANNELS],
}

/// Rows of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScopeRows {
    /// Of the recording.
    pub id: u32,
    /// Number of the first.
    pub first: u16,
    /// Raw numbers; positions count from the user's zero. Zeros beyond the end.
    pub rows: [[i32; CHANNELS]; ROWS_AT_ONCE],
}

/// Why the scope does not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ScopeRefusal {
    /// This drive has none.
    None,
    /// That cannot be recorded.
    Setup(scope::Error),
    /// It is another tool's.
    Busy,
    /// There is no such recording, not any more, or it is not complete.
    Gone,
}
