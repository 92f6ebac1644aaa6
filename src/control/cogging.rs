//! Anti-cogging: a current over the electrical turn that compensates the torque between magnets and teeth.
//!
//! The rotor turns slowly under speed control, once forward and once backward; the current that this takes, averaged
//! over both directions, is the cogging's: friction has the other sign on the way back. Cogging repeats with the
//! electrical turn in all motors whose slots divide evenly among the pole pairs and whose magnets are alike; what
//! differs [from pole to pole](by_pole) is learnt beside it, where a drive has room for that.

#[cfg(not(feature = "small"))]
pub mod by_pole;

use crate::angle::ElectricalAngle;
use crate::trig;

/// Points of the table.
pub const POINTS: usize = 128;

/// A current along q over the electrical angle, in 2⁻¹⁵ of the full scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Table(pub [i16; POINTS]);

impl Table {
    /// No current.
    pub const ZERO: Self = Self([0; POINTS]);

    /// The same cogging for a drive that counts the other way: both the angle and the current change their signs.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let point = |k: usize| self.0.get((POINTS - k) % POINTS).map_or(0, |current| current.saturating_neg());
        Self(core::array::from_fn(point))
    }

    /// The current at an angle, interpolated between the points.
    #[inline(always)]
    pub const fn current(&self, angle: ElectricalAngle) -> i32 {
        let bits = angle.to_bits() as u32;
        let index = (bits >> 25) as usize;
        let (start, end) = (self.0[index] as i32, self.0[(index + 1) & (POINTS - 1)] as i32);
        start + (((end - start) * ((bits >> 9) & 0xFFFF) as i32) >> 16)
    }
}

/// Learns a table from angles and currents.
#[derive(Clone, Copy, Debug)]
pub struct Learner {
    /// Sums and counts, forward and backward.
    bins: [[(f32, u32); POINTS]; 2],
}

impl Default for Learner {
    fn default() -> Self {
        Self { bins: const { [[(0.0, 0); POINTS]; 2] } }
    }
}

/// Samples that each point needs in each direction.
const LEAST: u32 = 4;

impl Learner {
    /// Takes the whole current that turning takes at an angle, forward or backward, that of a table in use included.
    pub fn push(&mut self, forward: bool, angle: ElectricalAngle, current: i32) {
        // The nearest point.
        let index = (angle.to_bits() as u32).wrapping_add(1 << 24) >> 25;
        let (sum, count) = &mut self.bins[usize::from(forward)][index as usize & (POINTS - 1)];
        *sum += current as f32;
        *count += 1;
    }

    /// Share of the points that have enough samples in both directions, 0 to 1.
    pub fn progress(&self) -> f32 {
        let enough = self.bins.iter().flatten().filter(|(_, count)| *count >= LEAST).count();
        enough as f32 / (2 * POINTS) as f32
    }

    /// The table: the mean of both directions without its constant part, of its first `harmonics` (1 to 63) only.
    /// `None` while a point lacks samples.
    pub fn table(&self, harmonics: usize) -> Option<Table> {
        if self.progress() < 1.0 {
            return None;
        }
        let mean = |index: usize| {
            let [backward, forward] = [self.bins[0][index], self.bins[1][index]].map(|(sum, count)| sum / count as f32);
            (forward + backward) / 2.0
        };
        let mut smooth = [0.0_f32; POINTS];
        for harmonic in 1..=harmonics.clamp(1, POINTS / 2 - 1) {
            let wave = |index: usize| {
                let phase = ElectricalAngle::from_turns(((harmonic * index) % POINTS) as f32 / POINTS as f32);
                trig::sin_cos_f32(phase)
            };
            let (mut sine, mut cosine) = (0.0, 0.0);
            for index in 0..POINTS {
                let (sin, cos) = wave(index);
                sine += mean(index) * sin;
                cosine += mean(index) * cos;
            }
            for (index, value) in smooth.iter_mut().enumerate() {
                let scale = 2.0 / POINTS as f32;
                let (sin, cos) = wave(index);
                *value += scale * (sine * sin + cosine * cos);
            }
        }
        Some(Table(smooth.map(|value| crate::float::nearest(value).clamp(-32_768, 32_767) as i16)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_the_other_direction_compensates_the_same_torque() {
        let table = Table(core::array::from_fn(|k| ((k * k * 37) % 4001) as i16 - 2000));
        let reversed = table.reversed();
        assert_eq!(reversed.reversed(), table);
        for degrees in 0..360 {
            let angle = ElectricalAngle::from_degrees(degrees as f32);
            assert!((reversed.current(-angle) + table.current(angle)).abs() <= 2, "{degrees}");
        }
    }
    use core::f32::consts::TAU;

    #[test]
    fn learns_the_cogging_and_not_the_friction() {
        let cogging = |turns: f32| 60.0 * libm::sinf(6.0 * TAU * turns + 0.4) + 25.0 * libm::cosf(3.0 * TAU * turns);
        let mut learner = Learner::default();
        assert_eq!(learner.table(12), None);
        for step in 0..128_000_u32 {
            let forward = step < 64_000;
            let angle = ElectricalAngle::from_bits((step as i32).wrapping_mul(6_710_886));
            let friction = if forward { 70.0 } else { -70.0 };
            // Noise that averages out.
            let noise = (step.wrapping_mul(2_654_435_761) >> 25) as f32 - 63.5;
            learner.push(forward, angle, (cogging(angle.to_turns()) + friction + noise) as i32);
        }
        assert_eq!(learner.progress(), 1.0);
        let table = learner.table(12).unwrap();
        for k in 0..1000 {
            let angle = ElectricalAngle::from_turns(k as f32 / 1000.0);
            let error = table.current(angle) as f32 - cogging(angle.to_turns());
            assert!(error.abs() < 6.0, "{angle} {error}");
        }
    }

    #[test]
    fn a_point_counts_with_its_fourth_sample_in_both_directions() {
        let mut learner = Learner::default();
        for round in 1..=4 {
            assert_eq!((learner.progress(), learner.table(1)), (0.0, None), "{round}");
            for (forward, k) in [false, true].into_iter().flat_map(|forward| (0..POINTS).map(move |k| (forward, k))) {
                learner.push(forward, ElectricalAngle::from_turns(k as f32 / POINTS as f32), 0);
            }
        }
        assert_eq!((learner.progress(), learner.table(1)), (1.0, Some(Table::ZERO)));
    }

    #[test]
    fn interpolates_around_the_turn() {
        let mut table = Table::ZERO;
        (table.0[127], table.0[0]) = (100, -100);
        let at = |degrees: f32| table.current(ElectricalAngle::from_degrees(degrees));
        assert_eq!(at(-360.0 / 128.0), 100);
        assert_eq!(at(-180.0 / 128.0), 0);
        assert_eq!(at(0.0), -100);
    }
}
