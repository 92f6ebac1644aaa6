//! From two readings to the absolute angle: eq. (5) to (9) of the paper without its search.
//!
//! The paper carries the vernier's reading y back to where the reference showed zero, z = y − (q/p)·x modulo one, and
//! searches the p values that z can have. Multiplied by −p, that is u = q·x − p·y, which for ideal rings is a whole
//! number n of pole pairs (see [`Rings`]): the search is the rounding of u, and n is the place in a table of pole
//! pairs. What the rounding cuts off is the residual: zero for ideal rings, ±½ at the margin. As x and y are in [0, 1),
//! n runs from −p to q, so that a table of p + q + 1 ≤ 128 entries answers every pair of readings without a modulo;
//! in particular u rounds to n = q where x is just below one and y just above zero.
//!
//! With real rings the averages of z over each pole pair are not evenly spaced. [`AverageTable`] still finds the
//! nearest of them by looking at two: see there.

use super::rings::{Ring, Rings};
use crate::angle::MechanicalAngle;

/// Entries of a table: n from −64 to 64 is as wide as coprime counts up to 64 get, 63 + 64 + 1.
const ENTRIES: usize = 128;

/// Absolute angle of one pair of readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Decoded {
    /// The mechanical angle; zero is where pole pair 0 of the reference begins.
    pub angle: MechanicalAngle,
    /// Pole pair of the reference ring, from 0.
    pub pole_pair: u8,
    /// By how much the readings contradict each other, in 2⁻¹⁶ of the distance of two table entries. Positive when
    /// the reference ring reads too much or the vernier too little. At ±2¹⁵ the neighbouring entry would be as near.
    pub residual: i32,
}

/// What both tables have in common: the multiplications and the angle.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Lattice {
    vernier_pairs: i32,
    reference_pairs: i32,
    /// p pole pairs: makes u positive, and n an index.
    bias: i32,
    /// 2³² / p.
    scale: u32,
}

impl Lattice {
    const fn new(rings: &Rings) -> Self {
        let p = rings.pole_pairs(Ring::Reference) as u32;
        Self {
            vernier_pairs: rings.pole_pairs(Ring::Vernier) as i32,
            reference_pairs: p as i32,
            bias: (p as i32) << 16,
            // One is out of range for a single pole pair: 2³² − 1 costs the last bit of the angle.
            scale: if p == 1 { u32::MAX } else { (((1_u64 << 32) + p as u64 / 2) / p as u64) as u32 },
        }
    }

    /// u = q·x − p·y, plus p pole pairs: 1 to (p + q)·2¹⁶ − 1.
    #[inline(always)]
    const fn difference(&self, reference: u16, vernier: u16) -> i32 {
        self.bias + self.vernier_pairs * reference as i32 - self.reference_pairs * vernier as i32
    }

    /// Eq. (9) in turns: (k + x) / p, to 32 · 2⁻³² turns.
    #[inline(always)]
    const fn angle(&self, pole_pair: u32, reference: u16) -> MechanicalAngle {
        let position = (pole_pair << 16) | reference as u32;
        MechanicalAngle::from_bits(((position as u64 * self.scale as u64) >> 16) as i32)
    }
}

/// The decoder for rings taken as ideal: 144 bytes.
#[derive(Clone, Debug)]
pub struct IdealTable {
    lattice: Lattice,
    pole_pairs: [u8; ENTRIES],
}

impl IdealTable {
    /// The table, in a const or at start.
    pub const fn new(rings: &Rings) -> Self {
        let mut pole_pairs = [0; ENTRIES];
        let mut index = 0;
        while index < ENTRIES {
            pole_pairs[index] = rings.pole_pair(index as i32 - rings.pole_pairs(Ring::Reference) as i32);
            index += 1;
        }
        let mut lattice = Lattice::new(rings);
        // Half an entry more makes the truncation a rounding.
        lattice.bias += 1 << 15;
        Self { lattice, pole_pairs }
    }

    /// The absolute angle of two readings; every pair is legal. Exact while the residual is within the margin.
    #[inline(always)]
    pub const fn decode(&self, reference: u16, vernier: u16) -> Decoded {
        let difference = self.lattice.difference(reference, vernier);
        let pole_pair = self.pole_pairs[(difference >> 16) as usize & (ENTRIES - 1)];
        Decoded {
            angle: self.lattice.angle(pole_pair as u32, reference),
            pole_pair,
            residual: (difference & 0xFFFF) - (1 << 15),
        }
    }
}

/// An entry of the table of averages: the pole pair in the upper half, in the lower by how far the average residual of
/// this pole pair is below zero. One word, so that two entries are one load.
#[derive(Clone, Copy, Debug, Default)]
struct Entry(u32);

impl Entry {
    const fn new(pole_pair: u8, average: i16) -> Self {
        Self((pole_pair as u32) << 16 | average.wrapping_neg() as u16 as u32)
    }

    const fn pole_pair(self) -> u32 {
        self.0 >> 16
    }

    const fn below(self) -> i32 {
        self.0 as i16 as i32
    }
}

/// The decoder for rings as they are, with the average residual of every pole pair (section IV.C): 532 bytes.
///
/// The nearest entry is one of the two between which u lies, n = ⌊u⌋ and n + 1, as long as no average a is further
/// than half a distance from its ideal place. Let f = u − n be in [0, 1). The entry below is |f − a| ≤ f + ½ away, and
/// the one before it at least 1 + f − ½; the entry above is at most 1 − f + ½ away, and the one after it at least
/// 2 − f − ½. An `i16` cannot hold an average out of that range, so the search over two entries always finds what a
/// scan of all would.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct AverageTable {
    lattice: Lattice,
    /// One more than there are, so that every entry has one after it.
    entries: [Entry; ENTRIES + 1],
}

impl AverageTable {
    /// The table from the average residual of each pole pair of the reference ring, above −2¹⁵; those beyond its count
    /// are ignored.
    pub const fn new(rings: &Rings, averages: &[i16; 64]) -> Self {
        let mut entries = [Entry(0); ENTRIES + 1];
        let mut index = 0;
        while index < entries.len() {
            let pole_pair = rings.pole_pair(index as i32 - rings.pole_pairs(Ring::Reference) as i32);
            entries[index] = Entry::new(pole_pair, averages[pole_pair as usize]);
            index += 1;
        }
        Self { lattice: Lattice::new(rings), entries }
    }

    /// The absolute angle of two readings; every pair is legal. The residual counts from the average of the pole pair
    /// found, which is the nearest.
    #[inline(always)]
    pub const fn decode(&self, reference: u16, vernier: u16) -> Decoded {
        let difference = self.lattice.difference(reference, vernier);
        let index = (difference >> 16) as usize & (ENTRIES - 1);
        let fraction = difference & 0xFFFF;
        let (lower, upper) = (self.entries[index], self.entries[index + 1]);
        let over_lower = fraction + lower.below();
        let over_upper = fraction - (1 << 16) + upper.below();
        // Of the two distances the one is counted up and the other down: their sum tells the smaller.
        let (entry, residual) = if over_lower + over_upper < 0 { (lower, over_lower) } else { (upper, over_upper) };
        Decoded {
            angle: self.lattice.angle(entry.pole_pair(), reference),
            pole_pair: entry.pole_pair() as u8,
            residual,
        }
    }
}
