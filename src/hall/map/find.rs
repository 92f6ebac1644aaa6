//! Which pole the rotor is at after power-up, by the map's own signature.
//!
//! The rotor turns as it likes. For each pole that it may have begun at, the map is taken off the Halls' angle, and a
//! slow reference follows what is left: with the right one least is left over. How sure that is shows in how much more
//! the second best leaves.

use super::Map;
use super::learn::{Reference, turns};
use crate::angle::Position;

/// Times the variance that the best leaves, by which the second best must leave more.
const SURE: f32 = 60.0;
/// Bandwidth of the references, in radians of it in a radian of the mechanical turn: they settle within a turn or two.
const BANDWIDTH: f32 = 0.6;
/// Mechanical turns in which the references settle, from which on it may be sure.
const LEAST_TURNS: f32 = 1.5;

/// Where the map begins, and how sure that is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Found {
    /// For [`Map::turned`].
    pub electrical_turns: i32,
    /// What the second best leaves more, in variances of what the best leaves.
    pub certainty: f32,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    reference: Reference,
    /// Square of what is left over, mean of about the last mechanical turn.
    square: f32,
}

/// Finds the pole for rotors of up to `POLES` pole pairs.
#[derive(Clone, Debug)]
pub struct Finder<const POLES: usize> {
    candidates: [Option<Candidate>; POLES],
    begun: Option<Position>,
    last: Position,
}

impl<const POLES: usize> Default for Finder<POLES> {
    fn default() -> Self {
        Self { candidates: [None; POLES], begun: None, last: Position::from_bits(0) }
    }
}

impl<const POLES: usize> Finder<POLES> {
    /// Takes a position as the Halls show it, without a map, at a speed in 2⁻³² electrical turns a step, in a step.
    /// Tells the pole when it is sure. At rest nothing is learnt.
    pub fn push(&mut self, map: &Map, measured: Position, speed: i32, sequence: u32) -> Option<Found> {
        let pole_pairs = f32::from(map.pole_pairs());
        let begun = *self.begun.get_or_insert(measured);
        let share = (turns(measured, self.last).abs() / pole_pairs).min(1.0);
        self.last = measured;
        for (turns, place) in self.candidates.iter_mut().enumerate().take(map.pole_pairs().into()) {
            let turned = map.turned(turns as i32);
            let Some(candidate) = place else {
                let error = turned.error(measured).to_bits();
                let position = Position::from_bits(measured.to_bits() - i64::from(error));
                *place = Some(Candidate { reference: Reference::at(position, speed, sequence), square: 0.0 });
                continue;
            };
            let steps = candidate.reference.advance(sequence);
            if !(steps > 0.0) {
                return None;
            }
            let error = turned.error(candidate.reference.position()).to_bits();
            let behind = candidate.reference.behind(Position::from_bits(measured.to_bits() - i64::from(error)));
            candidate.reference.correct(behind, steps, BANDWIDTH / pole_pairs);
            candidate.square += share * (behind * behind - candidate.square);
        }
        let enough = turns(measured, begun).abs() >= LEAST_TURNS * pole_pairs;
        if enough { self.decide(1.0 / share) } else { None }
    }

    /// By means over so many samples.
    fn decide(&self, samples: f32) -> Option<Found> {
        let (mut best, mut second) = ((0, f32::MAX), f32::MAX);
        for (turns, candidate) in self.candidates.iter().enumerate() {
            let Some(candidate) = candidate else { continue };
            if candidate.square < best.1 {
                second = best.1;
                best = (turns as i32, candidate.square);
            } else {
                second = second.min(candidate.square);
            }
        }
        let certainty = samples * (second - best.1) / best.1;
        (certainty > SURE).then_some(Found { electrical_turns: best.0, certainty })
    }
}
