//! The k nearest of every point of a cloud at once: points sorted into cells share their candidates.

use super::nearest::{pack, unpack};
use super::{KdTree, Neighbours};
use nalgebra::Point3;

/// Points whose neighbourhood is looked at to choose the cell's size.
const SAMPLES: usize = 31;
/// A cell's edge in radii of a typical neighbourhood: three cells on a side hold most neighbourhoods whole.
const EDGE: f32 = 1.12;
/// Cells there may be for each point: more (points far apart), and the tree is quicker.
const CELLS_PER_POINT: usize = 64;
/// First the next point's neighbours are looked for within so many times the reach of the last one's.
const GUESS: f32 = 1.1;

/// A neighbour, as [`pack`] makes it: read it with `unpack`.
pub(crate) type Key = u64;

/// Calls `visit` with every point's number and the keys of its `k` nearest points (itself among them; fewer only where
/// there are fewer points), unsorted. Of equal distances the lowest index is taken. The points are finite.
///
/// On surfaces it costs a third of what queries of a tree cost.
pub(crate) fn each_knn(points: &[Point3<f32>], k: usize, mut visit: impl FnMut(u32, &[Key])) {
    if k == 0 {
        return;
    }
    match Cells::build(points, k) {
        Some(cells) => cells.each_knn(k, visit),
        None => {
            let tree = KdTree::build(points);
            let mut near = Neighbours::with_capacity(k);
            for (point, index) in points.iter().zip(0..) {
                tree.knn(point, k, &mut near);
                visit(index, near.keys());
            }
        }
    }
}

/// Points sorted by cell, z running fastest: a run of cells along z is a run of points.
struct Cells {
    low: [f32; 3],
    edge: f32,
    dims: [usize; 3],
    /// Where each cell's points begin; one more than there are cells.
    starts: Vec<u32>,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    index: Vec<u32>,
}

/// Columns of candidates.
#[derive(Default)]
struct Block {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    index: Vec<u32>,
    squared: Vec<f32>,
}

impl Cells {
    /// `None`: too few points to be worth it, or too far apart.
    fn build(points: &[Point3<f32>], k: usize) -> Option<Self> {
        if points.len() < 4 * k {
            return None;
        }
        let edge = EDGE * typical_radius(points, k)?;
        let (low, high) = bounds(points);
        let cells = |extent: f32| (extent / edge) as usize + 1;
        let [hx, hy, hz] = high;
        let [lx, ly, lz] = low;
        let dims = [cells(hx - lx), cells(hy - ly), cells(hz - lz)];
        let [nx, ny, nz] = dims;
        let count = nx.checked_mul(ny)?.checked_mul(nz)?;
        if count > CELLS_PER_POINT.checked_mul(points.len())? {
            return None;
        }
        let mut grid = Self {
            low,
            edge,
            dims,
            starts: vec![0; count + 1],
            x: vec![0.0; points.len()],
            y: vec![0.0; points.len()],
            z: vec![0.0; points.len()],
            index: vec![0; points.len()],
        };
        grid.sort(points);
        Some(grid)
    }

    /// Counting sort: points of a cell stay in the order of their numbers.
    fn sort(&mut self, points: &[Point3<f32>]) {
        let cell_of = |point: &Point3<f32>| {
            let [lx, ly, lz] = self.low;
            let [nx, ny, nz] = self.dims;
            let at = |c: f32, low: f32, n: usize| (((c - low) / self.edge) as usize).min(n - 1);
            (at(point.x, lx, nx) * ny + at(point.y, ly, ny)) * nz + at(point.z, lz, nz)
        };
        let homes: Vec<usize> = points.iter().map(cell_of).collect();
        for &home in &homes {
            if let Some(count) = self.starts.get_mut(home + 1) {
                *count += 1;
            }
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        let mut next = self.starts.clone();
        for ((point, home), number) in points.iter().zip(homes).zip(0..) {
            let Some(place) = next.get_mut(home) else { continue };
            let at = *place as usize;
            *place += 1;
            let columns = (self.x.get_mut(at), self.y.get_mut(at), self.z.get_mut(at), self.index.get_mut(at));
            if let (Some(x), Some(y), Some(z), Some(index)) = columns {
                (*x, *y, *z, *index) = (point.x, point.y, point.z, number);
            }
        }
    }

    fn each_knn(&self, k: usize, mut visit: impl FnMut(u32, &[Key])) {
        let [nx, ny, nz] = self.dims;
        let (mut block, mut wider) = (Block::default(), Block::default());
        let mut keys = Vec::new();
        // What reached the last point's neighbours reaches the next one's, most often.
        let mut guess = f32::INFINITY;
        for cx in 0..nx {
            for cy in 0..ny {
                for cz in 0..nz {
                    let own = self.run([cx, cy], cz, cz);
                    if own.is_empty() {
                        continue;
                    }
                    self.gather([cx, cy, cz], 1, &mut block);
                    let points = self.columns(own);
                    for (((&x, &y), &z), &index) in points.0.iter().zip(points.1).zip(points.2).zip(points.3) {
                        let point = [x, y, z];
                        let room = self.room(point, [cx, cy, cz], 1);
                        let mut done = guess < room && block.nearest(point, k, &mut keys, guess);
                        done = done || block.nearest(point, k, &mut keys, room);
                        let mut ring = 2;
                        while !done {
                            self.gather([cx, cy, cz], ring, &mut wider);
                            let room = self.room(point, [cx, cy, cz], ring);
                            done = wider.nearest(point, k, &mut keys, room);
                            ring += 1;
                        }
                        let found = keys.get(..k).unwrap_or(&keys);
                        guess = found.last().map_or(f32::INFINITY, |&kth| GUESS * unpack(kth).1.sqrt());
                        visit(index, found);
                    }
                }
            }
        }
    }

    /// The points of the cells `from..=to` along z.
    fn run(&self, [cx, cy]: [usize; 2], from: usize, to: usize) -> core::ops::Range<usize> {
        let [_, ny, nz] = self.dims;
        let row = (cx * ny + cy) * nz;
        let start = |cell: usize| self.starts.get(cell).map_or(0, |&start| start as usize);
        start(row + from)..start(row + to + 1)
    }

    fn columns(&self, run: core::ops::Range<usize>) -> (&[f32], &[f32], &[f32], &[u32]) {
        let (x, y) = (self.x.get(run.clone()), self.y.get(run.clone()));
        let (z, index) = (self.z.get(run.clone()), self.index.get(run));
        (x.unwrap_or_default(), y.unwrap_or_default(), z.unwrap_or_default(), index.unwrap_or_default())
    }

    /// The points of a cell and of `ring` cells around it.
    fn gather(&self, [cx, cy, cz]: [usize; 3], ring: usize, block: &mut Block) {
        let [nx, ny, nz] = self.dims;
        block.clear();
        let span = |c: usize, n: usize| c.saturating_sub(ring)..=(c + ring).min(n - 1);
        let along = span(cz, nz);
        for bx in span(cx, nx) {
            for by in span(cy, ny) {
                let (x, y, z, index) = self.columns(self.run([bx, by], *along.start(), *along.end()));
                block.x.extend_from_slice(x);
                block.y.extend_from_slice(y);
                block.z.extend_from_slice(z);
                block.index.extend_from_slice(index);
            }
        }
    }

    /// How far around the point every point of the cloud is in the block: to its nearest side that has cells beyond it.
    fn room(&self, point: [f32; 3], cell: [usize; 3], ring: usize) -> f32 {
        let mut room = f32::INFINITY;
        for (((c, low), home), n) in point.iter().zip(self.low).zip(cell).zip(self.dims) {
            let offset = c - low;
            if home > ring {
                room = room.min(offset - (home - ring) as f32 * self.edge);
            }
            if home + ring + 1 < n {
                room = room.min((home + ring + 1) as f32 * self.edge - offset);
            }
        }
        // Rounding puts a point on the line into either cell.
        if room.is_finite() { room - 1e-4 * self.edge } else { room }
    }
}

impl Block {
    fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
        self.index.clear();
    }

    /// The k nearest first in `keys`. False: some may lie beyond `room`.
    fn nearest(&mut self, [px, py, pz]: [f32; 3], k: usize, keys: &mut Vec<Key>, room: f32) -> bool {
        self.squared.resize(self.x.len(), 0.0);
        for (((to, x), y), z) in self.squared.iter_mut().zip(&self.x).zip(&self.y).zip(&self.z) {
            let (dx, dy, dz) = (x - px, y - py, z - pz);
            *to = dx * dx + dy * dy + dz * dz;
        }
        // What lies beyond the room may not be told from what is missing there: leave it out before the selection.
        let reach = if room > 0.0 { room * room } else { -1.0 };
        // Written in any case, kept by counting: no guess of the processor is ever wrong.
        keys.resize(self.squared.len(), 0);
        let mut kept = 0;
        for (&squared, &index) in self.squared.iter().zip(&self.index) {
            if let Some(place) = keys.get_mut(kept) {
                *place = pack(squared, index);
            }
            kept += usize::from(squared <= reach);
        }
        keys.truncate(kept);
        if keys.len() > k {
            keys.select_nth_unstable(k - 1);
        }
        keys.len() >= k || room == f32::INFINITY
    }
}

/// The median distance of the k-th neighbour, of points taken evenly from the list. `None`: the points are in one place.
fn typical_radius(points: &[Point3<f32>], k: usize) -> Option<f32> {
    let step = (points.len() / SAMPLES).max(1);
    let mut squared = vec![0.0f32; points.len()];
    let mut radii: Vec<f32> = Vec::with_capacity(SAMPLES + 1);
    for from in points.iter().skip(step / 2).step_by(step).take(SAMPLES) {
        for (to, point) in squared.iter_mut().zip(points) {
            let (dx, dy, dz) = (point.x - from.x, point.y - from.y, point.z - from.z);
            *to = dx * dx + dy * dy + dz * dz;
        }
        let kth = k.min(squared.len()) - 1;
        radii.push(*squared.select_nth_unstable_by(kth, f32::total_cmp).1);
    }
    radii.sort_unstable_by(f32::total_cmp);
    radii.get(radii.len() / 2).map(|squared| squared.sqrt()).filter(|radius| *radius > 0.0 && radius.is_finite())
}

/// The least and the greatest coordinates.
pub(crate) fn bounds(points: &[Point3<f32>]) -> ([f32; 3], [f32; 3]) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for point in points {
        for ((low, high), c) in low.iter_mut().zip(&mut high).zip(point.iter()) {
            *low = low.min(*c);
            *high = high.max(*c);
        }
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A bumpy sheet, denser on one side, with a few points far off and some in one place.
    fn cloud() -> impl Strategy<Value = Vec<Point3<f32>>> {
        let sheet = (0.0..1.0f32, 0.0..1.0f32, -0.02..0.02f32).prop_map(|(x, y, z)| Point3::new(x * x, y, z));
        let far = (-9.0..9.0f32, -9.0..9.0f32, -9.0..9.0f32).prop_map(|(x, y, z)| Point3::new(x, y, z));
        let lattice = (0i8..4, 0i8..4).prop_map(|(x, y)| Point3::new(f32::from(x) * 0.25, f32::from(y) * 0.25, 0.0));
        proptest::collection::vec(prop_oneof![20 => sheet, 1 => far, 4 => lattice], 0..400)
    }

    proptest! {
        #[test]
        fn every_points_neighbours_are_those_of_the_tree(points in cloud(), k in 1usize..24) {
            let tree = KdTree::build(&points);
            let mut seen = 0;
            each_knn(&points, k, |index, keys| {
                let mut found = keys.to_vec();
                found.sort_unstable();
                let mut expected = Neighbours::default();
                tree.knn(&points[index as usize], k, &mut expected);
                assert_eq!(found, expected.keys());
                seen += 1;
            });
            prop_assert_eq!(seen, points.len());
        }
    }

    #[test]
    fn points_in_one_place_are_each_others_neighbours() {
        let mut seen = 0;
        each_knn(&[Point3::new(1.0, 2.0, 3.0); 100], 5, |_, keys| {
            // Of equal distances the lowest indices: 0, 1, 2, 3, 4 at distance 0, whose bits are 0.
            let mut found = keys.to_vec();
            found.sort_unstable();
            assert_eq!(found, [0, 1, 2, 3, 4]);
            seen += 1;
        });
        assert_eq!(seen, 100);
    }
}
