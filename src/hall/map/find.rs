//! Which pole the rotor is at after power-up, by the map's own signature; and whether the map is this rotor's at all.
//!
//! The rotor turns as it likes. For each pole that it may have begun at, the map is taken off the Halls' angle, and a
//! slow reference follows what is left: with the right one least is left over. The reference is told the torque, as a
//! speed control moves the rotor by what the Halls are wrong by. One candidate more is no map at all: what a map leaves
//! of another rotor is more than what that shows without.
//!
//! Once a mechanical turn there is a [`Verdict`]. It is sure of a pole only where every other one, and no map, leave
//! [`MARGIN`] times its power, poles at which the map is the same left aside. A wrong pole can win like that only while
//! the rotor really moves as the map differs from itself there, so whoever uses a verdict waits for several alike, and
//! goes on asking.

use super::Map;
use super::learn::{Reference, turns};
use crate::angle::Position;

/// Least ratio of the power that others leave over.
pub const MARGIN: f32 = 3.0;
/// Two poles are alike where the map differs by less, degrees RMS: to take one for the other costs less than noise.
pub(super) const ALIKE_DEG: f32 = 0.15;
/// A map that is in use speaks against itself where it leaves more than this share of what no map does.
const MISFIT: f32 = 0.75;
/// Bandwidth of the references, in radians of it in a radian of the mechanical turn: they settle within a turn or two.
const BANDWIDTH: f32 = 0.6;
/// Mechanical turns until the first verdict, in which the references settle.
const SETTLING_TURNS: f32 = 2.0;
/// Longest that no sample may come, in steps: after more it begins anew.
const LONGEST_GAP: u32 = 4096;

/// What a mechanical turn has shown.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Verdict {
    /// The pole that leaves least: for [`Map::error_from`].
    pub electrical_turns: i32,
    /// What the next best, or no map, leaves over, in powers of what this one does.
    pub margin: f32,
    /// What it leaves over, degrees RMS.
    pub left_deg: f32,
    /// Whether the pole that was asked for leaves hardly less than no map does, or much more than another pole.
    pub misfit: bool,
}

impl Verdict {
    /// Whether the pole may be used.
    pub fn is_sure(&self) -> bool {
        self.margin > MARGIN
    }
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    reference: Reference,
    /// Square of what is left over, mean of about the last mechanical turn.
    square: f32,
}

impl Candidate {
    fn at(position: Position, seen: &Seen) -> Self {
        Self { reference: Reference::at(position, seen.speed, seen.sequence), square: 0.0 }
    }

    /// Takes a sample, less what `error` tells of a position.
    fn take(&mut self, seen: &Seen, error: impl Fn(Position) -> i64, bandwidth: f32, share: f32) -> bool {
        let steps = self.reference.advance(seen.sequence, seen.driven);
        if !(steps > 0.0) {
            return false;
        }
        let error = error(self.reference.position());
        let behind = self.reference.behind(Position::from_bits(seen.measured.to_bits().wrapping_sub(error)));
        self.reference.correct(behind, steps, bandwidth);
        self.square += share * (behind * behind - self.square);
        true
    }
}

/// A position as the Halls show it, without a map.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// The position.
    pub measured: Position,
    /// Speed in 2⁻³² electrical turns a step.
    pub speed: i32,
    /// The step.
    pub sequence: u32,
    /// Acceleration by the motor's torque since the last sample, electrical turns a step².
    pub driven: f32,
}

/// Finds the pole for rotors of up to `POLES` pole pairs.
#[derive(Clone, Debug)]
pub struct Finder<const POLES: usize> {
    candidates: [Option<Candidate>; POLES],
    /// Without a map.
    bare: Option<Candidate>,
    last: Seen,
    /// Mechanical turns since the last verdict; less than none until the references have settled.
    turned: f32,
}

impl<const POLES: usize> Default for Finder<POLES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const POLES: usize> Finder<POLES> {
    /// At the begin.
    pub const fn new() -> Self {
        let last = Seen { measured: Position::from_bits(0), speed: 0, sequence: 0, driven: 0.0 };
        Self { candidates: [None; POLES], bare: None, last, turned: 1.0 - SETTLING_TURNS }
    }

    /// Takes a sample; `used` is the pole in use, if there is one. At rest nothing is learnt.
    pub fn push(&mut self, map: &Map, used: Option<i32>, seen: &Seen) -> Option<Verdict> {
        let steps = seen.sequence.wrapping_sub(self.last.sequence);
        if self.bare.is_none() || steps > LONGEST_GAP {
            self.begin(map, seen);
            return None;
        }
        let pole_pairs = f32::from(map.pole_pairs());
        let share = (turns(seen.measured, self.last.measured).abs() / pole_pairs).min(1.0);
        let bandwidth = BANDWIDTH / pole_pairs;
        self.last = *seen;
        if !self.bare.as_mut()?.take(seen, |_| 0, bandwidth, share) {
            return None;
        }
        for (pole, candidate) in self.candidates.iter_mut().enumerate() {
            if let Some(candidate) = candidate {
                candidate.take(
                    seen,
                    |position| map.error_from(pole as i32, position).to_bits().into(),
                    bandwidth,
                    share,
                );
            }
        }
        self.turned += share;
        if self.turned < 1.0 {
            return None;
        }
        self.turned -= 1.0;
        self.decide(map, used)
    }

    fn begin(&mut self, map: &Map, seen: &Seen) {
        *self = Self::new();
        self.last = *seen;
        self.bare = Some(Candidate::at(seen.measured, seen));
        for (pole, candidate) in self.candidates.iter_mut().enumerate().take(map.pole_pairs().into()) {
            let error = map.error_from(pole as i32, seen.measured).to_bits();
            let position = Position::from_bits(seen.measured.to_bits().wrapping_sub(error.into()));
            *candidate = Some(Candidate::at(position, seen));
        }
    }

    #[inline(never)]
    fn decide(&self, map: &Map, used: Option<i32>) -> Option<Verdict> {
        let squares = || self.candidates.iter().flatten().map(|candidate| candidate.square).enumerate();
        let (best, least) = squares().min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let bare = self.bare.as_ref()?.square;
        let differs = |pole: usize| map.difference_deg(pole as i32 - best as i32) > ALIKE_DEG;
        let next = squares().filter(|&(pole, _)| differs(pole)).map(|(_, square)| square).fold(bare, f32::min);
        let margin = next / least;
        let misfit = used.and_then(|used| Some((used, self.candidates.get(used as usize)?.as_ref()?.square)));
        let misfit =
            misfit.is_some_and(|(used, square)| square > MISFIT * bare || (margin > MARGIN && differs(used as usize)));
        Some(Verdict { electrical_turns: best as i32, margin, left_deg: 360.0 * libm::sqrtf(least), misfit })
    }
}
