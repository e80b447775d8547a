//! The k nearest of every point of a cloud at once: points sorted into cells share their candidates.

use super::nearest::{pack, unpack};
use super::{KdTree, Neighbours};
use nalgebra::Point3;
use wide::f32x4;

/// Points whose neighbourhood is looked at to choose the cell's size.
const SAMPLES: usize = 9;
/// A cell's edge in radii of a typical neighbourhood: three cells on a side hold most neighbourhoods whole.
const EDGE: f32 = 1.12;
/// Cells there may be for each point: more (points far apart), and the tree is quicker.
const CELLS_PER_POINT: usize = 64;
/// Guesses of the reach of k neighbours, until they are selected one by one.
const GUESSES: u32 = 12;
/// Candidates that are compared in one go.
const LANES: usize = 4;

/// A point's neighbourhood: candidates four by four, of which those within a squared distance belong to it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Neighbourhood<'a> {
    /// The point's number.
    pub(crate) index: u32,
    /// The point, m.
    pub(crate) point: [f32; 3],
    x: &'a [[f32; LANES]],
    y: &'a [[f32; LANES]],
    z: &'a [[f32; LANES]],
    squared: &'a [[f32; LANES]],
    reach: f32,
    /// Squared distance of the nearest other point, m²; infinite: there is none.
    pub(crate) nearest: f32,
}

impl Neighbourhood<'_> {
    /// Offsets from the point, 0 of those that do not belong, and a mask of those that do.
    #[inline(always)]
    pub(crate) fn members(&self) -> impl Iterator<Item = ([f32x4; 3], f32x4)> + '_ {
        let [px, py, pz] = self.point.map(f32x4::splat);
        let reach = f32x4::splat(self.reach);
        self.x.iter().zip(self.y).zip(self.z).zip(self.squared).map(move |(((x, y), z), squared)| {
            let is_member = f32x4::new(*squared).simd_le(reach);
            let [x, y, z] = [x, y, z].map(|column| f32x4::new(*column));
            ([(x - px) & is_member, (y - py) & is_member, (z - pz) & is_member], is_member)
        })
    }
}

/// Calls `visit` with every point's `k` nearest points (itself among them; fewer only where there are fewer points). Of
/// equal distances the lowest index is taken. The points are finite.
///
/// On surfaces it costs less than a third of what queries of a tree cost.
pub(crate) fn each_knn(points: &[Point3<f32>], k: usize, mut visit: impl FnMut(&Neighbourhood<'_>)) {
    if k == 0 {
        return;
    }
    match Cells::build(points, k) {
        Some(cells) => cells.each_knn(k, visit),
        None => {
            let tree = KdTree::build(points);
            let (mut near, mut block) = (Neighbours::with_capacity(k), Block::default());
            for (point, index) in points.iter().zip(0..) {
                tree.knn(point, k, &mut near);
                block.clear();
                for (number, _) in near.iter() {
                    points.get(number as usize).into_iter().for_each(|point| block.push(point.coords.into(), number));
                }
                block.fill();
                let nearest = block.measure(point.coords.into());
                visit(&block.within(index, point.coords.into(), f32::MAX, nearest));
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

    fn each_knn(&self, k: usize, mut visit: impl FnMut(&Neighbourhood<'_>)) {
        let [nx, ny, nz] = self.dims;
        let (mut block, mut wider, mut chosen) = (Block::default(), Block::default(), Block::default());
        let mut keys = Vec::new();
        // What reached the last point's neighbours reaches the next one's, most often.
        let mut guess = self.edge * self.edge;
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
                        let mut nearest = block.measure(point);
                        let (mut ring, mut from) = (1, &mut block);
                        let reach = loop {
                            // What lies beyond the room may not be told from what is missing there.
                            let room = self.room(point, [cx, cy, cz], ring);
                            let room = if room < 0.0 { -1.0 } else { (room * room).min(f32::MAX) };
                            if from.count(room) >= k || room == f32::MAX {
                                break from.reach(k, guess, room);
                            }
                            ring += 1;
                            self.gather([cx, cy, cz], ring, &mut wider);
                            nearest = wider.measure(point);
                            from = &mut wider;
                        };
                        if let Some(reach) = reach {
                            guess = reach;
                            visit(&from.within(index, point, reach, nearest));
                        } else {
                            from.choose(k, &mut keys, &mut chosen);
                            chosen.measure(point);
                            visit(&chosen.within(index, point, f32::MAX, nearest));
                        }
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
        block.fill();
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

    fn push(&mut self, [x, y, z]: [f32; 3], index: u32) {
        self.x.push(x);
        self.y.push(y);
        self.z.push(z);
        self.index.push(index);
    }

    /// Fills the last four up with what is near nothing.
    fn fill(&mut self) {
        while !self.x.len().is_multiple_of(LANES) {
            self.push([f32::INFINITY; 3], u32::MAX);
        }
    }

    /// Measures every candidate's squared distance from a point of the cloud; answers that of the nearest other point.
    fn measure(&mut self, point: [f32; 3]) -> f32 {
        let [px, py, pz] = point.map(f32x4::splat);
        self.squared.resize(self.x.len(), 0.0);
        let (x, y, z) = (self.x.as_chunks::<LANES>().0, self.y.as_chunks::<LANES>().0, self.z.as_chunks::<LANES>().0);
        let mut least = f32x4::splat(f32::INFINITY);
        let mut here = f32x4::ZERO;
        for (((to, x), y), z) in self.squared.as_chunks_mut::<LANES>().0.iter_mut().zip(x).zip(y).zip(z) {
            let (dx, dy, dz) = (f32x4::new(*x) - px, f32x4::new(*y) - py, f32x4::new(*z) - pz);
            let squared = dx * dx + dy * dy + dz * dz;
            let is_apart = squared.simd_gt(f32x4::ZERO);
            least = is_apart.select(squared, least).fast_min(least);
            here += is_apart.select(f32x4::ZERO, f32x4::ONE);
            *to = squared.to_array();
        }
        let [a, b, c, d] = least.to_array();
        // The point itself is one of those here.
        if here.reduce_add() > 1.0 { 0.0 } else { a.min(b).min(c.min(d)) }
    }

    /// Candidates within a squared distance.
    fn count(&self, reach: f32) -> usize {
        self.squared.iter().map(|squared| u32::from(*squared <= reach)).sum::<u32>() as usize
    }

    /// A squared distance, at most `most`, within which there are exactly `k` candidates. `None`: it was not found, for
    /// instance because two of them are equally far. On a surface their number grows with the squared distance.
    fn reach(&self, k: usize, guess: f32, most: f32) -> Option<f32> {
        let (mut low, mut high) = (0.0f32, most);
        let mut reach = guess.min(most);
        for step in 0..GUESSES {
            let count = self.count(reach);
            if count == k {
                return Some(reach);
            }
            if count < k {
                low = reach;
            } else {
                high = reach;
            }
            let by_share = reach * (k as f32 - 0.5) / (count as f32 - 0.5).max(0.5);
            let is_between = by_share > low && by_share < high;
            reach = if is_between && step % 3 != 2 { by_share } else { 0.5 * (low + high) };
        }
        None
    }

    /// The k nearest alone, of equal distances the lowest index.
    fn choose(&self, k: usize, keys: &mut Vec<(u64, [f32; 3])>, chosen: &mut Block) {
        keys.clear();
        let columns = self.x.iter().zip(&self.y).zip(&self.z).zip(&self.index).zip(&self.squared);
        let finite = columns.filter(|(_, squared)| **squared < f32::INFINITY);
        keys.extend(finite.map(|((((x, y), z), index), squared)| (pack(*squared, *index), [*x, *y, *z])));
        keys.sort_unstable_by_key(|(key, _)| *key);
        chosen.clear();
        keys.iter().take(k).for_each(|(key, place)| chosen.push(*place, unpack(*key).0));
        chosen.fill();
    }

    fn within(&self, index: u32, point: [f32; 3], reach: f32, nearest: f32) -> Neighbourhood<'_> {
        let [x, y, z, squared] = [&self.x, &self.y, &self.z, &self.squared].map(|column| column.as_chunks::<LANES>().0);
        Neighbourhood { index, point, x, y, z, squared, reach, nearest }
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
            each_knn(&points, k, |found| {
                let mut expected = Neighbours::default();
                tree.knn(&points[found.index as usize], k, &mut expected);
                let members: Vec<u32> = (0..).zip(found.squared.as_flattened())
                    .filter(|(_, squared)| **squared <= found.reach).map(|(place, _)| place).collect();
                let point = points[found.index as usize];
                let mut offsets: Vec<[u32; 3]> = members.iter().map(|&place| {
                    let at = |column: &[[f32; LANES]]| column.as_flattened()[place as usize];
                    let offset = Point3::new(at(found.x), at(found.y), at(found.z)) - point;
                    [offset.x, offset.y, offset.z].map(f32::to_bits)
                }).collect();
                let mut wanted: Vec<[u32; 3]> = expected.iter().map(|(number, _)| {
                    let offset = points[number as usize] - point;
                    [offset.x, offset.y, offset.z].map(f32::to_bits)
                }).collect();
                offsets.sort_unstable();
                wanted.sort_unstable();
                assert_eq!(offsets, wanted);
                let counted: f32 = found.members().map(|(_, mask)| (mask & f32x4::ONE).reduce_add()).sum();
                assert_eq!(counted as usize, expected.len());
                let others = expected.iter().filter(|(number, _)| *number != found.index).map(|(_, squared)| squared);
                if k > 1 {
                    assert_eq!(found.nearest, others.fold(f32::INFINITY, f32::min));
                }
                seen += 1;
            });
            prop_assert_eq!(seen, points.len());
        }
    }

    #[test]
    fn points_in_one_place_are_each_others_neighbours() {
        let mut seen = 0;
        each_knn(&[Point3::new(1.0, 2.0, 3.0); 100], 5, |found| {
            let counted: f32 = found.members().map(|(_, mask)| (mask & f32x4::ONE).reduce_add()).sum();
            assert_eq!((counted, found.nearest), (5.0, 0.0));
            seen += 1;
        });
        assert_eq!(seen, 100);
    }
}
