//! Numbers for occupied voxels, in the order they were first met.

use nalgebra::Point3;

/// 2⁶⁴ over the golden ratio: spreads neighbouring keys over the table.
const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
/// No voxel's key: no key has its highest bits set.
const VACANT: u64 = u64::MAX;
/// Bits of a key for each axis, and the middle of what they count.
const AXIS_BITS: u32 = 20;
const MIDDLE: f64 = 524_288.0;

/// A voxel's key: its place in cubes of an edge, m, and up to 8 sorts of voxel in one place. Places beyond half a million
/// edges share the outermost.
pub(super) fn key(place: &Point3<f64>, edge_m: f64, sort: u8) -> u64 {
    let [x, y, z] = [place.x, place.y, place.z].map(|c| {
        let at = libm::floor(c / edge_m) + MIDDLE;
        at.clamp(0.0, 2.0 * MIDDLE - 1.0) as u64
    });
    (((u64::from(sort & 7) << AXIS_BITS | x) << AXIS_BITS) | y) << AXIS_BITS | z
}

/// A table of keys, at most half full: open addressing, the same numbers for the same keys in the same order.
#[derive(Clone, Debug)]
pub(super) struct Voxels {
    places: Vec<(u64, u32)>,
    shift: u32,
    len: u32,
}

impl Voxels {
    /// Room for so many voxels.
    pub(super) fn with_capacity(most: usize) -> Self {
        let size = (2 * most).next_power_of_two().max(16);
        Self { places: vec![(VACANT, 0); size], shift: 64 - size.trailing_zeros(), len: 0 }
    }

    /// The key's number: of a key not met before the next one, counting from 0. `None`: the table has no room for it.
    pub(super) fn number(&mut self, key: u64) -> Option<usize> {
        let size = self.places.len();
        let mut at = (key.wrapping_mul(SPREAD) >> self.shift) as usize;
        for _ in 0..size {
            let (held, number) = self.places.get_mut(at)?;
            if *held == key {
                return Some(*number as usize);
            }
            if *held == VACANT {
                if 2 * (self.len as usize) >= size {
                    return None;
                }
                (*held, *number) = (key, self.len);
                self.len += 1;
                return Some(*number as usize);
            }
            at = (at + 1) & (size - 1);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn keys_are_numbered_as_they_come(keys in proptest::collection::vec(0u64..50, 0..200)) {
            let mut voxels = Voxels::with_capacity(keys.len());
            let mut met: Vec<u64> = Vec::new();
            for key in keys {
                let expected = met.iter().position(|known| *known == key).unwrap_or_else(|| {
                    met.push(key);
                    met.len() - 1
                });
                prop_assert_eq!(voxels.number(key), Some(expected));
            }
        }

        #[test]
        fn places_share_a_key_only_in_one_cube(a in proptest::array::uniform3(-5.0..5.0f64), b in proptest::array::uniform3(-5.0..5.0f64)) {
            let cube = |p: [f64; 3]| p.map(|c| libm::floor(c / 0.5));
            prop_assert_eq!(key(&Point3::from(a), 0.5, 3) == key(&Point3::from(b), 0.5, 3), cube(a) == cube(b));
            prop_assert_ne!(key(&Point3::from(a), 0.5, 3), key(&Point3::from(a), 0.5, 4));
        }
    }

    #[test]
    fn a_full_table_takes_no_more() {
        let mut voxels = Voxels::with_capacity(8);
        let taken = (0..100).filter(|key| voxels.number(*key).is_some()).count();
        // 16 places, half of which may be taken.
        assert_eq!(taken, 8);
        assert_eq!(voxels.number(3), Some(3));
    }
}
