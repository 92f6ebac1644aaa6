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
mod signature;

use crate::angle::{ElectricalAngle, PolePairs, Position, TURN};
use crate::hall::model::Model;
use crate::turn::{FRACTION, Layout, POINTS, Table};
pub use find::{FIT, Finder, Seen, Verdict};
pub use learn::Learner;
pub use signature::{Collector, LONGEST as LONGEST_SIGNATURE, Signature};

/// The error of the angle over the mechanical turn: about 1 KiB. A point is 2⁻¹⁸ turns, 0.0014° electrical, and at most
/// 45°.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Map(Table);

impl Map {
    /// A map of points as [`Self::points`] has them. `None` where their number does not fit the pole pairs.
    pub fn of_points(pole_pairs: PolePairs, points: impl ExactSizeIterator<Item = i16>) -> Option<Self> {
        Table::of_points(pole_pairs, points).map(Self)
    }

    /// A map as it was learnt, without a mean, of a rotor whose magnets have a signature: with what the alignment of the
    /// calibration is off by, as magnets that differ in strength and in place do not count alike there. What it does is
    /// small, a tenth of a degree at cheap magnets.
    #[must_use]
    pub fn aligned(&self, signature: &Signature, model: &Model) -> Self {
        let by = signature.misalignment(model, self) * TURN / (1 << FRACTION) as f32;
        let mut table = self.0;
        for point in &mut table.points[..self.0.layout.points()] {
            *point = point.saturating_sub(crate::float::nearest(by) as i16);
        }
        Self(table)
    }

    /// As a table, for [`Live`](crate::turn::Live).
    pub const fn table(&self) -> &Table {
        &self.0
    }

    /// The error at evenly spaced mechanical angles from the map's begin, in 2⁻¹⁸ electrical turns.
    pub fn points(&self) -> &[i16] {
        self.0.points()
    }

    /// Points in a mechanical turn for so many pole pairs.
    pub const fn points_for(pole_pairs: PolePairs) -> usize {
        Table::points_for(pole_pairs)
    }

    /// The same map where the angle counts the other way.
    #[must_use]
    pub fn reversed(&self) -> Self {
        Self(self.0.reversed())
    }

    /// How far the map differs from itself so many electrical turns on, degrees RMS.
    pub fn difference_deg(&self, electrical_turns: i32) -> f32 {
        degrees(crate::float::root(self.0.difference(electrical_turns)))
    }

    /// Whether a [`Finder`] can tell the poles of this rotor, or need not.
    pub fn is_told(&self) -> bool {
        let doubtful = 0.8 * find::ALIKE_DEG..1.3 * find::ALIKE_DEG;
        self.rms_deg() > doubtful.end
            && (1..self.0.layout.pole_pairs).all(|k| !doubtful.contains(&self.difference_deg(k)))
    }

    /// How far the Halls' angle is ahead of the rotor at a position.
    #[inline(always)]
    pub const fn error(&self, position: Position) -> ElectricalAngle {
        ElectricalAngle::from_bits(self.0.value(position))
    }

    /// The same where the rotor is so many electrical turns further than its position says.
    #[inline(always)]
    pub const fn error_from(&self, electrical_turns: i32, position: Position) -> ElectricalAngle {
        ElectricalAngle::from_bits(self.0.value_from(electrical_turns, position))
    }

    /// Electrical turns in a mechanical one.
    pub const fn pole_pairs(&self) -> u8 {
        self.0.pole_pairs()
    }

    /// Mean error of each electrical turn, degrees: how far each pair of magnets is out of its place.
    pub fn pitch_deg(&self) -> impl Iterator<Item = f32> + '_ {
        let points = 1 << self.0.layout.bits;
        self.points()
            .chunks(points)
            .map(move |pole| degrees(pole.iter().map(|&point| f32::from(point)).sum()) / points as f32)
    }

    /// What the error is without the map, degrees RMS.
    pub fn rms_deg(&self) -> f32 {
        degrees(crate::float::root(self.0.square()))
    }
}

/// Degrees of what points hold.
fn degrees(points: f32) -> f32 {
    points * (360.0 / (1 << (32 - FRACTION)) as f32)
}

#[cfg(test)]
mod tests;
