//! Tables over the whole mechanical turn, for what differs from pole to pole: the error of the angle by uneven
//! [magnets](crate::hall::map), the current against the [cogging](crate::control::cogging::by_pole).
//!
//! A drive that counts electrical turns from its power-up does not know at which of its poles the rotor stands. A table
//! is of use once that is known, in the same count of turns.

mod effect;
mod live;

use crate::angle::{PolePairs, Position};
pub use effect::{Effect, Use};
pub use live::{Live, WHOLE};

/// Points of a table.
pub const POINTS: usize = 512;
/// log₂ of the most points in an electrical turn. What magnets do to the angle ends at its eighth harmonic; higher ones
/// could not be told from a slow motion of the rotor, of which there are some sixteen samples in an electrical turn.
const MOST_BITS: u32 = 5;
/// Bits that [`Table::value`] has beyond a point's.
pub const FRACTION: u32 = 14;

/// How the points lie over the mechanical turn: a power of two of them in each electrical turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Layout {
    pub pole_pairs: i32,
    /// log₂ of the points in an electrical turn.
    pub bits: u32,
    /// Electrical turns of the rotor from the begin of the table at position zero.
    pub first: i32,
}

impl Layout {
    pub const fn new(pole_pairs: PolePairs) -> Self {
        let pairs = pole_pairs.get() as u32;
        let bits = (POINTS as u32 / pairs).ilog2();
        Self { pole_pairs: pairs as i32, bits: if bits > MOST_BITS { MOST_BITS } else { bits }, first: 0 }
    }

    /// Points in use.
    pub const fn points(&self) -> usize {
        (self.pole_pairs as usize) << self.bits
    }

    /// The point before a position, the one after it, and the share of the way between them in 2⁻¹⁶.
    #[inline(always)]
    pub const fn place(&self, position: Position) -> (usize, usize, i32) {
        let bits = position.to_bits();
        // The remainder is not negative, and there is a pole: so no panic.
        let pairs = if self.pole_pairs > 0 { self.pole_pairs } else { 1 };
        let turn = ((bits >> 32) as i32).wrapping_add(self.first).wrapping_rem(pairs);
        let turn = if turn < 0 { turn + pairs } else { turn };
        let angle = bits as u32;
        let index = ((turn as usize) << (self.bits & 31)) + angle.wrapping_shr(32 - self.bits) as usize;
        let next = if index + 1 < self.points() { index + 1 } else { 0 };
        (index & (POINTS - 1), next & (POINTS - 1), (angle.wrapping_shl(self.bits) >> 16) as i32)
    }
}

/// Values over the mechanical turn, and between its points on straight lines: about 1 KiB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Table {
    pub(crate) layout: Layout,
    pub(crate) points: [i16; POINTS],
}

impl Table {
    /// Memory for a table: nothing but zeros.
    pub const ZERO: Self = Self { layout: Layout::new(PolePairs::ONE), points: [0; POINTS] };

    /// A table of points as [`Self::points`] has them. `None` where their number does not fit the pole pairs.
    pub fn of_points(pole_pairs: PolePairs, points: impl ExactSizeIterator<Item = i16>) -> Option<Self> {
        let layout = Layout::new(pole_pairs);
        if points.len() != layout.points() {
            return None;
        }
        let mut table = Self { layout, ..Self::ZERO };
        table.points.iter_mut().zip(points).for_each(|(place, point)| *place = point);
        Some(table)
    }

    /// The values at evenly spaced mechanical angles from the table's begin.
    pub fn points(&self) -> &[i16] {
        self.points.get(..self.layout.points()).unwrap_or(&self.points)
    }

    /// Points in a mechanical turn for so many pole pairs.
    pub const fn points_for(pole_pairs: PolePairs) -> usize {
        Layout::new(pole_pairs).points()
    }

    /// The same where the angle counts the other way, and with it the value.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let mut table = *self;
        let count = self.layout.points();
        for (index, point) in self.points().iter().enumerate() {
            table.points[(count - index) % count] = point.saturating_neg();
        }
        table
    }

    /// Mean square of its points' difference from those so many electrical turns on.
    pub fn difference(&self, electrical_turns: i32) -> f32 {
        let points = self.points();
        let by = (electrical_turns.rem_euclid(self.layout.pole_pairs) as usize) << self.layout.bits;
        let (begin, end) = points.split_at(by.min(points.len()));
        let others = end.iter().chain(begin);
        let apart = |(one, other): (&i16, &i16)| (i32::from(*one) - i32::from(*other)) as f32;
        points.iter().zip(others).map(apart).map(|x| x * x).sum::<f32>() / points.len() as f32
    }

    /// Mean square of its points.
    pub fn square(&self) -> f32 {
        let points = self.points();
        points.iter().map(|&point| f32::from(point) * f32::from(point)).sum::<f32>() / points.len() as f32
    }

    /// The value at a position, in 2^−[`FRACTION`] of a point's.
    #[inline(always)]
    pub const fn value(&self, position: Position) -> i32 {
        let (index, next, share) = self.layout.place(position);
        let (start, end) = (self.points[index] as i32, self.points[next] as i32);
        (start << FRACTION) + ((end - start) * (share >> 2))
    }

    /// The same where the rotor is so many electrical turns further than its position says.
    #[inline(always)]
    pub const fn value_from(&self, electrical_turns: i32, position: Position) -> i32 {
        self.value(Position::from_bits(position.to_bits().wrapping_add((electrical_turns as i64) << 32)))
    }

    /// Electrical turns in a mechanical one.
    pub const fn pole_pairs(&self) -> u8 {
        self.layout.pole_pairs as u8
    }
}
