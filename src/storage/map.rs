//! The map of a rotor's magnets as a record.

use super::calibration;
use crate::angle::PolePairs;
use crate::crc::crc32;
use crate::hall::map::{LONGEST_SIGNATURE, Map, Signature};
use crate::hall::model::Model;
use crate::turn::POINTS;

/// Version of the form below, for [`super::Store::new`].
pub const VERSION: u16 = 0x0501;
/// Most bytes of a record.
pub const LONGEST: usize = HEADER + 2 * POINTS + LONGEST_SIGNATURE;
const HEADER: usize = 12;

/// A map that was learnt, and of what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// The map.
    pub map: Map,
    /// By which its pole is found at any speed. Records of before have none.
    pub signature: Option<Signature>,
    /// What it leaves over of single samples, degrees RMS: their noise.
    pub noise_deg: f32,
    /// The calibration that it was learnt with: [`fingerprint`].
    pub calibration: u32,
    /// Whether the angle counted as with `reversed` in the settings.
    pub reversed: bool,
}

impl Known {
    /// For an angle that counts the way the settings say.
    pub fn direct(&mut self, reversed: bool) {
        if self.reversed != reversed {
            let signature = self.signature.as_ref().map(Signature::reversed);
            *self = Self { map: self.map.reversed(), signature, reversed, ..*self };
        }
    }
}

/// Tells calibrations apart. A map is what a calibration does not know of a rotor, and of no use with another one.
pub fn fingerprint(calibrated: &Model) -> u32 {
    crc32(&calibration::encode(&Model { reversed: false, ..*calibrated }))
}

/// Writes the record of a map, little endian: pole pairs, whether it is reversed, the number of points, what it leaves
/// over, the calibration's fingerprint, the points, the signature's values if there is one.
pub fn encode<'a>(known: &Known, place: &'a mut [u8; LONGEST]) -> &'a [u8] {
    let points = known.map.points();
    place[0] = known.map.pole_pairs();
    place[1] = known.reversed.into();
    place[2..4].copy_from_slice(&(points.len() as u16).to_le_bytes());
    place[4..8].copy_from_slice(&known.noise_deg.to_le_bytes());
    place[8..12].copy_from_slice(&known.calibration.to_le_bytes());
    for (place, point) in place[HEADER..].chunks_exact_mut(2).zip(points) {
        place.copy_from_slice(&point.to_le_bytes());
    }
    let signature = known.signature.as_ref().map(Signature::values).unwrap_or_default();
    let end = HEADER + 2 * points.len();
    place[end..].iter_mut().zip(signature).for_each(|(place, value)| *place = value.to_le_bytes()[0]);
    place.get(..end + signature.len()).unwrap_or(&[])
}

/// The map of a record. `None` where the length or a value is not one that [`encode`] writes.
pub fn decode(record: &[u8]) -> Option<Known> {
    let (header, rest) = record.split_first_chunk::<HEADER>()?;
    let pole_pairs = PolePairs::new(header[0])?;
    let reversed = match header[1] {
        0 => false,
        1 => true,
        _ => return None,
    };
    let count = usize::from(u16::from_le_bytes([header[2], header[3]]));
    let noise_deg = f32::from_le_bytes([header[4], header[5], header[6], header[7]]);
    let (points, values) = rest.split_at_checked(2 * count)?;
    if !(0.0..180.0).contains(&noise_deg) {
        return None;
    }
    let calibration = u32::from_le_bytes([header[8], header[9], header[10], header[11]]);
    let map = Map::of_points(pole_pairs, points.chunks_exact(2).map(|point| i16::from_le_bytes([point[0], point[1]])))?;
    let signature = if values.is_empty() { None } else { Some(Signature::of_bytes(pole_pairs, values)?) };
    Some(Known { map, signature, noise_deg, calibration, reversed })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::ElectricalAngle;
    use crate::hall::model::Sensor;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn known(seed: u64) -> Known {
        let mut random = Pcg64::seed_from_u64(seed);
        let pole_pairs = PolePairs::new(random.random_range(1..=64)).unwrap();
        let map = Map::of_points(pole_pairs, (0..Map::points_for(pole_pairs)).map(|_| random.random())).unwrap();
        let mut values = [0; LONGEST_SIGNATURE];
        values.fill_with(|| random.random());
        let signature = (0..=values.len()).find_map(|length| Signature::of_bytes(pole_pairs, &values[..length]));
        let (calibration, reversed) = (random.random(), random.random());
        Known { map, signature, noise_deg: random.random_range(0.0..2.0), calibration, reversed }
    }

    #[test]
    fn what_is_written_is_read_and_nothing_else() {
        for seed in 0..100 {
            let known = known(seed);
            let mut place = [0; LONGEST];
            let record = encode(&known, &mut place);
            assert_eq!(decode(record), Some(known));
            // As before there were signatures.
            let bare = HEADER + 2 * known.map.points().len();
            for shorter in 0..record.len() {
                let left = if shorter == bare { Some(Known { signature: None, ..known }) } else { None };
                assert_eq!(decode(&record[..shorter]), left);
            }
            assert_eq!([record.len() > bare, known.map.pole_pairs() <= 44], [known.signature.is_some(); 2]);
            for noise_deg in [-0.1, 180.0, f32::INFINITY] {
                assert_eq!(decode(encode(&Known { noise_deg, ..known }, &mut place)), None, "{noise_deg}");
            }
            let record = encode(&known, &mut place);
            // Of other pole pairs, a direction that is none, no number.
            let count = record[2];
            for (at, byte) in [(0, 0), (0, 65), (1, 2), (2, count ^ 1), (7, 0xff)] {
                let (mut wrong, length) = (place, encode(&known, &mut place).len());
                wrong[at] = byte;
                assert_eq!(decode(&wrong[..length]), None, "{at}");
            }
        }
        let mut random = Pcg64::seed_from_u64(7);
        for length in 0..LONGEST {
            let mut noise = [0; LONGEST];
            noise.fill_with(|| random.random());
            let _ = decode(&noise[..length]);
        }
    }

    #[test]
    fn the_fingerprint_is_that_of_a_calibration_in_either_direction() {
        let sensor = Sensor::sinusoidal(2048.0, 500.0, ElectricalAngle::ZERO);
        let model = Model { sensors: [sensor; 3], alignment: ElectricalAngle::ZERO, reversed: false };
        assert_eq!(fingerprint(&model), fingerprint(&Model { reversed: !model.reversed, ..model }));
        let mut other = model;
        other.sensors[1].third += 1e-6;
        assert_ne!(fingerprint(&model), fingerprint(&other));
    }
}
