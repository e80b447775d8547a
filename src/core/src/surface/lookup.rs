//! The nearest point to any place, by one look at a grid.
//!
//! Far from the surface an answer two cells wide is good enough: there a brushfire over cells of twice the edge decides.
//! Near it every cell compares the points around it.

use super::four::{indices, whole};
use crate::neighbours::{Lattice, NOBODY, bounds};
use nalgebra::Point3;
use wide::f32x4;

/// Cells of a grid at most (8 MB of short indices): larger clouds get larger cells.
const MOST_CELLS: usize = 1 << 22;
/// The index of the nearest point in every cell.
#[derive(Clone, Debug)]
pub(crate) struct Lookup {
    low: [f32; 3],
    inverse_edge: f32,
    dims: [u32; 3],
    cells: Cells,
}

/// Half the memory where half is enough: the grid then stays in the second cache.
#[derive(Clone, Debug)]
enum Cells {
    Short(Vec<u16>),
    Long(Vec<u32>),
}

impl Lookup {
    /// Over the points' box and a margin around it, with cells of an edge (m) or larger.
    pub(crate) fn build(points: &[Point3<f32>], edge: f32, margin: f32) -> Self {
        let (low, high) = bounds(points);
        if points.is_empty() {
            return Self { low: [0.0; 3], inverse_edge: 1.0 / edge, dims: [0; 3], cells: Cells::Short(Vec::new()) };
        }
        let (low, high) = (low.map(|c| c - margin), high.map(|c| c + margin));
        let coarse = Lattice::cover(low, high, 2.0 * edge, MOST_CELLS / 8);
        let fine = Lattice { low, edge: 0.5 * coarse.edge, dims: coarse.dims.map(|n| 2 * n) };
        let (inverse_edge, dims) = (1.0 / fine.edge, fine.dims.map(|n| n as u32));
        let cells = if points.len() <= usize::from(u16::MAX) {
            Cells::Short(fill(points, &coarse, &fine, |index| index as u16))
        } else {
            Cells::Long(fill(points, &coarse, &fine, |index| index))
        };
        Self { low, inverse_edge, dims, cells }
    }

    pub(crate) fn cell_m(&self) -> f32 {
        1.0 / self.inverse_edge
    }

    /// The number of the point nearest to the middle of the place's cell.
    #[inline]
    pub(crate) fn index(&self, [x, y, z]: &[f32; 3]) -> Option<usize> {
        let [lx, ly, lz] = self.low;
        let [nx, ny, nz] = self.dims;
        let (i, j, k) = ((x - lx) * self.inverse_edge, (y - ly) * self.inverse_edge, (z - lz) * self.inverse_edge);
        // Below the box and not a number are told before: as integers they would be 0.
        let is_above = (i >= 0.0) & (j >= 0.0) & (k >= 0.0);
        let (i, j, k) = (i as u32, j as u32, k as u32);
        let is_below = (i < nx) & (j < ny) & (k < nz);
        if !(is_above & is_below) {
            return None;
        }
        let cell = ((i * ny + j) * nz + k) as usize;
        match &self.cells {
            Cells::Short(cells) => cells.get(cell).map(|&index| usize::from(index)),
            Cells::Long(cells) => cells.get(cell).map(|&index| index as usize),
        }
    }

    /// The same of four places, and a mask of those inside the grid: the numbers of the others mean nothing.
    #[inline(always)]
    pub(crate) fn four(&self, [x, y, z]: &[f32x4; 3]) -> ([usize; 4], f32x4) {
        let [lx, ly, lz] = self.low;
        let [nx, ny, nz] = self.dims.map(|n| f32x4::splat(n as f32));
        let steps = |c: &f32x4, low: f32| (*c - f32x4::splat(low)) * f32x4::splat(self.inverse_edge);
        let (i, j, k) = (steps(x, lx), steps(y, ly), steps(z, lz));
        let within = |c: f32x4, n: f32x4| c.simd_ge(f32x4::ZERO) & c.simd_lt(n);
        let is_inside = within(i, nx) & within(j, ny) & within(k, nz);
        // At most 2²² cells: as floats their numbers are exact. Outside it is the first cell.
        let cell = (whole(i) * ny + whole(j)) * nz + whole(k);
        let four = indices(cell & is_inside);
        let found = match &self.cells {
            Cells::Short(cells) => four.map(|cell| cells.get(cell).map_or(usize::MAX, |&index| usize::from(index))),
            Cells::Long(cells) => four.map(|cell| cells.get(cell).map_or(usize::MAX, |&index| index as usize)),
        };
        (found, is_inside)
    }
}

/// Every fine cell's nearest point.
fn fill<I: Copy + Default>(points: &[Point3<f32>], coarse: &Lattice, fine: &Lattice, short: fn(u32) -> I) -> Vec<I> {
    let places: Vec<[f32; 3]> = points.iter().map(|point| point.coords.into()).collect();
    let nearest = coarse.brushfire(&places);
    let bins = Bins::sort(&places, coarse);
    let [nx, ny, nz] = coarse.dims;
    let [sx, sy, _] = fine.strides();
    let mut cells = vec![I::default(); fine.count()];
    let mut at = nearest.iter();
    for cx in 0..nx {
        for cy in 0..ny {
            for cz in 0..nz {
                let Some(&held) = at.next() else { return cells };
                let eight = if bins.has_company(coarse, [cx, cy, cz]) {
                    bins.nearest_in_eighths(coarse, [cx, cy, cz], held)
                } else {
                    [held; 8]
                };
                let first = 2 * (cx * sx + cy * sy + cz);
                let pairs = [first, first + sy, first + sx, first + sx + sy];
                for (start, pair) in pairs.into_iter().zip(eight.as_chunks::<2>().0) {
                    if let Some(to) = cells.get_mut(start..start + 2) {
                        to.copy_from_slice(&pair.map(short));
                    }
                }
            }
        }
    }
    cells
}

/// Points sorted by coarse cell, z running fastest.
struct Bins {
    starts: Vec<u32>,
    /// Place and number.
    points: Vec<([f32; 3], u32)>,
    places_by_number: Vec<[f32; 3]>,
}

impl Bins {
    fn sort(places: &[[f32; 3]], coarse: &Lattice) -> Self {
        let [sx, sy, _] = coarse.strides();
        let home = |place: &[f32; 3]| {
            let [cx, cy, cz] = coarse.clamped(*place);
            cx * sx + cy * sy + cz
        };
        let homes: Vec<usize> = places.iter().map(home).collect();
        let mut starts = vec![0u32; coarse.count() + 1];
        for &home in &homes {
            if let Some(count) = starts.get_mut(home + 1) {
                *count += 1;
            }
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let mut next = starts.clone();
        let mut points = vec![([0.0; 3], NOBODY); places.len()];
        for ((place, home), number) in places.iter().zip(homes).zip(0..) {
            let Some(at) = next.get_mut(home) else { continue };
            if let Some(to) = points.get_mut(*at as usize) {
                *to = (*place, number);
            }
            *at += 1;
        }
        Self { starts, points, places_by_number: places.to_vec() }
    }

    /// Whether there are points in a coarse cell or one that touches it.
    fn has_company(&self, coarse: &Lattice, [cx, cy, cz]: [usize; 3]) -> bool {
        let [nx, ny, nz] = coarse.dims;
        let [sx, sy, _] = coarse.strides();
        let span = |c: usize, n: usize| c.saturating_sub(1)..=(c + 1).min(n - 1);
        let start = |cell: usize| self.starts.get(cell).copied().unwrap_or(0);
        let along = span(cz, nz);
        let mut rows = span(cx, nx).flat_map(|x| span(cy, ny).map(move |y| x * sx + y * sy));
        rows.any(|row| start(row + along.start()) < start(row + along.end() + 1))
    }

    /// The nearest points to the middles of a coarse cell's eight fine cells. Each looks at the eight coarse cells
    /// around its own corner: all within three quarters of a coarse edge.
    fn nearest_in_eighths(&self, coarse: &Lattice, cell: [usize; 3], held: u32) -> [u32; 8] {
        let mut eight = [held; 8];
        for (octant, nearest) in eight.iter_mut().enumerate() {
            let side = [octant >> 2 & 1, octant >> 1 & 1, octant & 1];
            let mut middle = [0.0; 3];
            for (((to, axis), home), upper) in middle.iter_mut().zip(0..).zip(cell).zip(side) {
                *to = coarse.middle(axis, home) + (upper as f32 - 0.5) * 0.5 * coarse.edge;
            }
            *nearest = self.nearest(coarse, cell, side, middle, held);
        }
        eight
    }

    fn nearest(&self, coarse: &Lattice, cell: [usize; 3], side: [usize; 3], middle: [f32; 3], held: u32) -> u32 {
        let [mx, my, mz] = middle;
        let squared = |[x, y, z]: &[f32; 3]| {
            let (dx, dy, dz) = (x - mx, y - my, z - mz);
            dx * dx + dy * dy + dz * dz
        };
        let mut best = self.places_by_number.get(held as usize).map_or((f32::INFINITY, held), |p| (squared(p), held));
        let [rx, ry, rz] = corner(cell, side, coarse.dims);
        let [sx, sy, _] = coarse.strides();
        for cx in rx.0..=rx.1 {
            for cy in ry.0..=ry.1 {
                let row = cx * sx + cy * sy;
                let start = |cell: usize| self.starts.get(cell).map_or(0, |&start| start as usize);
                for (place, number) in self.points.get(start(row + rz.0)..start(row + rz.1 + 1)).unwrap_or_default() {
                    let found = squared(place);
                    if found < best.0 || (found == best.0 && *number < best.1) {
                        best = (found, *number);
                    }
                }
            }
        }
        best.1
    }
}

/// The two cells along each axis that meet on the side of the eighth; at the box's side one.
fn corner(cell: [usize; 3], side: [usize; 3], dims: [usize; 3]) -> [(usize, usize); 3] {
    let mut ranges = [(0, 0); 3];
    for (((range, c), upper), n) in ranges.iter_mut().zip(cell).zip(side).zip(dims) {
        *range = if upper == 1 { (c, (c + 1).min(n - 1)) } else { (c.saturating_sub(1), c) };
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points() -> impl Strategy<Value = Vec<Point3<f32>>> {
        let point = (-0.5..0.5f32, -0.3..0.3f32, 2.0..2.1f32).prop_map(|(x, y, z)| Point3::new(x, y, z));
        proptest::collection::vec(point, 1..200)
    }

    proptest! {
        #[test]
        fn near_points_are_found_exactly_and_far_ones_within_the_stated_excess(
            points in points(), steps in proptest::collection::vec((0usize..200, -0.24..0.24f32, -0.24..0.24f32, -0.24..0.24f32), 50),
        ) {
            let lookup = Lookup::build(&points, 0.025, 0.25);
            let h = lookup.cell_m();
            for (pick, x, y, z) in steps {
                let from = points[pick % points.len()];
                let (x, y, z) = (from.x + x, from.y + y, from.z + z);
                let index = lookup.index(&[x, y, z]).expect("within the margin");
                let to = |p: &Point3<f32>| (p - Point3::new(x, y, z)).norm();
                let nearest = points.iter().map(to).fold(f32::INFINITY, f32::min);
                let excess = to(&points[index]) - nearest;
                // The nearest to a middle m at most √3/2 h away is at most 2 · √3/2 h = 1.74 h farther than the nearest.
                // Where cells answer two by two, m is up to √3 h away, and the brushfire errs by less than two
                // coarse edges, 4 h.
                let allowed = if nearest < 0.6 * h { 1.74 * h } else { 2.0 * 1.74 * h + 4.0 * h };
                prop_assert!((0.0..allowed).contains(&(excess + 1e-6)), "{excess} at {nearest}");
            }
        }

        #[test]
        fn the_middle_of_a_cell_near_the_surface_gets_its_nearest_point(points in points(), pick in 0usize..200) {
            let lookup = Lookup::build(&points, 0.025, 0.25);
            let h = lookup.cell_m();
            let point = points[pick % points.len()];
            let middle = |c: f32, low: f32| low + (((c - low) / h) as usize as f32 + 0.5) * h;
            let m = Point3::new(
                middle(point.x, lookup.low[0]), middle(point.y, lookup.low[1]), middle(point.z, lookup.low[2]),
            );
            let found = lookup.index(&m.coords.into()).expect("inside");
            let nearest = points.iter().map(|p| (p - m).norm()).fold(f32::INFINITY, f32::min);
            prop_assert!((points[found] - m).norm() <= nearest + 1e-5);
        }
    }

    #[test]
    fn places_outside_the_margin_or_nowhere_get_no_answer() {
        let lookup = Lookup::build(&[Point3::new(0.0, 0.0, 2.0)], 0.025, 0.25);
        assert_eq!(lookup.index(&[0.24, 0.0, 2.0]), Some(0));
        for place in [[-0.26, 0.0, 2.0], [0.4, 0.0, 2.0], [0.0, f32::NAN, 2.0], [0.0, f32::INFINITY, 2.0]] {
            assert_eq!(lookup.index(&place), None);
        }
        assert_eq!(Lookup::build(&[], 0.025, 0.25).index(&[0.0; 3]), None);
    }

    #[test]
    fn more_points_than_a_short_index_counts_are_told_apart() {
        let points: Vec<_> = (0..70_000).map(|k| Point3::new(k as f32 * 1e-3, 0.0, 0.0)).collect();
        let lookup = Lookup::build(&points, 0.025, 0.25);
        let found = lookup.index(&[69.0, 0.0, 0.0]).expect("inside");
        assert!((points[found].x - 69.0).abs() < lookup.cell_m());
    }
}
