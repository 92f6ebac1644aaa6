//! A two-ring encoder as it comes from the workshop, and the shaft that turns it.

use crate::rings::{Head, Ring};
use core::f64::consts::TAU;
use libm::sin;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

/// How imperfect a construction is. Every value is the largest; what is drawn is anything up to it, in any direction,
/// except for the eccentricity and the harmonics, whose phase alone is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Imperfections {
    /// Of both rings together, in mm.
    pub eccentricity_mm: f64,
    /// Placement error of the opposite heads, in radians.
    pub misplacement_rad: f64,
    /// Amplitudes of the first to fourth harmonic of each ring's angle error, in electrical radians.
    pub harmonics_rad: [f64; 4],
    /// Displacement of the begin of a pole pair, in electrical radians.
    pub displacement_rad: f64,
    /// Noise of a reading, in codes, evenly distributed.
    pub noise: f64,
}

impl Imperfections {
    /// None.
    pub const NONE: Self = Self {
        eccentricity_mm: 0.0,
        misplacement_rad: 0.0,
        harmonics_rad: [0.0; 4],
        displacement_rad: 0.0,
        noise: 0.0,
    };
}

/// Two rings with up to two heads each: for each ring the first head and the one opposite.
#[derive(Clone, Debug)]
pub struct Construction {
    /// The rings.
    pub rings: [Ring; 2],
    /// Their heads.
    pub heads: [[Head; 2]; 2],
    noise: f64,
    random: Pcg32,
}

impl Construction {
    /// Rings of the given pole pairs, each `pole_pair_length_mm` mm long, with heads of `bits` bits; the heads of the
    /// second ring stand `head_angle` further than those of the first.
    pub fn new(
        pole_pairs: [usize; 2],
        pole_pair_length_mm: f64,
        head_angle_rad: f64,
        bits: u32,
        imperfections: &Imperfections,
        seed: u64,
    ) -> Self {
        let mut random = Pcg32::seed_from_u64(seed);
        let eccentricity_direction_rad = TAU * unit(&mut random);
        let rings = pole_pairs.map(|pole_pairs| {
            let mut ring = Ring {
                eccentricity_mm: imperfections.eccentricity_mm,
                eccentricity_direction_rad,
                harmonics_rad: imperfections.harmonics_rad.map(|amplitude| (amplitude, TAU * unit(&mut random))),
                ..Ring::new(pole_pairs, pole_pair_length_mm)
            };
            for displacement in &mut ring.displacements_rad[..pole_pairs] {
                *displacement = imperfections.displacement_rad * signed(&mut random);
            }
            ring
        });
        let heads = [0.0, head_angle_rad].map(|mounted| {
            let first = Head::new(mounted, bits);
            let opposite = first.opposite(imperfections.misplacement_rad * signed(&mut random));
            [first, opposite]
        });
        Self { rings, heads, noise: imperfections.noise, random }
    }

    /// The codes of heads that give angles, with the shaft at `shaft_rad`: for each ring those of its first `HEADS`
    /// heads.
    pub fn digital<const HEADS: usize>(&mut self, shaft_rad: f64) -> [[u16; HEADS]; 2] {
        core::array::from_fn(|ring| {
            core::array::from_fn(|head| {
                let noise = self.noise * signed(&mut self.random);
                self.heads[ring][head].digital(&self.rings[ring], shaft_rad, noise)
            })
        })
    }

    /// The codes of heads that give sine and cosine.
    pub fn analog<const HEADS: usize>(&mut self, shaft_rad: f64) -> [[[u16; 2]; HEADS]; 2] {
        core::array::from_fn(|ring| {
            core::array::from_fn(|head| {
                let noise = [(); 2].map(|()| self.noise * signed(&mut self.random));
                self.heads[ring][head].analog(&self.rings[ring], shaft_rad, noise)
            })
        })
    }
}

/// A shaft that should turn at constant speed and does not: its speed varies with its angle.
#[derive(Clone, Debug)]
pub struct UnsteadyShaft {
    /// The angle now.
    pub angle_rad: f64,
    step_rad: f64,
    ripple: f64,
    phases: [f64; 4],
}

/// Orders of the ripple and the share of each: imbalance, a bent coupling, and the cogging of two motors.
const RIPPLE: [(f64, f64); 4] = [(1.0, 0.4), (2.0, 0.2), (12.0, 0.2), (42.0, 0.2)];

impl UnsteadyShaft {
    /// A shaft that turns by `step_rad` radians a sample on average, its speed varying by up to the share `ripple`.
    pub fn new(step_rad: f64, ripple: f64, seed: u64) -> Self {
        let mut random = Pcg32::seed_from_u64(seed);
        let angle_rad = TAU * unit(&mut random);
        Self { angle_rad, step_rad, ripple, phases: [(); 4].map(|()| TAU * unit(&mut random)) }
    }

    /// Turns on by one sample, and gives the angle.
    pub fn turn(&mut self) -> f64 {
        let variation: f64 = RIPPLE
            .iter()
            .zip(self.phases)
            .map(|((order, share), phase)| share * sin(order * self.angle_rad + phase))
            .sum();
        self.angle_rad += self.step_rad * (1.0 + self.ripple * variation);
        self.angle_rad
    }
}

/// 0 to 1.
fn unit(random: &mut Pcg32) -> f64 {
    f64::from(random.next_u32()) / 4_294_967_296.0
}

/// −1 to 1.
fn signed(random: &mut Pcg32) -> f64 {
    2.0 * unit(random) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_builds_the_same_encoder() {
        let imperfections = Imperfections {
            eccentricity_mm: 0.05,
            misplacement_rad: 0.01,
            harmonics_rad: [0.03, 0.03, 0.0, 0.0],
            displacement_rad: 0.02,
            noise: 1.0,
        };
        let codes = |seed| Construction::new([37, 45], 2.0, 0.7, 12, &imperfections, seed).digital::<2>(1.0);
        assert_eq!(codes(3), codes(3));
        assert_ne!(codes(3), codes(4));
    }

    #[test]
    fn the_speed_varies_as_much_as_it_should() {
        let mut shaft = UnsteadyShaft::new(1e-3, 0.05, 1);
        let mut last = shaft.angle_rad;
        let (mut slowest, mut fastest) = (f64::MAX, 0.0_f64);
        for _ in 0..10_000 {
            let angle = shaft.turn();
            slowest = slowest.min(angle - last);
            fastest = fastest.max(angle - last);
            last = angle;
        }
        assert!(slowest > 0.95e-3 && slowest < 0.97e-3, "{slowest}");
        assert!(fastest < 1.05e-3 && fastest > 1.03e-3, "{fastest}");
    }
}
