//! The table that a drive works with: tasks write it, the control interrupt reads it, and nobody waits.

use super::{Layout, POINTS, Table};
use crate::angle::Position;
use core::sync::atomic::{AtomicI16, AtomicI32, AtomicU32, Ordering};

/// A table in full effect.
pub const WHOLE: i32 = 256;

/// A table shared by the interrupt and the tasks, 1 KiB; as a static.
#[derive(Debug)]
pub struct Live {
    /// Share of the table that is in effect, in 2⁻⁸; 0: off.
    share: AtomicI32,
    /// How often the count of turns began anew; only the interrupt writes it.
    counts: AtomicU32,
    /// The count that the pole was found in.
    found_in: AtomicU32,
    /// Electrical turns from the begin of the table at position zero.
    first: AtomicI32,
    pole_pairs: AtomicU32,
    bits: AtomicU32,
    points: [AtomicI16; POINTS],
}

impl Default for Live {
    fn default() -> Self {
        Self::new()
    }
}

impl Live {
    /// Off; all zeros.
    pub const fn new() -> Self {
        Self {
            share: AtomicI32::new(0),
            counts: AtomicU32::new(0),
            found_in: AtomicU32::new(0),
            first: AtomicI32::new(0),
            pole_pairs: AtomicU32::new(0),
            bits: AtomicU32::new(0),
            points: [const { AtomicI16::new(0) }; POINTS],
        }
    }

    /// Takes over a table, without effect for now. The interrupt must have run since [`Self::end`], if it was in effect.
    pub fn load(&self, table: &Table) {
        self.end();
        for (place, point) in self.points.iter().zip(table.points) {
            place.store(point, Ordering::Relaxed);
        }
        self.pole_pairs.store(table.layout.pole_pairs as u32, Ordering::Relaxed);
        self.bits.store(table.layout.bits, Ordering::Relaxed);
    }

    /// How often the drive has begun to count its turns anew. A pole is known in one count only.
    pub fn count(&self) -> u32 {
        self.counts.load(Ordering::Acquire)
    }

    /// Puts a share of the table into effect, in 1/[`WHOLE`], for a rotor that was so many electrical turns from the
    /// table's begin at position zero of a [count](Self::count); nothing of it once the drive counts anew. To be raised
    /// over a tenth of a second, for the tracked angle moves by it.
    pub fn use_from(&self, electrical_turns: i32, count: u32, share: i32) {
        self.first.store(electrical_turns, Ordering::Relaxed);
        self.found_in.store(count, Ordering::Relaxed);
        self.share.store(share.clamp(0, WHOLE), Ordering::Release);
    }

    /// Ends its effect.
    pub fn end(&self) {
        self.share.store(0, Ordering::Release);
    }

    /// The drive counts its turns anew, and does not know the pole any more. For the control interrupt alone.
    pub(crate) fn count_anew(&self) {
        // There is one writer, so this needs no exchange, which a Cortex-M0 does not have.
        self.counts.store(self.counts.load(Ordering::Relaxed).wrapping_add(1), Ordering::Release);
    }

    /// Whether it is in effect.
    pub fn is_used(&self) -> bool {
        self.share.load(Ordering::Acquire) != 0 && self.is_found()
    }

    fn is_found(&self) -> bool {
        self.found_in.load(Ordering::Relaxed) == self.counts.load(Ordering::Relaxed)
    }

    /// The value at a position, as much of it as is in effect, in 2^−[`FRACTION`](super::FRACTION) of a point's.
    #[inline(always)]
    pub(crate) fn value(&self, position: Position) -> i32 {
        let share = self.share.load(Ordering::Acquire);
        if share == 0 || !self.is_found() {
            return 0;
        }
        let layout = Layout {
            pole_pairs: self.pole_pairs.load(Ordering::Relaxed) as i32,
            bits: self.bits.load(Ordering::Relaxed),
            first: self.first.load(Ordering::Relaxed),
        };
        let (index, next, between) = layout.place(position);
        // Both are within; compiled for size, an index is a panic all the same.
        let at = |point: usize| self.points.get(point).map_or(0, |point| i32::from(point.load(Ordering::Relaxed)));
        let [start, end] = [index, next].map(at);
        // In 2⁻⁶ of a point's, times the share in 2⁻⁸.
        ((start << 6) + (((end - start) * (between >> 2)) >> 8)) * share
    }
}
