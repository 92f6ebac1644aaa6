//! At which pole the rotor stands, by the current that its cogging takes as it turns.
//!
//! What friction and cogging take is y; what the table says for each pole that the position may have begun at, Tₖ. Both
//! are weighted by the way between two measurements, so that a mean over a whole turn is one over its angle, and taken
//! about their means, as friction is constant. In each turn, pole j is judged against another, k, by
//! ρ = (Σ(y − Tₖ)² − Σ(y − Tⱼ)²) / Σ(Tⱼ − Tₖ)²: noise leaves it at 1 if j is right, and at −1 if k is. One candidate
//! more is no table at all. A pole is sure where ρ, over [`LEAST_TURNS`] turns or more, is a half or more in the mean
//! against every other one and against none, and [`SIGMAS`] times as much as its scatter from turn to turn lets the mean
//! be off. Poles where the table is the same are not told apart, as either is right.

use crate::angle::{Position, TURN};
use crate::turn::{FRACTION, Table};

/// Least ρ of a pole that is sure.
const FIT: f32 = 0.5;
/// By how many standard deviations of the mean.
const SIGMAS: f32 = 6.0;
/// A table in use speaks against itself where ρ is below none by so many.
const SIGMAS_AGAINST: f32 = 3.0;
/// Two poles are alike where their tables differ by less than this share of the table's own power.
const ALIKE: f32 = 0.05;
/// Turns for a pole to be sure, at least, and those that a table in use is judged by.
const LEAST_TURNS: u32 = 4;
const TURNS_IN_USE: u32 = 8;
/// After so many it begins anew.
const MOST_TURNS: u32 = 64;
/// Least samples in a turn.
const LEAST_SAMPLES: u32 = 32;

/// What some turns have shown.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Verdict {
    /// The pole that is in use, or fits best: for [`Table::value_from`].
    pub electrical_turns: i32,
    /// Least mean ρ of it, −1 to 1, but for noise.
    pub fit: f32,
    /// Whether it may be used.
    pub sure: bool,
    /// Whether it is to be used no longer.
    pub misfit: bool,
}

/// Weighted sums over a turn of what one pole says, and with the current.
#[derive(Clone, Copy, Debug)]
struct Sums {
    value: f32,
    square: f32,
    product: f32,
}

impl Sums {
    const ZERO: Self = Self { value: 0.0, square: 0.0, product: 0.0 };
}

/// What is left over with one pole, turn by turn, against the favourite: sums of ρ and of its square; and by how much
/// less than with none, over all.
#[derive(Clone, Copy, Debug)]
struct Against {
    fit: f32,
    square: f32,
    explained: f32,
}

impl Against {
    const ZERO: Self = Self { fit: 0.0, square: 0.0, explained: 0.0 };

    fn add(&mut self, fit: f32) {
        self.fit += fit;
        self.square += fit * fit;
    }

    /// Mean of ρ over so many turns, and by how much that may be off.
    fn mean(&self, turns: u32) -> (f32, f32) {
        let turns = turns as f32;
        let mean = self.fit / turns;
        let variance = (self.square - turns * mean * mean).max(0.0) / (turns - 1.0).max(1.0);
        (mean, crate::float::root(variance / turns))
    }
}

/// Finds the pole for rotors of up to `POLES` pole pairs.
#[derive(Clone, Debug)]
pub struct Finder<const POLES: usize> {
    poles: [Sums; POLES],
    against: [Against; POLES],
    none: Against,
    /// The pole that the others are compared with.
    favourite: usize,
    turns: u32,
    /// Sums of the weights and of the currents, in this turn.
    weight: f32,
    current: f32,
    samples: u32,
    last: Option<Position>,
    /// Where this turn began.
    begun: Option<Position>,
}

impl<const POLES: usize> Default for Finder<POLES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const POLES: usize> Finder<POLES> {
    /// At the begin.
    pub const fn new() -> Self {
        Self {
            poles: [Sums::ZERO; POLES],
            against: [Against::ZERO; POLES],
            none: Against::ZERO,
            favourite: 0,
            turns: 0,
            weight: 0.0,
            current: 0.0,
            samples: 0,
            last: None,
            begun: None,
        }
    }

    /// Takes the current that friction and cogging take at a position; `used` is the pole in use, if there is one. A
    /// verdict at the end of a mechanical turn one way, or of several. At rest nothing is learnt.
    pub fn push(&mut self, table: &Table, used: Option<i32>, position: Position, current: f32) -> Option<Verdict> {
        let begun = *self.begun.get_or_insert(position);
        let weight = electrical_turns(position, self.last.replace(position)?).abs();
        self.add(table, position, current, weight);
        if electrical_turns(position, begun).abs() < f32::from(table.pole_pairs()) || self.samples < LEAST_SAMPLES {
            return None;
        }
        let verdict = self.end_turn(table, used);
        self.begun = Some(position);
        (self.weight, self.current, self.samples) = (0.0, 0.0, 0);
        self.poles = [Sums::ZERO; POLES];
        verdict
    }

    fn add(&mut self, table: &Table, position: Position, current: f32, weight: f32) {
        self.samples += 1;
        self.weight += weight;
        self.current += weight * current;
        for (pole, sums) in self.poles.iter_mut().enumerate().take(table.pole_pairs().into()) {
            let value = table.value_from(pole as i32, position) as f32 / (1 << FRACTION) as f32;
            sums.value += weight * value;
            sums.square += weight * value * value;
            sums.product += weight * value * current;
        }
    }

    /// By how much less is left over of this turn with a pole than with none, a mean square.
    fn explained(&self, pole: usize) -> f32 {
        let Some(sums) = self.poles.get(pole) else { return 0.0 };
        let mean = sums.value / self.weight;
        let square = sums.square / self.weight - mean * mean;
        2.0 * (sums.product - mean * self.current) / self.weight - square
    }

    #[inline(never)]
    fn end_turn(&mut self, table: &Table, used: Option<i32>) -> Option<Verdict> {
        let pairs = usize::from(table.pole_pairs()).min(POLES);
        for pole in 0..pairs {
            self.against[pole].explained += self.explained(pole);
        }
        let best = (0..pairs).max_by(|&a, &b| self.against[a].explained.total_cmp(&self.against[b].explained))?;
        let favourite = used.map_or(best, |used| used.rem_euclid(pairs as i32) as usize);
        if favourite != self.favourite {
            self.favourite = favourite;
            self.forget_fits();
        }
        self.turns += 1;
        let chosen = self.explained(favourite);
        self.none.add(chosen / table.square());
        // Against no table; then against the others.
        let mut worst = self.none.mean(self.turns);
        for other in (0..pairs).filter(|&other| other != favourite) {
            let differ = table.difference(other as i32 - favourite as i32);
            if differ <= ALIKE * table.square() {
                continue;
            }
            let fit = (chosen - self.explained(other)) / differ;
            self.against[other].add(fit);
            let mean = self.against[other].mean(self.turns);
            if mean.0 - SIGMAS * mean.1 < worst.0 - SIGMAS * worst.1 {
                worst = mean;
            }
        }
        self.judge(favourite, used.is_some(), worst)
    }

    fn judge(&mut self, favourite: usize, in_use: bool, (fit, off): (f32, f32)) -> Option<Verdict> {
        let least = if in_use { TURNS_IN_USE } else { LEAST_TURNS };
        if self.turns < least {
            return None;
        }
        if in_use || self.turns >= MOST_TURNS {
            self.forget_fits();
        }
        Some(Verdict {
            electrical_turns: favourite as i32,
            fit,
            sure: fit >= FIT && fit >= SIGMAS * off,
            misfit: fit < -SIGMAS_AGAINST * off,
        })
    }

    /// What the poles explain is kept while one is looked for.
    fn forget_fits(&mut self) {
        self.turns = 0;
        self.none = Against::ZERO;
        for against in &mut self.against {
            *against = Against { explained: against.explained, ..Against::ZERO };
        }
    }
}

/// How far one position is from another.
fn electrical_turns(position: Position, from: Position) -> f32 {
    position.to_bits().wrapping_sub(from.to_bits()) as f32 / TURN
}
