//! The memory of a recording, and how it is filled: a ring of rows, until enough have followed the trigger.

use super::setup::{Plan, Source};
use super::{CHANNELS, ROWS, Row};
use crate::board::{Output, Sample};
use crate::drive::Drive;

const _: () = assert!(ROWS.is_power_of_two(), "the ring has no division");

/// Of the memory: each half as large as the sums of a sweep of the calibration, where it is theirs.
type Rows = [[[u32; CHANNELS]; ROWS / 2]; 2];

/// A recording: 8 KiB, or 2 KiB with the feature `small`. Empty it is all zeros, so that the flash does not have to hold it.
#[repr(C)]
pub struct Recording {
    /// Where the next row goes.
    next: u16,
    /// Rows in the ring.
    taken: u16,
    /// Rows that are still to come once it is triggered.
    left: u16,
    /// Periods to the next row.
    until: u16,
    triggered: bool,
    /// What the trigger looked at last.
    last: i32,
    plan: Plan,
    rows: Rows,
}

impl Recording {
    /// Nothing.
    pub const fn new() -> Self {
        let plan = Plan::UNUSED;
        Self {
            rows: [[[0; CHANNELS]; ROWS / 2]; 2],
            plan,
            next: 0,
            taken: 0,
            left: 0,
            until: 0,
            triggered: false,
            last: 0,
        }
    }

    /// Begins anew. The old rows are overwritten one by one.
    pub(super) const fn restart(&mut self, plan: &Plan) {
        self.plan = *plan;
        (self.next, self.taken, self.left, self.until) = (0, 0, plan.rows - plan.before, 1);
        (self.triggered, self.last) = (false, 0);
    }

    /// Whether it is triggered.
    pub(super) const fn is_triggered(&self) -> bool {
        self.triggered
    }

    /// Whether all rows have come.
    pub const fn is_complete(&self) -> bool {
        self.triggered && self.left == 0
    }

    /// Takes the row of this period, where one is due. Each has the same work, but for the channels' own.
    pub(super) fn take(&mut self, drive: &Drive, sample: &Sample, output: &Output, commanded: bool) {
        self.until = self.until.wrapping_sub(1);
        if self.until != 0 {
            return;
        }
        self.until = self.plan.every;
        let [a, b, c, d] = self.plan.channels;
        let value = |channel| match channel {
            Some(channel) => drive.look_at(channel, sample, output),
            None => 0,
        };
        let row = [value(a), value(b), value(c), value(d)];
        let watched = match self.plan.source {
            Source::Nothing => 1,
            Source::Command => commanded.into(),
            Source::Fault => drive.is_faulted().into(),
            Source::Channel(channel) => value(Some(channel)),
        };
        self.push(row, watched);
    }

    /// Adds a row, and what the trigger looks at.
    pub(super) fn push(&mut self, row: Row, watched: i32) {
        if let Some(place) = self.rows.as_flattened_mut().get_mut(usize::from(self.next)) {
            *place = row.map(i32::cast_unsigned);
        }
        self.next = (self.next + 1) % ROWS as u16;
        let first = self.taken == 0;
        self.taken = if self.taken < ROWS as u16 { self.taken + 1 } else { self.taken };
        let fires = self.plan.source == Source::Nothing || !first && self.crosses(watched);
        self.last = watched;
        self.triggered |= fires && self.taken > self.plan.before;
        if self.triggered {
            self.left = self.left.saturating_sub(1);
        }
    }

    /// Whether the watched value has come to the level from the other side; an angle may wrap.
    const fn crosses(&self, now: i32) -> bool {
        let Plan { level, rising, .. } = self.plan;
        let (before, after, way) =
            (self.last.wrapping_sub(level), now.wrapping_sub(level), now.wrapping_sub(self.last));
        if rising { before < 0 && after >= 0 && way > 0 } else { before > 0 && after <= 0 && way < 0 }
    }

    /// A row of a complete recording, the oldest first.
    pub fn row(&self, number: u16) -> Option<Row> {
        self.raw(number).map(|row| row.map(u32::cast_signed))
    }

    /// The same where it lies, as bits.
    pub fn raw(&self, number: u16) -> Option<&[u32; CHANNELS]> {
        if !self.is_complete() || number >= self.plan.rows {
            return None;
        }
        let place = self.next.wrapping_sub(self.plan.rows).wrapping_add(number) % ROWS as u16;
        self.rows.as_flattened().get(usize::from(place))
    }
}

#[cfg(feature = "small")]
impl crate::hall::calibrate::Memory for &'static mut Recording {
    fn bins(&self) -> &crate::hall::calibrate::Bins {
        &self.rows
    }

    fn bins_mut(&mut self) -> &mut crate::hall::calibrate::Bins {
        &mut self.rows
    }
}

impl Default for Recording {
    fn default() -> Self {
        Self::new()
    }
}
