//! What the Halls' angle is wrong by over the whole mechanical turn.
//!
//! Real magnets differ: in strength, in place, in the shape of their field. All that they do to the angle repeats with
//! the mechanical turn, so one table over it corrects everything at once, whatever the cause. It is
//! learnt from a rotor that turns freely, whose inertia is the reference, and applied every eighth step.
//!
//! The Halls alone could not tell all of it. Sensors at Δᵢ (mechanical) from the first see a field f(θ − Δᵢ); a change
//! of the angle θ + ε(θ) is one of the field, f(x + γ(x)), where γ(θ − Δᵢ) is the same for all three but for a
//! constant. For the n-th order of the turn that is so only where n·Δᵢ are whole turns. Beside each other, at
//! Δ = 120° electrical, they see each magnet one after the other, and only orders that are multiples of three times
//! the pole pairs escape them; the pitch of the poles does not, but its order n shows by 2·sin(n·Δ/2) only. A freely
//! turning rotor shows all orders alike.

mod find;
mod learn;
mod live;

use crate::angle::{ElectricalAngle, PolePairs, Position};
pub use find::{FIT, Finder, Seen, Verdict};
pub use learn::Learner;
pub use live::{Live, WHOLE};

/// Points of a table.
pub const POINTS: usize = 512;
/// log₂ of the most points in an electrical turn. What magnets do to the angle ends at its eighth harmonic; higher ones
/// could not be told from a slow motion of the rotor, of which there are some sixteen samples in an electrical turn.
const MOST_BITS: u32 = 5;
/// Bits by which a point is coarser than an angle: 2⁻¹⁸ turns, 0.0014° electrical, and at most 45°.
const COARSER: u32 = 14;

/// How the points lie over the mechanical turn: a power of two of them in each electrical turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Layout {
    pole_pairs: i32,
    /// log₂ of the points in an electrical turn.
    bits: u32,
    /// Electrical turns of the rotor from the begin of the table at position zero.
    first: i32,
}

impl Layout {
    const fn new(pole_pairs: PolePairs) -> Self {
        let pairs = pole_pairs.get() as u32;
        let bits = (POINTS as u32 / pairs).ilog2();
        Self { pole_pairs: pairs as i32, bits: if bits > MOST_BITS { MOST_BITS } else { bits }, first: 0 }
    }

    /// Points in use.
    const fn points(&self) -> usize {
        (self.pole_pairs as usize) << self.bits
    }

    /// The point before a position, the one after it, and the share of the way between them in 2⁻¹⁶.
    #[inline(always)]
    const fn place(&self, position: Position) -> (usize, usize, i32) {
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

/// The error of the angle over the mechanical turn: about 1 KiB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Map {
    layout: Layout,
    points: [i16; POINTS],
}

impl Map {
    /// Memory for a map: no error.
    pub const ZERO: Self = Self { layout: Layout::new(PolePairs::ONE), points: [0; POINTS] };

    /// A map of points as [`Self::points`] has them. `None` where their number does not fit the pole pairs.
    pub fn of_points(pole_pairs: PolePairs, points: impl ExactSizeIterator<Item = i16>) -> Option<Self> {
        let layout = Layout::new(pole_pairs);
        if points.len() != layout.points() {
            return None;
        }
        let mut map = Self { layout, ..Self::ZERO };
        map.points.iter_mut().zip(points).for_each(|(place, point)| *place = point);
        Some(map)
    }

    /// The error at evenly spaced mechanical angles from the map's begin, in 2⁻¹⁸ electrical turns.
    pub fn points(&self) -> &[i16] {
        self.points.get(..self.layout.points()).unwrap_or(&self.points)
    }

    /// Points in a mechanical turn for so many pole pairs.
    pub const fn points_for(pole_pairs: PolePairs) -> usize {
        Layout::new(pole_pairs).points()
    }

    /// The same map where the angle counts the other way.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let mut map = *self;
        let count = self.layout.points();
        for (index, point) in self.points().iter().enumerate() {
            map.points[(count - index) % count] = point.saturating_neg();
        }
        map
    }

    /// How far the map differs from itself so many electrical turns on, degrees RMS.
    pub fn difference_deg(&self, electrical_turns: i32) -> f32 {
        let points = self.points();
        let by = (electrical_turns.rem_euclid(self.layout.pole_pairs) as usize) << self.layout.bits;
        let (begin, end) = points.split_at(by.min(points.len()));
        let others = end.iter().chain(begin);
        let square = |(one, other): (&i16, &i16)| degrees(i32::from(*one) - i32::from(*other));
        crate::float::root(points.iter().zip(others).map(square).map(|x| x * x).sum::<f32>() / points.len() as f32)
    }

    /// Whether a [`Finder`] can tell the poles of this rotor, or need not.
    pub fn is_told(&self) -> bool {
        let doubtful = 0.8 * find::ALIKE_DEG..1.3 * find::ALIKE_DEG;
        self.rms_deg() > doubtful.end
            && (1..self.layout.pole_pairs).all(|k| !doubtful.contains(&self.difference_deg(k)))
    }

    /// How far the Halls' angle is ahead of the rotor at a position.
    #[inline(always)]
    pub const fn error(&self, position: Position) -> ElectricalAngle {
        let (index, next, share) = self.layout.place(position);
        let (start, end) = (self.points[index] as i32, self.points[next] as i32);
        ElectricalAngle::from_bits((start << COARSER) + ((end - start) * (share >> 2)))
    }

    /// The same where the rotor is so many electrical turns further than its position says.
    #[inline(always)]
    pub const fn error_from(&self, electrical_turns: i32, position: Position) -> ElectricalAngle {
        self.error(Position::from_bits(position.to_bits().wrapping_add((electrical_turns as i64) << 32)))
    }

    /// Electrical turns in a mechanical one.
    pub const fn pole_pairs(&self) -> u8 {
        self.layout.pole_pairs as u8
    }

    /// Mean error of each electrical turn, degrees: how far each pair of magnets is out of its place.
    pub fn pitch_deg(&self) -> impl Iterator<Item = f32> + '_ {
        let points = 1 << self.layout.bits;
        self.points()
            .chunks(points)
            .map(move |pole| degrees(pole.iter().map(|&point| i32::from(point)).sum()) / points as f32)
    }

    /// What the error is without the map, degrees RMS.
    pub fn rms_deg(&self) -> f32 {
        let points = self.points();
        let squares = points.iter().map(|&point| degrees(point.into()) * degrees(point.into())).sum::<f32>();
        crate::float::root(squares / points.len() as f32)
    }
}

/// Degrees of what points hold.
fn degrees(points: i32) -> f32 {
    points as f32 * (360.0 / (1 << (32 - COARSER)) as f32)
}

#[cfg(test)]
mod tests;
