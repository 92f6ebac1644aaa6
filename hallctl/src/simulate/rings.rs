//! The rings on the shaft of a simulated drive, and what may happen to them.

use super::firmware::HEADS;
use anyhow::{Result, anyhow, bail, ensure};
use hallservo::vernier::encoder::Reading;
use plant::construction::{Construction, Imperfections};
use std::f64::consts::TAU;
use std::str::FromStr;

/// Bits of a head.
const BITS: u32 = 12;
/// Length of a pole pair, mm.
const POLE_PAIR_MM: f64 = 2.0;
/// From the heads over one ring to those over the other.
const HEAD_ANGLE_DEG: f64 = 40.0;

/// Pole pairs of two rings: `37/45`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pairs(pub [usize; 2]);

impl FromStr for Pairs {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some((reference, vernier)) = text.split_once('/') else { bail!("two rings are like 37/45, not {text:?}") };
        let pairs =
            |text: &str| text.trim().parse().map_err(|_| anyhow!("a ring has 1 to 64 pole pairs, not {text:?}"));
        let pairs = [pairs(reference)?, pairs(vernier)?];
        ensure!(pairs.iter().all(|pairs| (1..=64).contains(pairs)), "a ring has 1 to 64 pole pairs");
        Ok(Self(pairs))
    }
}

/// What is wrong with rings or heads. Rings and heads are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Defect {
    /// A head shows what it showed last.
    Stuck(usize, usize),
    /// A ring has turned on its shaft, rad.
    Slipped(usize, f64),
    /// Both have.
    BothSlipped(f64),
    /// The field of a pole pair of a ring is gone: the heads over it show anything.
    Chipped(usize, usize),
}

/// Two rings under two opposite heads each, as they come from the workshop.
pub struct Rings {
    construction: Construction,
    defects: Vec<Defect>,
    last: [[u16; HEADS]; 2],
    noise: u32,
}

impl Rings {
    /// 2° of first and second harmonic, opposite heads up to 1° off, a code of noise, and so far off the axis.
    pub fn new(pairs: Pairs, eccentricity_mm: f64, seed: u64) -> Self {
        let harmonic = 2.0_f64.to_radians();
        let imperfections = Imperfections {
            eccentricity_mm,
            misplacement_rad: 1.0_f64.to_radians(),
            harmonics_rad: [harmonic, harmonic, 0.0, 0.0],
            displacement_rad: 0.0,
            noise: 1.0,
        };
        let head_angle_rad = HEAD_ANGLE_DEG.to_radians();
        let construction = Construction::new(pairs.0, POLE_PAIR_MM, head_angle_rad, BITS, &imperfections, seed);
        Self { construction, defects: Vec::new(), last: [[0; HEADS]; 2], noise: seed as u32 | 1 }
    }

    /// Something breaks.
    pub fn suffer(&mut self, defect: Defect) {
        self.defects.push(defect);
    }

    /// As good as before.
    pub fn mend(&mut self) {
        self.defects.clear();
    }

    /// What the heads show.
    pub fn read(&mut self, shaft_rad: f64) -> Reading<HEADS> {
        let mut slip = [0.0; 2];
        for defect in &self.defects {
            match *defect {
                Defect::Slipped(ring, angle_rad) => slip[ring] += angle_rad,
                Defect::BothSlipped(angle_rad) => slip = slip.map(|slip| slip + angle_rad),
                Defect::Stuck(..) | Defect::Chipped(..) => {}
            }
        }
        let codes: [[[u16; HEADS]; 2]; 2] = slip.map(|slip| self.construction.digital(shaft_rad + slip));
        let mut codes = [codes[0][0], codes[1][1]];
        for defect in 0..self.defects.len() {
            match self.defects[defect] {
                Defect::Stuck(ring, head) => codes[ring][head] = self.last[ring][head],
                Defect::Chipped(ring, pair) => {
                    for head in 0..HEADS {
                        if self.is_over(ring, head, pair, shaft_rad + slip[ring]) {
                            codes[ring][head] = self.anything();
                        }
                    }
                }
                Defect::Slipped(..) | Defect::BothSlipped(_) => {}
            }
        }
        self.last = codes;
        let [reference, vernier] = codes.map(|codes| codes.map(|code| code << (16 - BITS)));
        Reading { reference, vernier }
    }

    /// Whether a head is over a pole pair of a ring.
    fn is_over(&self, ring: usize, head: usize, pair: usize, shaft_rad: f64) -> bool {
        let head = &self.construction.heads[ring][head];
        let ring = &self.construction.rings[ring];
        let place = ring.angle_under(head.mounted_rad + head.misplaced_rad, shaft_rad).rem_euclid(TAU) / TAU;
        (place * ring.pole_pairs as f64) as usize == pair
    }

    /// A code of a head without a field (xorshift).
    fn anything(&mut self) -> u16 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 17;
        self.noise ^= self.noise << 5;
        (self.noise >> 16) as u16 & ((1 << BITS) - 1)
    }
}
