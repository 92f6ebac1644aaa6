//! The table of the cogging as a record.

use crate::control::cogging::{POINTS, Table};

/// Version of the form below, for [`super::Store::new`].
pub const VERSION: u16 = 0x0201;
/// Bytes of the record.
pub const LENGTH: usize = 4 + 2 * POINTS;

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
    let record: &[u8; LENGTH] = record.try_into().ok()?;
    let (scale, points) = record.split_at(4);
    let stored_a = f32::from_le_bytes(scale.try_into().ok()?);
    let ratio = stored_a / full_scale_a;
    if !(stored_a > 0.0 && full_scale_a > 0.0 && ratio.is_finite()) {
        return None;
    }
    let mut table = Table::ZERO;
    for (point, bytes) in table.0.iter_mut().zip(points.chunks_exact(2)) {
        let value = libm::roundf(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])) * ratio);
        if value.abs() > f32::from(i16::MAX) {
            return None;
        }
        *point = value as i16;
    }
    Some(table)
}
