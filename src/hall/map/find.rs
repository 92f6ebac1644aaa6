//! Which pole the rotor is at after power-up, by the map's own signature; and whether the map is this rotor's at all.
//!
//! The rotor turns as it likes. For each pole that it may have begun at, the map is taken off the Halls' angle, and a
//! slow reference follows what is left: with the right one least is left over. The reference is told the torque, as a
//! speed control moves the rotor by what the Halls are wrong by. One candidate more is no map at all: what a map leaves
//! of another rotor is more than what that shows without.
//!
//! A pole j is judged against another, k, by what they leave over of the same samples, rⱼ and rₖ: with
//! ρ = (Σrₖ² − Σrⱼ²) / Σ(rₖ − rⱼ)². Noise and motion that have nothing to do with the map leave it at 1 if j is right,
//! and at −1 if k is. The denominator is what the map says that the two differ by, seen through the reference.
//! A pole is sure where ρ is at least [`FIT`] against every other one and against no map, by [`SIGMAS`] of what the
//! noise moves it by, over two mechanical turns or more, and where what is left over is noise: a rotor that really moves
//! as the map differs from itself could show a wrong pole, and that motion is seen as such wherever it is not exactly
//! that. Poles where the map is the same are not told apart, as either is right.

use super::Map;
use super::learn::{Reference, turns};
use crate::angle::Position;

/// Least ρ of a pole that is sure.
pub const FIT: f32 = 0.5;
/// By how many standard deviations.
pub(super) const SIGMAS: f32 = 5.0;
/// A map in use speaks against itself where ρ is below none by so many.
const SIGMAS_AGAINST: f32 = 3.0;
/// Two poles are alike where the map differs by less, degrees RMS: to take one for the other costs less than noise.
pub(super) const ALIKE_DEG: f32 = 0.15;
/// Power left over beyond the noise that a sure pole may have, as a share of what the map differs by.
const MOTION: f32 = 0.25;
/// … and that what speaks against a map in use may leave, which shows the unevenness of another rotor: where more is left, as
/// when a chirp or a step shakes the rotor faster than its torque is measured, nothing is told of the map.
const SHAKEN: f32 = 2.0;
/// Power of the noise, in that of the noise at the learning, that is still noise.
const NOISE: f32 = 1.5;
/// Bandwidth of the references, in radians of it in a radian of the mechanical turn: they settle within a turn or two.
const BANDWIDTH: f32 = 0.6;
/// Mechanical turns until the first sums begin, in which the references settle.
const SETTLING_TURNS: f32 = 2.0;
/// Turns in a sum, least for a pole to be sure, and most.
const LEAST_TURNS: u32 = 2;
const MOST_TURNS: u32 = 64;
/// Least samples in a sum.
const LEAST_SAMPLES: f32 = 32.0;
/// Longest that no sample may come, in steps: after more it begins anew.
const LONGEST_GAP: u32 = 4096;

/// What the sums have shown at the end of a mechanical turn.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Verdict {
    /// The pole that is in use, or leaves least: for [`Map::error_from`].
    pub electrical_turns: i32,
    /// Least ρ of it, −1 to 1, but for noise.
    pub fit: f32,
    /// What it leaves over of single samples, degrees RMS.
    pub left_deg: f32,
    /// Whether it may be used.
    pub sure: bool,
    /// Whether it is to be used no longer.
    pub misfit: bool,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    reference: Reference,
    /// Sums of squares: of what is left over, and of its difference from the favourite's, electrical turns².
    left: f32,
    apart: f32,
}

impl Candidate {
    fn at(position: Position, seen: &Seen) -> Self {
        Self { reference: Reference::at(position, seen.speed, seen.sequence), left: 0.0, apart: 0.0 }
    }

    /// Takes a sample, less what `error` tells of a position; what is left over.
    fn take(&mut self, seen: &Seen, error: impl Fn(Position) -> i64, bandwidth: f32) -> f32 {
        let steps = self.reference.advance(seen.sequence, seen.driven);
        let error = error(self.reference.position());
        let left = self.reference.behind(Position::from_bits(seen.measured.to_bits().wrapping_sub(error)));
        self.reference.correct(left, steps, bandwidth);
        left
    }

    fn add(&mut self, left: f32, favourite: f32) {
        self.left += left * left;
        self.apart += (left - favourite) * (left - favourite);
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
    /// The pole that the others are compared with.
    favourite: usize,
    last: Seen,
    /// Mechanical turns since the last one ended; less than none until the references have settled.
    turned: f32,
    /// Samples and turns in the sums.
    samples: f32,
    turns: u32,
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
        Self {
            candidates: [None; POLES],
            bare: None,
            favourite: 0,
            last,
            turned: -SETTLING_TURNS,
            samples: 0.0,
            turns: 0,
        }
    }

    /// Takes a sample; `used` is the pole in use, if there is one, and `noise_deg` what the map left over of single
    /// samples when it was learnt. A verdict at the end of a mechanical turn. At rest nothing is learnt.
    pub fn push(&mut self, map: &Map, noise_deg: f32, used: Option<i32>, seen: &Seen) -> Option<Verdict> {
        let steps = seen.sequence.wrapping_sub(self.last.sequence);
        if self.bare.is_none() || steps > LONGEST_GAP {
            self.begin(map, seen);
            return None;
        }
        if steps == 0 {
            return None;
        }
        if let Some(used) = used.and_then(|used| usize::try_from(used).ok()).filter(|&used| used != self.favourite) {
            self.favour(used);
        }
        let pole_pairs = f32::from(map.pole_pairs());
        self.turned += turns(seen.measured, self.last.measured).abs() / pole_pairs;
        self.last = *seen;
        self.sum(map, BANDWIDTH / pole_pairs);
        if self.turned < 1.0 || self.samples < LEAST_SAMPLES {
            return None;
        }
        self.turned = 0.0;
        self.turns += 1;
        self.decide(noise_deg, used.is_some())
    }

    fn sum(&mut self, map: &Map, bandwidth: f32) {
        let seen = self.last;
        let take = |pole: usize, candidate: &mut Candidate| {
            candidate.take(&seen, |position| map.error_from(pole as i32, position).to_bits().into(), bandwidth)
        };
        let favourite = self.favourite;
        let Some(Some(chosen)) = self.candidates.get_mut(favourite) else { return };
        let least = take(favourite, chosen);
        let settled = self.turned >= 0.0;
        if settled {
            self.samples += 1.0;
            chosen.add(least, least);
        }
        for (pole, candidate) in self.candidates.iter_mut().enumerate().filter(|(pole, _)| *pole != favourite) {
            let Some(candidate) = candidate else { continue };
            let left = take(pole, candidate);
            if settled {
                candidate.add(left, least);
            }
        }
        if let Some(bare) = &mut self.bare {
            let left = bare.take(&seen, |_| 0, bandwidth);
            if settled {
                bare.add(left, least);
            }
        }
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

    /// Compares with another pole from now on.
    fn favour(&mut self, pole: usize) {
        self.favourite = pole;
        (self.samples, self.turns) = (0.0, 0);
        for candidate in self.candidates.iter_mut().flatten().chain(&mut self.bare) {
            (candidate.left, candidate.apart) = (0.0, 0.0);
        }
    }

    #[inline(never)]
    fn decide(&mut self, noise_deg: f32, in_use: bool) -> Option<Verdict> {
        let favourite = self.favourite;
        let chosen = self.candidates.get(favourite).copied().flatten()?;
        let alike = self.samples * (ALIKE_DEG / 360.0) * (ALIKE_DEG / 360.0);
        let all = || self.candidates.iter().flatten();
        let others = || all().filter(|candidate| candidate.apart > alike).chain(&self.bare);
        let fit = |other: &Candidate| (other.left - chosen.left) / other.apart.max(alike);
        let (worst, against) = others().map(|other| (fit(other), other)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let apart = against.apart.max(alike);
        // Noise moves ρ by twice its size over the root of what the two are apart.
        let sigmas = worst * crate::float::root(apart * self.samples / chosen.left) / 2.0;
        let noise = (noise_deg / 360.0) * (noise_deg / 360.0) * NOISE * self.samples;
        let nearest = others().map(|other| other.apart).fold(f32::MAX, f32::min);
        let verdict = Verdict {
            electrical_turns: favourite as i32,
            fit: worst,
            left_deg: 360.0 * crate::float::root(chosen.left / self.samples),
            sure: worst >= FIT
                && sigmas >= SIGMAS
                && self.turns >= LEAST_TURNS
                && chosen.left - noise <= MOTION * nearest.max(alike),
            misfit: sigmas < -SIGMAS_AGAINST && against.left - noise <= SHAKEN * apart,
        };
        let (best, _) = self
            .candidates
            .iter()
            .flatten()
            .map(|candidate| candidate.left)
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        // What is in use is judged turn by turn.
        if in_use || best != favourite || self.turns >= MOST_TURNS {
            self.favour(if in_use { favourite } else { best });
        }
        Some(verdict)
    }
}
