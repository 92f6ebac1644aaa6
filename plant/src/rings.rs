//! Two magnetised rings on one shaft and the heads over them, by exact geometry.
//!
//! Lengths in millimetres, angles in radians; an electrical angle is one of a pole pair. The field a head sees depends
//! on where the head stands on the ring, and that on the shaft angle, on where the head is mounted, and on how far the
//! ring's centre is off the axis (Bakos et al., eq. (10)).

use core::f64::consts::{PI, TAU};
use libm::{atan2, cos, floor, round, sin};

/// Pole pairs of the largest ring.
pub const MAX_POLE_PAIRS: usize = 64;

/// A ring of pole pairs of equal length but for what is said here.
#[derive(Clone, Debug)]
pub struct Ring {
    /// Number of pole pairs, up to 64.
    pub pole_pairs: usize,
    /// Radius of the circle over which the heads stand.
    pub radius_mm: f64,
    /// Distance of the ring's centre from the axis.
    pub eccentricity_mm: f64,
    /// Direction of that distance at shaft angle zero.
    pub eccentricity_direction_rad: f64,
    /// Amplitude and phase of the first to fourth harmonic of the electrical angle that the magnetisation shows too
    /// much.
    pub harmonics_rad: [(f64, f64); 4],
    /// Electrical angle by which the begin of each pole pair is displaced.
    pub displacements_rad: [f64; MAX_POLE_PAIRS],
    /// Strength of the field, 1 as built.
    pub strength: f64,
}

impl Ring {
    /// A perfect ring of the given pole pairs, each `pole_pair_length_mm` long.
    pub fn new(pole_pairs: usize, pole_pair_length_mm: f64) -> Self {
        Self {
            pole_pairs,
            radius_mm: pole_pairs as f64 * pole_pair_length_mm / TAU,
            eccentricity_mm: 0.0,
            eccentricity_direction_rad: 0.0,
            harmonics_rad: [(0.0, 0.0); 4],
            displacements_rad: [0.0; MAX_POLE_PAIRS],
            strength: 1.0,
        }
    }

    /// The place on the ring over which a head stands that is mounted at the angle `mounted_rad`, with the shaft at
    /// `shaft_rad`: the angle from the ring's zero to the head, seen from the ring's centre. Between −π and π.
    pub fn angle_under(&self, mounted_rad: f64, shaft_rad: f64) -> f64 {
        // In axes that turn with the ring the head moves backwards, and the centre stands still.
        let x =
            self.radius_mm * cos(shaft_rad - mounted_rad) + self.eccentricity_mm * cos(self.eccentricity_direction_rad);
        let y =
            self.radius_mm * sin(shaft_rad - mounted_rad) + self.eccentricity_mm * sin(self.eccentricity_direction_rad);
        atan2(y, x)
    }

    /// The electrical angle that the field shows at a place on the ring, over all pole pairs of a turn.
    pub fn field_angle(&self, place: f64) -> f64 {
        let electrical = place * self.pole_pairs as f64;
        let turns = electrical / TAU;
        let pair = floor(turns);
        let within = turns - pair;
        let displaced = |pair: f64| {
            let count = self.pole_pairs as f64;
            self.displacements_rad[(pair - count * floor(pair / count)) as usize]
        };
        let mut angle = electrical + displaced(pair) * (1.0 - within) + displaced(pair + 1.0) * within;
        for (order, (amplitude, phase)) in (1..).zip(self.harmonics_rad) {
            if amplitude != 0.0 {
                angle += amplitude * sin(f64::from(order) * electrical + phase);
            }
        }
        angle
    }
}

/// A head: where it is mounted, and what its electronics make of the field.
#[derive(Clone, Debug)]
pub struct Head {
    /// Angle at which it should be mounted.
    pub mounted_rad: f64,
    /// Mounting angle for which its zero is set: it shows zero there with the shaft at zero.
    pub zero_rad: f64,
    /// Angle by which it is mounted further.
    pub misplaced_rad: f64,
    /// Offset of sine and cosine output in codes.
    pub offsets: [f64; 2],
    /// Amplitude of sine and cosine output in codes at the field strength 1.
    pub amplitudes: [f64; 2],
    /// Bits of the converter, or of the reading of a head that gives angles.
    pub bits: u32,
}

impl Head {
    /// A head without errors, whose outputs use 3/4 of the converter's range.
    pub fn new(mounted_rad: f64, bits: u32) -> Self {
        let half = f64::from(1_u32 << (bits - 1));
        Self {
            mounted_rad,
            zero_rad: mounted_rad,
            misplaced_rad: 0.0,
            offsets: [half; 2],
            amplitudes: [0.75 * half; 2],
            bits,
        }
    }

    /// A head like this one on the opposite side of the shaft, misplaced by an angle; its zero is not moved.
    pub fn opposite(&self, misplaced_rad: f64) -> Self {
        Self { mounted_rad: self.mounted_rad + PI, misplaced_rad, ..self.clone() }
    }

    /// The electrical angle of the ring under the head, zero where the shaft is at zero and nothing is wrong.
    pub fn electrical(&self, ring: &Ring, shaft_rad: f64) -> f64 {
        let place = ring.angle_under(self.mounted_rad + self.misplaced_rad, shaft_rad);
        ring.field_angle(place) + self.zero_rad * ring.pole_pairs as f64
    }

    /// The reading of a head that gives angles: `noise` codes are added before it is rounded down.
    pub fn digital(&self, ring: &Ring, shaft_rad: f64, noise: f64) -> u16 {
        let counts = f64::from(1_u32 << self.bits);
        let code = floor(self.electrical(ring, shaft_rad) / TAU * counts + noise);
        (code - counts * floor(code / counts)) as u16
    }

    /// The codes of sine and cosine, each with its noise in codes, rounded, and cut at the ends of the range.
    pub fn analog(&self, ring: &Ring, shaft_rad: f64, noise: [f64; 2]) -> [u16; 2] {
        let electrical = self.electrical(ring, shaft_rad);
        let field = [sin(electrical), cos(electrical)];
        let full_scale = f64::from((1_u32 << self.bits) - 1);
        core::array::from_fn(|channel| {
            let swing = self.amplitudes[channel] * ring.strength * field[channel];
            round(self.offsets[channel] + swing + noise[channel]).clamp(0.0, full_scale) as u16
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(angle: f64) -> f64 {
        angle - TAU * round(angle / TAU)
    }

    #[test]
    fn a_perfect_ring_shows_the_shaft_angle() {
        let ring = Ring::new(37, 2.0);
        assert!((ring.radius_mm - 11.777).abs() < 1e-3);
        for mounted in [0.0, 0.7, PI] {
            let head = Head::new(mounted, 12);
            for step in 0..1000 {
                let shaft = f64::from(step) * TAU / 1000.0;
                assert!(near(head.electrical(&ring, shaft) - 37.0 * shaft).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn an_eccentric_ring_errs_by_the_ratio_of_eccentricity_and_radius() {
        let ring = Ring { radius_mm: 14.0, eccentricity_mm: 0.05, ..Ring::new(45, 2.0) };
        let worst = (0..3600)
            .map(|step| f64::from(step) * TAU / 3600.0)
            .map(|shaft| near(ring.angle_under(0.0, shaft) - shaft).abs())
            .fold(0.0, f64::max);
        assert!((worst.to_degrees() - 0.2046).abs() < 1e-4);
        // At zero, ring centre, axis and head are in line.
        assert_eq!(ring.angle_under(0.0, 0.0), 0.0);
    }

    #[test]
    fn displaced_pole_pairs_join() {
        let mut ring = Ring::new(5, 2.0);
        ring.displacements_rad[2] = 0.1;
        let at = |turns: f64| ring.field_angle(turns * TAU / 5.0) - turns * TAU;
        for (turns, expected) in [(1.0, 0.0), (1.5, 0.05), (2.0, 0.1), (2.75, 0.025), (-3.0, 0.1), (7.0, 0.1)] {
            assert!((at(turns) - expected).abs() < 1e-9, "{turns}");
        }
    }

    #[test]
    fn codes_are_cut_at_the_ends_of_the_range() {
        let ring = Ring { strength: 2.0, ..Ring::new(3, 2.0) };
        let head = Head::new(0.0, 12);
        assert_eq!(head.analog(&ring, 0.0, [0.0; 2]), [2048, 4095]);
        assert_eq!(head.analog(&ring, PI / 3.0, [0.0; 2])[1], 0);
    }

    #[test]
    fn digital_heads_wrap() {
        let ring = Ring::new(4, 2.0);
        let head = Head::new(0.0, 8);
        assert_eq!(head.digital(&ring, 0.0, -0.5), 255);
        assert_eq!(head.digital(&ring, TAU / 8.0, 0.5), 128);
        assert_eq!(head.digital(&ring, TAU / 4.0 - 1e-9, 0.0), 255);
    }
}
