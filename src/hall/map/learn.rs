//! A map is learnt from a rotor that turns freely.
//!
//! A constant torque balances friction. Then the rotor's speed changes slowly, whatever the Halls show: cogging moves
//! it by its torque over inertia and the square of its frequency, which at some ten turns a second is nothing. A
//! [`Reference`] with a bandwidth far below the turn's frequency is where the rotor is; what the Halls' angle is ahead
//! of it, over the turn, is the map. It is taken off before the reference sees the angle, so that in the end nothing
//! of it is left there.

use super::{FRACTION, Layout, Map, POINTS, Table};
use crate::angle::{PolePairs, Position, TURN};
use core::f32::consts::TAU;

/// Bandwidth of the reference, in radians of it in a radian of the mechanical turn. A slower one does not follow the speed of
/// a slow machine, which is never quite steady; to a faster one, what repeats once a turn looks like motion.
const BANDWIDTH: f32 = 1.0 / 4.0;
/// Mechanical turns in which it settles, and what its bandwidth is over the radians since the begin meanwhile, if that is
/// more: what it is behind by at first must have died before anything is learnt of it.
const SETTLING_TURNS: f32 = 3.0;
const SETTLING: f32 = 3.0;
/// Fastest that the reference may be, rad a record.
const FASTEST: f32 = 0.1;
/// What a sample counts for the points beside it until a quarter of the samples are there; later, ever less.
const FIRST_SHARE: f32 = 0.25;

/// Where a rotor is whose speed changes slowly: three integrators, all poles at one real frequency.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference {
    position: Position,
    /// Where it began.
    begun: Position,
    /// Electrical turns a step.
    speed: f32,
    /// Electrical turns a step².
    acceleration: f32,
    sequence: u32,
}

impl Reference {
    /// At a position, with a speed in 2⁻³² electrical turns a step.
    pub fn at(position: Position, speed: i32, sequence: u32) -> Self {
        Self { position, begun: position, speed: speed as f32 / TURN, acceleration: 0.0, sequence }
    }

    /// Goes on to a step, accelerated by a known torque, in electrical turns a step²; how many steps that is.
    pub fn advance(&mut self, sequence: u32, driven: f32) -> f32 {
        let steps = sequence.wrapping_sub(self.sequence) as f32;
        self.sequence = sequence;
        let acceleration = self.acceleration + driven;
        let turned = steps * (self.speed + 0.5 * steps * acceleration);
        self.position = Position::from_bits(self.position.to_bits().wrapping_add((turned * TURN) as i64));
        self.speed += steps * acceleration;
        steps
    }

    /// Electrical turns since it began.
    pub fn turned(&self) -> f32 {
        turns(self.position, self.begun).abs()
    }

    pub const fn position(&self) -> Position {
        self.position
    }

    /// It is ahead of where it was thought to be, electrical turns.
    fn shift(&mut self, by: f32) {
        self.position = Position::from_bits(self.position.to_bits().wrapping_add((by * TURN) as i64));
    }

    /// How far a position is ahead, electrical turns.
    pub fn behind(&self, position: Position) -> f32 {
        turns(position, self.position)
    }

    /// Corrects by how far it is behind, after so many steps, with a bandwidth in radians of it in one of the electrical
    /// turn.
    pub fn correct(&mut self, behind: f32, steps: f32, bandwidth: f32) {
        let turned = self.speed.abs() * steps * TAU;
        let w = (bandwidth * turned).min(FASTEST);
        let by = (3.0 * w * behind * TURN) as i64;
        self.position = Position::from_bits(self.position.to_bits().wrapping_add(by));
        self.speed += 3.0 * w * w * behind / steps;
        self.acceleration += w * w * w * behind / (steps * steps);
    }
}

/// How far one position is from another, electrical turns.
pub(super) fn turns(position: Position, from: Position) -> f32 {
    position.to_bits().wrapping_sub(from.to_bits()) as f32 / TURN
}

/// Learns a map from positions as the Halls show them: 2.1 KiB.
#[derive(Clone, Debug)]
pub struct Learner {
    layout: Layout,
    /// 2⁻³² electrical turns.
    points: [f32; POINTS],
    reference: Option<Reference>,
    /// Mean square of what is left over, of the samples that are averaged.
    square: f32,
    /// Samples so far, and from which on their mean is taken.
    samples: u32,
    averages_from: u32,
}

impl Learner {
    /// Of so many samples, of both directions together.
    pub fn new(pole_pairs: PolePairs, samples: u32) -> Self {
        Self {
            layout: Layout::new(pole_pairs),
            points: [0.0; POINTS],
            reference: None,
            square: 0.0,
            samples: 0,
            averages_from: samples / 4,
        }
    }

    /// Samples of both directions together with which the map's own noise is a third of that of the tracked angle.
    pub fn samples_for(pole_pairs: PolePairs) -> u32 {
        256 * Layout::new(pole_pairs).points() as u32
    }

    /// The rotor does not turn freely until the next sample.
    pub fn pause(&mut self) {
        self.reference = None;
    }

    /// Takes a position as the Halls show it, at a speed in 2⁻³² electrical turns a step, in a step.
    pub fn push(&mut self, measured: Position, speed: i32, sequence: u32) {
        let Some(reference) = &mut self.reference else {
            self.reference = Some(Reference::at(measured, speed, sequence));
            return;
        };
        let steps = reference.advance(sequence, 0.0);
        if !(steps > 0.0) {
            return;
        }
        let (index, next, share) = self.layout.place(reference.position());
        let share = share as f32 * (1.0 / 65_536.0);
        let known = self.points[index] + share * (self.points[next] - self.points[index]);
        let behind = reference.behind(measured) - known;
        let pole_pairs = self.layout.pole_pairs as f32;
        let turned = reference.turned() / pole_pairs;
        let bandwidth = BANDWIDTH.max(SETTLING / (TAU * turned).max(f32::MIN_POSITIVE));
        reference.correct(behind, steps, bandwidth / pole_pairs);
        if turned < SETTLING_TURNS {
            return;
        }
        self.samples += 1;
        let all = self.layout.points() as f32;
        let averaged = self.samples.saturating_sub(self.averages_from) as f32;
        self.square += (behind * behind - self.square) / averaged.max(all);
        let by = behind / (1.0 / FIRST_SHARE + averaged / all);
        self.points[index] += by * (1.0 - share);
        self.points[next] += by * share;
        if self.samples.is_multiple_of(self.layout.points() as u32) {
            self.centre();
        }
    }

    /// Nothing but this tells the map's mean from the reference's lag: left to itself, the points take up what it is behind
    /// by at first, and belong to other angles than those that they are at.
    fn centre(&mut self) {
        let mean = self.mean();
        self.points.iter_mut().take(self.layout.points()).for_each(|point| *point -= mean);
        if let Some(reference) = &mut self.reference {
            reference.shift(mean);
        }
    }

    fn mean(&self) -> f32 {
        let count = self.layout.points();
        self.points[..count].iter().sum::<f32>() / count as f32
    }

    /// What the map leaves over of single samples, degrees RMS: their noise, if it is a good one.
    pub fn noise_deg(&self) -> f32 {
        360.0 * crate::float::root(self.square)
    }

    /// How many samples it has taken.
    pub const fn samples(&self) -> u32 {
        self.samples
    }

    /// The map. Its mean is none: that is the alignment's.
    pub fn map(&self) -> Map {
        let count = self.layout.points();
        let mean = self.mean();
        let mut table = Table { layout: self.layout, ..Table::ZERO };
        for (place, point) in table.points.iter_mut().zip(&self.points[..count]) {
            *place = libm::roundf((point - mean) * TURN / (1 << FRACTION) as f32) as i16;
        }
        Map(table)
    }
}
