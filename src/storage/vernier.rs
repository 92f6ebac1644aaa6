//! What is known of an encoder as a record: settings, calibration, how it is mounted, the zero.

use crate::angle::{ElectricalAngle, MechanicalAngle};
use crate::vernier::correct::{Curve, NODES};
use crate::vernier::encoder::{Calibration, Encoder};
use crate::vernier::fit::Fitted;
use crate::vernier::rings::Ring;
use crate::vernier::settings::Settings;

/// Version of the form below, for [`super::Store::new`].
pub const VERSION: u16 = 0x0401;
/// Bytes of a head's curve.
const CURVE: usize = 4 + 2 * NODES;
/// Bytes of all that does not depend on the heads: what is set, zero and mounting, averages, limits.
const COMMON: usize = 12 + 4 + 4 + 128 + 6;
/// Most bytes of the record: that of two heads a ring.
pub const LONGEST: usize = COMMON + 4 * CURVE;

/// What is known of an encoder.
#[derive(Clone, Debug, PartialEq)]
pub struct Known<const HEADS: usize> {
    /// As set.
    pub settings: Settings,
    /// As calibrated, or not at all.
    pub calibration: Option<Calibration<HEADS>>,
    /// How it sits on the rotor's shaft, if there is a motor.
    pub fitted: Option<Fitted>,
    /// What it shows where a person has set the zero.
    pub zero: MechanicalAngle,
}

impl<const HEADS: usize> Default for Known<HEADS> {
    fn default() -> Self {
        Self { settings: Settings::default(), calibration: None, fitted: None, zero: MechanicalAngle::ZERO }
    }
}

/// Bits of the second byte of the record.
const CLOSES_LOOPS: u8 = 1;
const FALLS_BACK: u8 = 2;
const CALIBRATED: u8 = 4;
const FITTED: u8 = 8;
const REVERSED: u8 = 16;

/// Puts bytes one after the other.
struct Writer<'a> {
    place: &'a mut [u8],
    length: usize,
}

impl Writer<'_> {
    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        if let Some(place) = self.place.get_mut(self.length..self.length + N) {
            place.copy_from_slice(&bytes);
        }
        self.length += N;
    }

    fn bits(&mut self, angle: i32) {
        self.put(angle.to_le_bytes());
    }
}

/// Takes them again.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*bytes)
    }

    fn angle(&mut self) -> Option<i32> {
        self.take().map(i32::from_le_bytes)
    }

    fn number(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }

    fn short(&mut self) -> Option<i16> {
        self.take().map(i16::from_le_bytes)
    }
}

/// The record, little endian, and its length: heads, flags, rings, head angle, pole length; zero, offset; the curves, the
/// averages and the limits. What is not known is not written.
pub fn encode<const HEADS: usize>(known: &Known<HEADS>) -> ([u8; LONGEST], usize) {
    let Known { settings, calibration, fitted, zero } = known;
    let mut record = [0; LONGEST];
    let mut writer = Writer { place: &mut record, length: 0 };
    let flag = |set: bool, flag: u8| if set { flag } else { 0 };
    let flags = flag(settings.closes_loops, CLOSES_LOOPS)
        | flag(settings.falls_back, FALLS_BACK)
        | flag(calibration.is_some(), CALIBRATED)
        | flag(fitted.is_some(), FITTED)
        | flag(fitted.is_some_and(|fitted| fitted.reversed), REVERSED);
    writer.put([HEADS as u8, flags, settings.reference_pairs, settings.vernier_pairs]);
    writer.put(settings.head_angle_deg.to_le_bytes());
    writer.put(settings.pole_pair_mm.to_le_bytes());
    writer.bits(zero.to_bits());
    writer.bits(fitted.map_or(0, |fitted| fitted.offset.to_bits()));
    if let Some(calibration) = calibration {
        for curve in calibration.reference.iter().chain(&calibration.vernier) {
            writer.bits(curve.phase.to_bits());
            curve.errors.iter().for_each(|error| writer.put(error.to_le_bytes()));
        }
        calibration.averages.iter().for_each(|average| writer.put(average.to_le_bytes()));
        writer.put(calibration.residual_limit.to_le_bytes());
        calibration.head_distance_limits.iter().for_each(|limit| writer.put(limit.to_le_bytes()));
    }
    let length = writer.length;
    (record, length)
}

/// What a record says; `None` where it is not one that [`encode`] writes for so many heads, or says what cannot be.
pub fn decode<const HEADS: usize>(record: &[u8]) -> Option<Known<HEADS>> {
    let mut reader = Reader(record);
    let [heads, flags, reference_pairs, vernier_pairs] = reader.take()?;
    if usize::from(heads) != HEADS {
        return None;
    }
    let settings = Settings {
        reference_pairs,
        vernier_pairs,
        head_angle_deg: reader.number().filter(|angle| angle.is_finite())?,
        pole_pair_mm: reader.number().filter(|length| length.is_finite() && *length > 0.0)?,
        closes_loops: flags & CLOSES_LOOPS != 0,
        falls_back: flags & FALLS_BACK != 0,
    };
    let rings = settings.rings(16).ok()?;
    let zero = MechanicalAngle::from_bits(reader.angle()?);
    let offset = ElectricalAngle::from_bits(reader.angle()?);
    let fitted = (flags & FITTED != 0).then_some(Fitted { reversed: flags & REVERSED != 0, offset });
    let calibration = if flags & CALIBRATED != 0 {
        let mut calibration = Calibration::<HEADS>::ideal(&rings);
        for ring in [Ring::Reference, Ring::Vernier] {
            for curve in calibration.curves_mut(ring) {
                *curve = read_curve(&mut reader)?;
            }
        }
        for average in &mut calibration.averages {
            *average = reader.short()?;
        }
        calibration.residual_limit = u16::from_le_bytes(reader.take()?);
        for limit in &mut calibration.head_distance_limits {
            *limit = u16::from_le_bytes(reader.take()?);
        }
        // Whether its limits are possible ones.
        Encoder::new(&rings, &calibration, MechanicalAngle::from_bits(1)).ok()?;
        Some(calibration)
    } else {
        None
    };
    reader.0.is_empty().then_some(Known { settings, calibration, fitted, zero })
}

fn read_curve(reader: &mut Reader<'_>) -> Option<Curve> {
    let mut curve = Curve::shifted(ElectricalAngle::from_bits(reader.angle()?));
    for error in &mut curve.errors {
        *error = reader.short()?;
    }
    Some(curve)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn known<const HEADS: usize>(seed: u64) -> Known<HEADS> {
        let mut random = Pcg64::seed_from_u64(seed);
        let settings = Settings { falls_back: random.random(), closes_loops: random.random(), ..Settings::default() };
        let mut calibration = Calibration::ideal(&settings.rings(12).unwrap());
        for ring in [Ring::Reference, Ring::Vernier] {
            for curve in calibration.curves_mut(ring) {
                curve.errors = core::array::from_fn(|_| random.random());
                curve.phase = ElectricalAngle::from_bits(random.random());
            }
        }
        calibration.averages = core::array::from_fn(|_| random.random());
        calibration.residual_limit = random.random_range(1..=Calibration::<HEADS>::RESIDUAL_LIMIT);
        let fitted = Fitted { reversed: random.random(), offset: ElectricalAngle::from_bits(random.random()) };
        let zero = MechanicalAngle::from_bits(random.random());
        Known { settings, calibration: Some(calibration), fitted: Some(fitted), zero }
    }

    #[test]
    fn what_is_written_is_read() {
        for seed in 0..50 {
            let one = known::<1>(seed);
            let (record, length) = encode(&one);
            assert_eq!(decode(&record[..length]), Some(one));
            let two = known::<2>(seed);
            let (record, length) = encode(&two);
            assert_eq!(length, LONGEST);
            assert_eq!(decode(&record[..length]).as_ref(), Some(&two));
            let bare = Known { calibration: None, fitted: None, ..two };
            let (record, length) = encode(&bare);
            assert_eq!(decode(&record[..length]), Some(bare));
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let (record, length) = encode(&known::<2>(1));
        assert_eq!(decode::<1>(&record[..length]), None);
        for shorter in 0..length {
            assert_eq!(decode::<2>(&record[..shorter]), None, "{shorter}");
        }
        // Rings with a common divisor, limits beyond what can be told.
        let mut wrong = record;
        wrong[2] = 36;
        assert_eq!(decode::<2>(&wrong[..length]), None);
        let mut wrong = record;
        wrong[length - 6..length - 4].copy_from_slice(&u16::MAX.to_le_bytes());
        assert_eq!(decode::<2>(&wrong[..length]), None);
        // Any bytes at all.
        let mut random = Pcg64::seed_from_u64(7);
        for _ in 0..10_000 {
            let mut noise = record;
            noise[..24].fill_with(|| random.random());
            let _ = decode::<2>(&noise[..length]);
        }
    }
}
