//! Places sorted into cells: the nearest one, or all within a reach, by looking at 27 cells.

use crate::neighbours::Lattice;
use core::ops::RangeInclusive;

/// Cells at most (8 MB): of a larger body the cells are larger.
const MOST_CELLS: usize = 1 << 21;

#[derive(Clone, Copy, Debug, Default)]
struct Slot {
    place: [f32; 3],
    number: u32,
}

impl Slot {
    fn squared(&self, [qx, qy, qz]: [f32; 3]) -> f32 {
        let [x, y, z] = self.place;
        let (dx, dy, dz) = (x - qx, y - qy, z - qz);
        dx * dx + dy * dy + dz * dz
    }
}

/// Places in cells no smaller than the reach of its queries, z running fastest. Refilled, it allocates nothing once it has
/// been as large.
#[derive(Clone, Debug)]
pub(super) struct Bins {
    lattice: Lattice,
    inverse_edge: f32,
    /// Where each cell's slots begin; one more than there are cells.
    starts: Vec<u32>,
    homes: Vec<u32>,
    slots: Vec<Slot>,
}

impl Default for Bins {
    fn default() -> Self {
        let lattice = Lattice { low: [0.0; 3], edge: 1.0, dims: [1; 3] };
        Self { lattice, inverse_edge: 1.0, starts: vec![0; 2], homes: Vec::new(), slots: Vec::new() }
    }
}

impl Bins {
    /// Takes the places, numbered in their order, for queries that reach `reach` m. The places are finite.
    pub(super) fn fill(&mut self, places: impl Iterator<Item = [f32; 3]> + Clone, reach: f32) {
        let (mut low, mut high, mut count) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3], 0);
        for place in places.clone() {
            count += 1;
            for ((low, high), c) in low.iter_mut().zip(&mut high).zip(place) {
                *low = low.min(c);
                *high = high.max(c);
            }
        }
        if count == 0 {
            (low, high) = ([0.0; 3], [0.0; 3]);
        }
        // Of places in a cell the offset is rounded: a little more than the reach is safe.
        self.lattice = Lattice::cover(low, high, reach * 1.001, MOST_CELLS);
        self.inverse_edge = 1.0 / self.lattice.edge;
        self.starts.clear();
        self.starts.resize(self.lattice.count() + 1, 0);
        self.homes.clear();
        let [_, ny, nz] = self.lattice.dims;
        for place in places.clone() {
            let [i, j, k] = self.lattice.clamped(place);
            let home = (i * ny + j) * nz + k;
            self.homes.push(home as u32);
            if let Some(next) = self.starts.get_mut(home) {
                *next += 1;
            }
        }
        // Ends first: every place taken moves its cell's end down, until it is the cell's start.
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.slots.clear();
        self.slots.resize(count, Slot::default());
        for ((place, home), number) in places.zip(&self.homes).zip(0..) {
            let Some(end) = self.starts.get_mut(*home as usize) else { continue };
            *end -= 1;
            if let Some(slot) = self.slots.get_mut(*end as usize) {
                *slot = Slot { place, number };
            }
        }
    }

    /// The nearest place of those closer than √`most_squared` m, which is at most the reach, by number, with its squared
    /// distance; of equals the lowest number.
    #[inline]
    pub(super) fn nearest(&self, query: [f32; 3], most_squared: f32) -> Option<(u32, f32)> {
        let mut best = (u32::MAX, most_squared);
        self.visit(
            query,
            |slots| {
                for slot in slots {
                    let squared = slot.squared(query);
                    if squared < best.1 || (squared == best.1 && slot.number < best.0) {
                        best = (slot.number, squared);
                    }
                }
                best.1
            },
            most_squared,
        );
        (best.0 != u32::MAX).then_some(best)
    }

    /// Calls `found` with the number of every place at most √`most_squared` m away, at most the reach; the order is the same
    /// for the same places.
    pub(super) fn within(&self, query: [f32; 3], most_squared: f32, mut found: impl FnMut(usize)) {
        self.visit(
            query,
            |slots| {
                slots
                    .iter()
                    .filter(|slot| slot.squared(query) <= most_squared)
                    .for_each(|slot| found(slot.number as usize));
                most_squared
            },
            most_squared,
        );
    }

    /// Shows the runs of slots near a query, its own row of cells first, but not rows farther than what `look` answers.
    #[inline(always)]
    fn visit(&self, query: [f32; 3], mut look: impl FnMut(&[Slot]) -> f32, most_squared: f32) {
        let [nx, ny, nz] = self.lattice.dims;
        let [lx, ly, lz] = self.lattice.low;
        let [x, y, z] = query;
        let (x, y, z) = (self.steps(x, lx), self.steps(y, ly), self.steps(z, lz));
        let Some(along) = span(z, nz) else { return };
        // In edges: squared distances are compared with a squared edge's worth of rounding to spare.
        let edge_squared = self.lattice.edge * self.lattice.edge;
        let mut reach = most_squared;
        for (i, gap_x) in around(x, nx) {
            for (j, gap_y) in around(y, ny) {
                if (gap_x * gap_x + gap_y * gap_y) * edge_squared * 0.999 > reach {
                    continue;
                }
                let row = (i * ny + j) * nz;
                let start = |cell: usize| self.starts.get(cell).map_or(0, |&start| start as usize);
                if let Some(slots) = self.slots.get(start(row + along.start())..start(row + along.end() + 1)) {
                    reach = look(slots);
                }
            }
        }
    }

    fn steps(&self, c: f32, low: f32) -> f32 {
        (c - low) * self.inverse_edge
    }
}

/// The cell of a coordinate in cells, and the one to each side, as far as there are such. `None`: there is none, or the
/// coordinate is no number.
fn span(at: f32, n: usize) -> Option<RangeInclusive<usize>> {
    let n = n as f32;
    // At the box's end the last cell is the place's, as it was when it was filled.
    if !(at >= -1.0 && at <= n + 1.0) {
        return None;
    }
    let (first, last) = ((libm::floorf(at) - 1.0).clamp(0.0, n - 1.0), (libm::floorf(at) + 1.0).clamp(0.0, n - 1.0));
    Some(first as usize..=last as usize)
}

/// The same three cells, the middle first, and how far the coordinate is from each, in cells.
#[inline(always)]
fn around(at: f32, n: usize) -> impl Iterator<Item = (usize, f32)> {
    let middle = libm::floorf(at);
    let offset = at - middle;
    [(0.0, 0.0), (-1.0, offset), (1.0, 1.0 - offset)].into_iter().filter_map(move |(step, gap)| {
        let cell = middle + step;
        (cell >= 0.0 && cell < n as f32).then_some((cell as usize, gap))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![(-4i8..5).prop_map(|c| f32::from(c) * 0.25), -1.0..1.0f32]
    }

    proptest! {
        #[test]
        fn the_bins_find_what_a_full_search_finds(
            places in proptest::collection::vec(proptest::array::uniform3(coordinate()), 0..200),
            query in proptest::array::uniform3(coordinate()),
            reach in 0.05..0.7f32,
        ) {
            let mut bins = Bins::default();
            bins.fill(places.iter().copied(), reach);
            let squared = |place: &[f32; 3]| Slot { place: *place, number: 0 }.squared(query);
            let mut all: Vec<(u32, f32)> = places.iter().zip(0..).map(|(place, number)| (number, squared(place))).collect();
            all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            let expected = all.first().copied().filter(|(_, squared)| *squared < reach * reach);
            prop_assert_eq!(bins.nearest(query, reach * reach), expected);
            let mut found = Vec::new();
            bins.within(query, reach * reach, |number| found.push(number as u32));
            found.sort_unstable();
            let mut near: Vec<u32> = all.iter().filter(|(_, squared)| *squared <= reach * reach).map(|(number, _)| *number).collect();
            near.sort_unstable();
            prop_assert_eq!(found, near);
        }
    }

    #[test]
    fn of_nothing_and_near_no_place_nothing_is_found() {
        let mut bins = Bins::default();
        assert_eq!(bins.nearest([0.0; 3], 1.0), None);
        bins.fill(core::iter::once([0.0; 3]), 0.1);
        assert_eq!(bins.nearest([f32::NAN; 3], 0.01), None);
        assert_eq!(bins.nearest([1e30, 0.0, 0.0], 0.01), None);
    }
}
