//! Points of `tumbled export --format pts`: records of 24 bytes, x, y and z first, little-endian.

use crate::geometry_file::Wrong;

/// Bytes of a record.
const RECORD: usize = 24;

/// The points of every record.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<[f32; 3]>, Wrong> {
    let (records, rest) = bytes.as_chunks::<RECORD>();
    if !rest.is_empty() {
        let problem = format!("{} bytes, a multiple of {RECORD} expected: no pts, or cut off", bytes.len());
        return Err(Wrong::new(problem));
    }
    let point = |record: &[u8; RECORD]| {
        let (words, _) = record.as_chunks::<4>();
        core::array::from_fn(|axis| words.get(axis).map_or(f32::NAN, |word| f32::from_le_bytes(*word)))
    };
    Ok(records.iter().map(point).collect())
}
