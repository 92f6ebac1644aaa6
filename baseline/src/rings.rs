//! The paper's three ways from two readings to the pole pair, as printed but for the errors in print: what the fast
//! path of [`hallservo::vernier::decode`] is tested against and what it is measured by.
//!
//! Codes here are those of the heads, 0 to N − 1 with N = 2^bits, and so are distances; k counts from 0.

use hallservo::vernier::rings::{Ring, Rings};

/// What one of the paper's methods found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// Pole pair of the reference ring, from 0.
    pub pole_pair: u8,
    /// Distance of the vernier's code from the value that fits best, in counts and wrapped to half a pole pair.
    pub distance: i32,
}

impl Found {
    /// The absolute position in counts of the reference ring, 0 to pp·N − 1: eq. (4) and (9) before the division by
    /// pp·N that makes turns of it.
    pub fn position(&self, rings: &Rings, reference: u16) -> u32 {
        (u32::from(self.pole_pair) << rings.bits()) + u32::from(reference)
    }
}

/// The code the vernier ring shows at a position in counts of the reference ring, 0 to pp·N − 1: eq. (2), corrected to
/// X = mod(r₂/r₁ · (x + k N)) with one turn of pp·N counts. r₂/r₁ is the ratio of the pole-pair counts. Rounded.
fn vernier_code(rings: &Rings, position: u32) -> u16 {
    let p = u32::from(rings.pole_pairs(Ring::Reference));
    let q = u32::from(rings.pole_pairs(Ring::Vernier));
    let code = (position * q + p / 2) / p;
    code as u16 & mask(rings)
}

/// First method: a table of every value pair of a turn, made off-line.
///
/// The codes of the reference ring recur every N entries, so that its code is the place in the table and need not be
/// stored; pp·N codes of the vernier ring remain (296 KiB for 37 pole pairs at 12 bit).
pub struct PairTable<'a> {
    rings: Rings,
    codes: &'a [u16],
}

impl<'a> PairTable<'a> {
    /// Fills `storage`, of which pp·N words are needed; `None` if there are fewer.
    pub fn new(rings: Rings, storage: &'a mut [u16]) -> Option<Self> {
        let length = usize::from(rings.pole_pairs(Ring::Reference)) << rings.bits();
        let codes = storage.get_mut(..length)?;
        for (position, code) in codes.iter_mut().enumerate() {
            *code = vernier_code(&rings, position as u32);
        }
        Some(Self { rings, codes })
    }

    /// Searches the pairs with the reference code `x` for the vernier code nearest to `y`.
    pub fn decode(&self, x: u16, y: u16) -> Found {
        let same_reference = self.codes.iter().skip(usize::from(x & mask(&self.rings))).step_by(1 << self.rings.bits());
        nearest(&self.rings, same_reference.copied(), y)
    }
}

/// Second method, eq. (3): computes for each pole pair what the vernier would show, and searches that.
pub fn decode_by_search(rings: &Rings, x: u16, y: u16) -> Found {
    let positions =
        (0..rings.pole_pairs(Ring::Reference)).map(|k| (u32::from(k) << rings.bits()) + u32::from(x & mask(rings)));
    nearest(rings, positions.map(|position| vernier_code(rings, position)), y)
}

/// The combined method: a table of what the vernier shows at the pp zeros of the reference.
pub struct ZeroTable {
    rings: Rings,
    codes: [u16; 64],
}

impl ZeroTable {
    /// The codes for ideal rings.
    pub fn new(rings: Rings) -> Self {
        let mut codes = [0; 64];
        for (k, code) in codes.iter_mut().take(rings.pole_pairs(Ring::Reference).into()).enumerate() {
            *code = vernier_code(&rings, (k as u32) << rings.bits());
        }
        Self { rings, codes }
    }

    /// Eq. (5) to (8): carries the vernier back to where the reference showed 0, z = mod(y − r₂/r₁ · x), and searches
    /// the table.
    pub fn decode(&self, x: u16, y: u16) -> Found {
        let z = y.wrapping_sub(vernier_code(&self.rings, u32::from(x & mask(&self.rings))));
        let zeros = self.codes.iter().take(self.rings.pole_pairs(Ring::Reference).into());
        nearest(&self.rings, zeros.copied(), z)
    }
}

fn mask(rings: &Rings) -> u16 {
    u16::MAX >> (16 - rings.bits())
}

/// The entry nearest to `code` on the circle of N counts.
fn nearest(rings: &Rings, entries: impl Iterator<Item = u16>, code: u16) -> Found {
    let shift = 16 - u32::from(rings.bits());
    let mut best = Found { pole_pair: 0, distance: i32::MAX };
    for (k, entry) in entries.enumerate() {
        let distance = i32::from((code.wrapping_sub(entry) << shift) as i16) >> shift;
        if distance.abs() < best.distance.abs() {
            best = Found { pole_pair: k as u8, distance };
        }
    }
    best
}
