//! The cubes of space that points lie in, wherever those are: a table of keys, numbered as they come.

use nalgebra::Point3;

/// Cells reach this far from the origin along each axis; what lies beyond is counted to the outermost, and that has
/// neighbours too.
const FARTHEST: i64 = MIDDLE - 1;
/// The cell at the origin, counted from the first.
const MIDDLE: i64 = (1 << (AXIS_BITS - 1)) - 1;
/// Bits of a key that an axis takes.
const AXIS_BITS: u32 = 21;
/// A place of the table that holds nobody.
const EMPTY: u32 = u32::MAX;
/// An odd number near 2⁶⁴ over the golden ratio: keys next to each other are spread over the table.
const SPREAD: u64 = 0x9E37_79B9_7F4A_7C15;
/// Places of the smallest table.
const LEAST_PLACES: usize = 64;

/// Cells of equal edge that hold something, numbered from 0 in the order in which they were first asked for.
#[derive(Clone, Debug)]
pub(super) struct Voxels {
    /// A cell's edge, m.
    edge: f32,
    /// By number: the cell's key.
    keys: Vec<u64>,
    /// Open addressing with steps of one; a power of two of places, at most half of them taken.
    places: Vec<u32>,
}

impl Voxels {
    /// No cells, of this edge, m.
    pub(super) fn new(edge: f32) -> Self {
        Self { edge, keys: Vec::new(), places: vec![EMPTY; LEAST_PLACES] }
    }

    /// Forgets the cells, keeps the memory.
    pub(super) fn reset(&mut self, edge: f32) {
        self.edge = edge;
        self.keys.clear();
        self.places.fill(EMPTY);
    }

    /// A cell's edge, m.
    pub(super) const fn edge(&self) -> f32 {
        self.edge
    }

    /// How many cells hold something.
    pub(super) fn len(&self) -> usize {
        self.keys.len()
    }

    /// The key of the cell in which a place lies.
    pub(super) fn key(&self, [x, y, z]: [f32; 3]) -> u64 {
        let scale = 1.0 / self.edge;
        let [x, y, z] = [x, y, z].map(|c| {
            let scaled = c * scale;
            // A float to an integer goes towards zero: the floor is one less below it.
            let whole = scaled as i32;
            i64::from(whole) - i64::from(whole as f32 > scaled)
        });
        pack([x, y, z])
    }

    /// The number of a cell; a new one if nobody asked for it before.
    pub(super) fn number(&mut self, key: u64) -> u32 {
        let place = self.place(key);
        let held = self.places.get(place).copied().unwrap_or(EMPTY);
        if held != EMPTY {
            return held;
        }
        let number = self.keys.len() as u32;
        self.keys.push(key);
        if let Some(free) = self.places.get_mut(place) {
            *free = number;
        }
        if self.keys.len() * 2 > self.places.len() {
            self.grow();
        }
        number
    }

    /// The number of a cell, if it holds something.
    pub(super) fn find(&self, key: u64) -> Option<u32> {
        self.places.get(self.place(key)).copied().filter(|held| *held != EMPTY)
    }

    /// By number: the cells' keys.
    pub(super) fn keys(&self) -> &[u64] {
        &self.keys
    }

    /// The middle of a cell.
    pub(super) fn middle(&self, key: u64) -> Point3<f64> {
        let mask = (1 << AXIS_BITS) - 1;
        let c = |shift: u32| ((key >> shift & mask) as i64 - MIDDLE) as f64 + 0.5;
        Point3::new(c(2 * AXIS_BITS), c(AXIS_BITS), c(0)) * f64::from(self.edge)
    }

    /// Where a key is in the table, or would be.
    fn place(&self, key: u64) -> usize {
        let last = self.places.len() - 1;
        let mut place = (key.wrapping_mul(SPREAD) >> 32) as usize & last;
        while let Some(held) = self.places.get(place).filter(|held| **held != EMPTY)
            && self.keys.get(*held as usize) != Some(&key)
        {
            place = (place + 1) & last;
        }
        place
    }

    fn grow(&mut self) {
        let places = self.places.len() * 4;
        self.places.clear();
        self.places.resize(places, EMPTY);
        for number in 0..self.keys.len() {
            let Some(place) = self.keys.get(number).map(|key| self.place(*key)) else { continue };
            if let Some(free) = self.places.get_mut(place) {
                *free = number as u32;
            }
        }
    }
}

/// A cell's key from its place along each axis.
fn pack(cell: [i64; 3]) -> u64 {
    cell.into_iter().fold(0, |key, c| key << AXIS_BITS | (c.clamp(-FARTHEST, FARTHEST) + MIDDLE) as u64)
}

/// Offsets of keys to the cells around one: 13 of the 26, the others are these negated.
pub(super) fn half_around() -> [i64; 13] {
    let mut offsets = [0; 13];
    let around = (0..27i64).map(|n| [n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1]);
    // The second half of the 27, the middle left out.
    for (to, [x, y, z]) in offsets.iter_mut().zip(around.skip(14)) {
        *to = (x << (2 * AXIS_BITS)) + (y << AXIS_BITS) + z;
    }
    offsets
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        #[test]
        fn numbers_are_those_of_an_ordered_map(places in prop::collection::vec((-9.0..9.0f32, -9.0..9.0f32, -1.0..1.0f32), 0..800)) {
            let mut voxels = Voxels::new(0.4);
            let mut expected = BTreeMap::new();
            for (x, y, z) in places {
                let cell = [x, y, z].map(|c| (c / 0.4).floor() as i64);
                let next = expected.len() as u32;
                let number = *expected.entry(cell).or_insert(next);
                // A place so near a side that single precision decides has no number to expect.
                let near = [x, y, z].iter().any(|c| ((c / 0.4) - (c / 0.4).round()).abs() < 1e-5);
                prop_assume!(!near);
                let key = voxels.key([x, y, z]);
                prop_assert_eq!(voxels.number(key), number);
                prop_assert_eq!(voxels.find(key), Some(number));
                let middle = voxels.middle(key) - nalgebra::Point3::new(x, y, z).cast::<f64>();
                prop_assert!(middle.amax() <= 0.2 + 1e-5);
            }
            prop_assert_eq!(voxels.len(), expected.len());
        }
    }

    #[test]
    fn the_cells_around_one_are_found_by_their_offsets() {
        let voxels = Voxels::new(1.0);
        let middle = voxels.key([-0.5, 0.5, 7.5]);
        let mut found: Vec<u64> = half_around()
            .iter()
            .flat_map(|offset| [middle.wrapping_add_signed(*offset), middle.wrapping_add_signed(-offset)])
            .collect();
        found.sort_unstable();
        let mut expected = Vec::new();
        for (x, y, z) in (0..27).map(|n| (n / 9, n / 3 % 3, n % 3)) {
            if (x, y, z) != (1, 1, 1) {
                expected.push(voxels.key([-1.5 + x as f32, -0.5 + y as f32, 6.5 + z as f32]));
            }
        }
        expected.sort_unstable();
        assert_eq!(found, expected);
    }

    #[test]
    fn what_is_absurdly_far_away_is_in_the_outermost_cell() {
        let voxels = Voxels::new(0.05);
        assert_eq!(voxels.key([1e30, 0.0, 0.0]), voxels.key([1e7, 0.0, 0.0]));
        assert_ne!(voxels.key([1e30, 0.0, 0.0]), voxels.key([-1e30, 0.0, 0.0]));
    }
}
