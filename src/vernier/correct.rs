//! What the heads' nonlinearity does to a reading, undone, and opposite heads averaged.
//!
//! A head indicates its place in the pole pair with an error that repeats with every pole pair: the field is no pure
//! sine, offset, gain and quadrature of the head are not perfect (section IV.B). [`Curve`] is that error as measured,
//! [`Linearity`] the table made of it, which the interrupt interpolates.

use crate::angle::ElectricalAngle;
use crate::trig::Segment;

/// log₂ of the number of nodes of a curve.
const NODE_BITS: u32 = 5;

/// Nodes of a curve over one pole pair. Between them lines are good: the second harmonic of an error of 2° is
/// followed to 0.05° electrical.
pub const NODES: usize = 1 << NODE_BITS;

/// Bits of a reading below the node number.
const OFFSET_BITS: u32 = 16 - NODE_BITS;

/// What a head indicates too much, over one pole pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Curve {
    /// The part that repeats with every pole pair, in 2⁻¹⁶ pole pairs, at the readings k/32. Its mean belongs to
    /// `phase`.
    pub errors: [i16; NODES],
    /// The constant part, in pole pairs: where the head stands and where its zero is.
    pub phase: ElectricalAngle,
}

impl Curve {
    /// A perfect head with its zero elsewhere.
    pub const fn shifted(phase: ElectricalAngle) -> Self {
        Self { errors: [0; NODES], phase }
    }

    /// The reading without its error, as [`Linearity::correct`] gives it, without the table.
    pub const fn correct(&self, reading: u16) -> u16 {
        corrected(self.segment((reading >> OFFSET_BITS) as usize), reading)
    }

    /// The line between a node and the next, from the reading to the place.
    const fn segment(&self, node: usize) -> Segment {
        let begin = (node as u32) << (32 - NODE_BITS);
        let end = begin.wrapping_add(1 << (32 - NODE_BITS));
        let mut segment = Segment::through(
            (begin as i32).wrapping_sub(self.error(node)),
            (end as i32).wrapping_sub(self.error((node + 1) % NODES)),
            OFFSET_BITS,
        );
        // The result is cut to 16 bits: half a bit more makes that a rounding.
        segment.start = segment.start.wrapping_add(1 << 15);
        segment
    }

    /// The error at a node, constant part included.
    const fn error(&self, node: usize) -> i32 {
        ((self.errors[node] as i32) << 16).wrapping_add(self.phase.to_bits())
    }
}

#[inline(always)]
const fn corrected(segment: Segment, reading: u16) -> u16 {
    (segment.at(reading as u32 & ((1 << OFFSET_BITS) - 1)) as u32 >> 16) as u16
}

/// A curve as the interrupt uses it: reading in, true place in the pole pair out; 256 bytes.
#[derive(Clone, Copy, Debug)]
pub struct Linearity([Segment; NODES]);

impl Linearity {
    /// The table that undoes `curve`.
    pub const fn new(curve: &Curve) -> Self {
        let mut table = [Segment { start: 0, slope: 0 }; NODES];
        let mut node = 0;
        while node < NODES {
            table[node] = curve.segment(node);
            node += 1;
        }
        Self(table)
    }

    /// The reading without its error, wrapped; interpolated between the nodes and rounded to 2⁻¹⁶ pole pairs.
    #[inline(always)]
    pub const fn correct(&self, reading: u16) -> u16 {
        corrected(self.0[(reading >> OFFSET_BITS) as usize], reading)
    }
}

/// The readings of a ring's heads without their errors.
pub(super) fn correct_heads<const HEADS: usize>(curves: &[Curve; HEADS], readings: [u16; HEADS]) -> [u16; HEADS] {
    core::array::from_fn(|head| curves[head].correct(readings[head]))
}

/// The mean of the heads of one ring, their readings corrected to the same zero, and how far they are apart.
///
/// The mean is taken from the first head along the shorter way round, so that readings on either side of the wrap
/// average to what lies between them; heads must be less than half a pole pair apart. The second value is the largest
/// distance of a head from the first, 0 to 2¹⁵, in 2⁻¹⁶ pole pairs. One head is its own mean, at distance 0.
///
/// # Panics
/// Does not compile without heads.
#[inline(always)]
pub fn mean<const HEADS: usize>(readings: [u16; HEADS]) -> (u16, u16) {
    const { assert!(HEADS > 0) };
    let first = readings[0];
    let (mut sum, mut distance) = (0, 0);
    for reading in &readings[1..] {
        let apart = reading.wrapping_sub(first) as i16;
        sum += i32::from(apart);
        distance = distance.max(apart.unsigned_abs());
    }
    (first.wrapping_add((sum / HEADS as i32) as u16), distance)
}

/// To the nearest integer, saturated. Kept out of line: the loops it is called from are unrolled.
#[inline(never)]
pub(super) fn round(value: f32) -> i16 {
    libm::roundf(value) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    /// Error curve of 2° first and second harmonic, in pole pairs.
    fn error(place: f64) -> f64 {
        let amplitude = 2.0 / 360.0;
        amplitude * (libm::sin(TAU * place + 0.4) + libm::sin(2.0 * TAU * place + 1.3))
    }

    #[test]
    fn a_curve_is_undone_to_five_hundredths_of_a_degree() {
        let mut curve = Curve::shifted(ElectricalAngle::from_degrees(77.0));
        for (node, value) in curve.errors.iter_mut().enumerate() {
            // The curve is a function of the reading, as it is measured.
            *value = libm::round(error(node as f64 / NODES as f64) * 65536.0) as i16;
        }
        let table = Linearity::new(&curve);
        let mut worst = 0.0_f64;
        for reading in 0..=u16::MAX {
            let place = f64::from(reading) / 65536.0;
            let truth = place - error(place) - 77.0 / 360.0;
            assert_eq!(table.correct(reading), curve.correct(reading));
            let corrected = f64::from(table.correct(reading)) / 65536.0;
            let difference = corrected - truth;
            worst = worst.max((difference - libm::round(difference)).abs() * 360.0);
        }
        assert!(worst < 0.05, "{worst}");
        assert!(worst > 0.02, "{worst}");
    }

    #[test]
    fn a_perfect_head_is_left_alone() {
        let table = Linearity::new(&Curve::shifted(ElectricalAngle::ZERO));
        assert!((0..=u16::MAX).all(|reading| table.correct(reading) == reading));
    }

    #[test]
    fn heads_average_across_the_wrap() {
        for first in (0..=u16::MAX).step_by(7) {
            for apart in (-32767..=32767_i32).step_by(1111) {
                let second = first.wrapping_add(apart as u16);
                let (mean, distance) = mean([first, second]);
                assert_eq!(mean, first.wrapping_add((apart / 2) as u16));
                assert_eq!(i32::from(distance), apart.abs());
            }
        }
        assert_eq!(mean([9]), (9, 0));
        assert_eq!(mean([65530, 4, 65534]).0, 65530 + (10 + 4) / 3);
    }
}
