//! Two rings on a shaft under two opposite heads each that give angles, and what may break of them.

use crate::construction::{Construction, Imperfections};
use core::f64::consts::TAU;
use libm::floor;

/// Heads over each ring.
pub const HEADS: usize = 2;
/// Bits of a head.
pub const BITS: u32 = 12;

/// What is wrong with rings or heads, which are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Defect {
    /// A head of a ring shows what it showed last.
    Stuck(usize, usize),
    /// A ring has turned on its shaft, rad.
    Slipped(usize, f64),
    /// Both have, together.
    BothSlipped(f64),
    /// The field of a pole pair of a ring is gone: the heads over it show anything.
    Chipped(usize, usize),
}

/// Two rings under their heads, as they come from the workshop.
#[derive(Clone, Debug)]
pub struct Encoder {
    construction: Construction,
    /// How far each ring has turned on the shaft, rad; its heads that are stuck; a bit for each pole pair that is chipped.
    slipped_rad: [f64; 2],
    stuck: [[bool; HEADS]; 2],
    chipped: [u128; 2],
    last: [[u16; HEADS]; 2],
    noise: u32,
}

impl Encoder {
    /// Rings of pole pairs 2 mm long, 40° apart, with 2° of first and second harmonic, opposite heads up to 1° off, a
    /// code of noise, and so far off the axis.
    pub fn new(pole_pairs: [usize; 2], eccentricity_mm: f64, seed: u64) -> Self {
        let harmonic = 2.0_f64.to_radians();
        let imperfections = Imperfections {
            eccentricity_mm,
            misplacement_rad: 1.0_f64.to_radians(),
            harmonics_rad: [harmonic, harmonic, 0.0, 0.0],
            displacement_rad: 0.0,
            noise: 1.0,
        };
        let construction = Construction::new(pole_pairs, 2.0, 40.0_f64.to_radians(), BITS, &imperfections, seed);
        Self {
            construction,
            slipped_rad: [0.0; 2],
            stuck: [[false; HEADS]; 2],
            chipped: [0; 2],
            last: [[0; HEADS]; 2],
            noise: seed as u32 | 1,
        }
    }

    /// Something breaks, besides what is broken already; slips add up.
    pub fn suffer(&mut self, defect: Defect) {
        match defect {
            Defect::Stuck(ring, head) => self.stuck[ring][head] = true,
            Defect::Slipped(ring, angle_rad) => self.slipped_rad[ring] += angle_rad,
            Defect::BothSlipped(angle_rad) => self.slipped_rad.iter_mut().for_each(|slipped| *slipped += angle_rad),
            Defect::Chipped(ring, pair) => self.chipped[ring] |= 1_u128.checked_shl(pair as u32).unwrap_or(0),
        }
    }

    /// As good as before.
    pub const fn mend(&mut self) {
        (self.slipped_rad, self.stuck, self.chipped) = ([0.0; 2], [[false; HEADS]; 2], [0; 2]);
    }

    /// The codes of all heads, those of a ring together.
    pub fn read(&mut self, shaft_rad: f64) -> [[u16; HEADS]; 2] {
        let at_rad = self.slipped_rad.map(|slipped| shaft_rad + slipped);
        let mut codes = [0, 1].map(|ring| self.construction.digital(at_rad[ring])[ring]);
        for ring in 0..2 {
            for head in 0..HEADS {
                if self.stuck[ring][head] {
                    codes[ring][head] = self.last[ring][head];
                } else if self.chipped[ring] >> self.under(ring, head, at_rad[ring]) & 1 == 1 {
                    codes[ring][head] = self.anything();
                }
            }
        }
        self.last = codes;
        codes
    }

    /// The pole pair under a head.
    fn under(&self, ring: usize, head: usize, at_rad: f64) -> usize {
        let head = &self.construction.heads[ring][head];
        let ring = &self.construction.rings[ring];
        let turns = ring.angle_under(head.mounted_rad + head.misplaced_rad, at_rad) / TAU;
        ((turns - floor(turns)) * ring.pole_pairs as f64) as usize
    }

    /// A code of a head without a field (xorshift).
    const fn anything(&mut self) -> u16 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 17;
        self.noise ^= self.noise << 5;
        (self.noise >> 16) as u16 & ((1 << BITS) - 1)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    #[test]
    fn each_defect_shows_where_it_should_and_nowhere_else() {
        let reads = |defect: Option<Defect>| {
            let mut encoder = Encoder::new([37, 45], 0.05, 1);
            encoder.read(1.0);
            defect.into_iter().for_each(|defect| encoder.suffer(defect));
            (0..1000).map(|step| encoder.read(1.0 + f64::from(step) * TAU / 1000.0)).collect::<Vec<_>>()
        };
        let good = reads(None);
        // Heads that differ from good ones, and how often.
        let differ = |defect| {
            let bad = reads(Some(defect));
            let apart = |one: u16, other: u16| (i32::from(one) - i32::from(other) + 2048).rem_euclid(4096) - 2048;
            [0, 1].map(|ring: usize| {
                [0, 1].map(|head: usize| {
                    good.iter()
                        .zip(&bad)
                        .filter(|(one, other)| apart(one[ring][head], other[ring][head]).abs() > 4)
                        .count()
                })
            })
        };
        let [[stuck, a], [b, c]] = differ(Defect::Stuck(0, 0));
        assert!(stuck > 900 && [a, b, c] == [0; 3], "{stuck} {a} {b} {c}");
        let [[a, b], slipped] = differ(Defect::Slipped(1, 0.01));
        assert!(slipped.iter().all(|&count| count > 900) && [a, b] == [0; 2]);
        // However often it happens: slips add up.
        let mut encoder = Encoder::new([37, 45], 0.0, 1);
        (0..10).for_each(|_| encoder.suffer(Defect::BothSlipped(0.01)));
        assert!(encoder.slipped_rad.iter().all(|slipped| (slipped - 0.1).abs() < 1e-12));
        encoder.mend();
        assert_eq!(encoder.slipped_rad, [0.0; 2]);
        // One pole pair of 37, under each head once a turn.
        let [chipped, whole] = differ(Defect::Chipped(0, 5));
        assert!(chipped.iter().all(|count| (22..=28).contains(count)) && whole == [0; 2], "{chipped:?}");
    }
}
