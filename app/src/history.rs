//! What went wrong since power-up.

#[cfg(feature = "defmt")]
use crate::fmt::log;
use hallservo::mode::Mode;
use hallservo_protocol::{Cause, Incident};

/// Entries that are kept; older ones are pushed out.
pub const ENTRIES: usize = 16;

/// The latest incidents, the last one first.
pub(crate) struct History {
    entries: [Option<Incident>; ENTRIES],
    total: u32,
}

impl History {
    pub const fn new() -> Self {
        Self { entries: [None; ENTRIES], total: 0 }
    }

    pub fn push(&mut self, at_ms: u64, mode: Mode, cause: Cause) {
        #[cfg(feature = "defmt")]
        log_incident(cause);
        let mut next = Some(Incident { at_ms, mode, cause });
        for entry in &mut self.entries {
            core::mem::swap(entry, &mut next);
        }
        self.total = self.total.saturating_add(1);
    }

    /// The entry with a number, 0 the latest.
    pub fn entry(&self, number: u8) -> Option<Incident> {
        self.entries.get(usize::from(number)).copied().flatten()
    }

    pub const fn total(&self) -> u32 {
        self.total
    }

    pub fn len(&self) -> u8 {
        self.total.min(ENTRIES as u32) as u8
    }
}

/// Into the log.
#[cfg(feature = "defmt")]
fn log_incident(cause: Cause) {
    match cause {
        Cause::Fault(fault) => log!(error, "fault {}: {}", fault.code(), fault),
        Cause::Stored(record, _) => log!(warn, "stored record {} cannot be used", record as u8),
        Cause::NotSaved(record) => log!(error, "record {} could not be saved", record as u8),
        Cause::Adaptation(fault) => log!(warn, "the adaptation gave up: {}", fault),
        Cause::Abandoned(_) => log!(warn, "ended: the tool that began it fell silent"),
        Cause::Heavier => log!(warn, "the rotor is heavier than inertia_kgm2: the position is controlled more slowly"),
        Cause::Lighter => {
            log!(warn, "the speed control swung the rotor, lighter than inertia_kgm2: its gains are smaller")
        }
    }
}
