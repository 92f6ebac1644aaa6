//! The table of the cogging as a record.

#[cfg(not(feature = "small"))]
use crate::control::cogging::by_pole::{WAVES, Wave, Waves};
use crate::control::cogging::{POINTS, Table};

/// Version of the form below, for [`super::Store::new`].
pub const VERSION: u16 = 0x0201;
/// Bytes of the record, without what differs from pole to pole.
pub const LENGTH: usize = 4 + 2 * POINTS;
/// Bytes of an order of what does, behind it.
#[cfg(not(feature = "small"))]
const WAVE: usize = 5;
/// Most bytes of a record.
#[cfg(not(feature = "small"))]
pub const LONGEST: usize = LENGTH + WAVE * WAVES;
/// Most bytes of a record.
#[cfg(feature = "small")]
pub const LONGEST: usize = LENGTH;

/// The record of a table: little endian, the full scale of the currents in amperes, then the points.
pub fn encode(table: &Table, full_scale_a: f32) -> [u8; LENGTH] {
    let mut record = [0; LENGTH];
    let (scale, points) = record.split_at_mut(4);
    scale.copy_from_slice(&full_scale_a.to_le_bytes());
    for (place, point) in points.chunks_exact_mut(2).zip(table.0) {
        place.copy_from_slice(&point.to_le_bytes());
    }
    record
}

/// The table of a record, for a drive whose full scale of the currents may be another by now. `None` where the length
/// is not one that [`encode`] writes, either full scale is none, or the currents are beyond the new one.
pub fn decode(record: &[u8], full_scale_a: f32) -> Option<Table> {
    #[cfg(not(feature = "small"))]
    let (record, _) = split(record)?;
    let record: &[u8; LENGTH] = record.try_into().ok()?;
    let (scale, points) = record.split_at(4);
    let ratio = ratio(scale, full_scale_a)?;
    let mut table = Table::ZERO;
    for (point, bytes) in table.0.iter_mut().zip(points.chunks_exact(2)) {
        let value = crate::float::nearest(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])) * ratio);
        if value.unsigned_abs() > i16::MAX as u32 {
            return None;
        }
        *point = value as i16;
    }
    Some(table)
}

/// By how much more a current is in units of the present full scale.
fn ratio(stored: &[u8], full_scale_a: f32) -> Option<f32> {
    let stored_a = f32::from_le_bytes(stored.try_into().ok()?);
    let ratio = stored_a / full_scale_a;
    (stored_a > 0.0 && full_scale_a > 0.0 && ratio.is_finite()).then_some(ratio)
}

/// What differs from pole to pole is behind the table.
#[cfg(not(feature = "small"))]
fn split(record: &[u8]) -> Option<(&[u8], &[u8])> {
    let (table, waves) = record.split_at_checked(LENGTH)?;
    (waves.len().is_multiple_of(WAVE) && waves.len() <= WAVE * WAVES).then_some((table, waves))
}

/// The same with what differs from pole to pole: of each order its number, sine and cosine.
#[cfg(not(feature = "small"))]
pub fn encode_with<'a>(table: &Table, by_pole: &Waves, full_scale_a: f32, place: &'a mut [u8; LONGEST]) -> &'a [u8] {
    place[..LENGTH].copy_from_slice(&encode(table, full_scale_a));
    let mut length = LENGTH;
    for (place, wave) in place[LENGTH..].chunks_exact_mut(WAVE).zip(by_pole.iter()) {
        place[0] = wave.order;
        place[1..3].copy_from_slice(&wave.sine.to_le_bytes());
        place[3..5].copy_from_slice(&wave.cosine.to_le_bytes());
        length += WAVE;
    }
    place.get(..length).unwrap_or(&[])
}

/// What of a record differs from pole to pole; none where [`decode`] finds no table.
#[cfg(not(feature = "small"))]
pub fn decode_by_pole(record: &[u8], full_scale_a: f32) -> Option<Waves> {
    let (table, waves) = split(record)?;
    let wave = |bytes: &[u8]| {
        let part = |at: usize| i16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Wave { order: bytes[0], sine: part(1), cosine: part(3) }
    };
    let waves = Waves::of(waves.chunks_exact(WAVE).map(wave).filter(|wave| wave.order > 0));
    waves.scaled(ratio(table.get(..4)?, full_scale_a)?)
}
