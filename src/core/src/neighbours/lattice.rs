//! A box of equal cells, and the nearest point to each of them.

use wide::f32x4;

/// No point.
pub(crate) const NOBODY: u32 = u32::MAX;

/// Equal cells in a box; the last axis runs fastest. A picture is a lattice one cell thick along the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lattice {
    /// The corner of the first cell.
    pub(crate) low: [f32; 3],
    /// A cell's edge.
    pub(crate) edge: f32,
    /// Cells along each axis, 1 or more.
    pub(crate) dims: [usize; 3],
}

impl Lattice {
    /// Covers the box with cells of an edge; with larger ones if it took more than `most` cells.
    pub(crate) fn cover(low: [f32; 3], high: [f32; 3], edge: f32, most: usize) -> Self {
        let [lx, ly, lz] = low;
        let [hx, hy, hz] = high;
        let mut edge = edge;
        loop {
            let cells = |extent: f32| ((extent / edge) as usize).saturating_add(1);
            let dims = [cells(hx - lx), cells(hy - ly), cells(hz - lz)];
            let [nx, ny, nz] = dims;
            let count = nx.saturating_mul(ny).saturating_mul(nz);
            if count <= most {
                return Self { low, edge, dims };
            }
            edge *= 1.25;
        }
    }

    pub(crate) fn count(&self) -> usize {
        let [nx, ny, nz] = self.dims;
        nx * ny * nz
    }

    /// From cell to cell along each axis in the list of all.
    pub(crate) fn strides(&self) -> [usize; 3] {
        let [_, ny, nz] = self.dims;
        [ny * nz, nz, 1]
    }

    /// The middle of a cell along one axis.
    pub(crate) fn middle(&self, axis: usize, cell: usize) -> f32 {
        let [x, y, z] = self.low;
        let low = match axis {
            0 => x,
            1 => y,
            _ => z,
        };
        low + (cell as f32 + 0.5) * self.edge
    }

    /// The cell of a place, clamped to the box.
    pub(crate) fn clamped(&self, place: [f32; 3]) -> [usize; 3] {
        let mut cell = [0; 3];
        for (((to, c), low), n) in cell.iter_mut().zip(place).zip(self.low).zip(self.dims) {
            // A float to an integer saturates: below the box it is 0.
            *to = (((c - low) / self.edge) as usize).min(n - 1);
        }
        cell
    }

    /// The nearest point to each cell's middle, by number: found in the cell, or handed on from the cell next to it.
    ///
    /// Two rounds of sweeps along each axis both ways. One point stands for all in its cell, and a point that is nearest
    /// nowhere on the way is lost behind another. Measured on random clouds: in 19 cells of 20 it is the nearest, and
    /// otherwise less than two edges farther (once in thousands of clouds a little more).
    pub(crate) fn brushfire(&self, points: &[[f32; 3]]) -> Vec<u32> {
        let mut fire = Brushfire::new(self);
        for (point, number) in points.iter().zip(0..) {
            fire.light(self.clamped(*point), *point, f32::from_bits(number));
        }
        for _ in 0..2 {
            fire.sweep(2);
            fire.sweep(1);
            fire.sweep(0);
        }
        fire.number.into_iter().map(f32::to_bits).collect()
    }
}

/// Cells that are compared in one go.
const LANES: usize = 4;

/// The nearest point so far to every cell, column by column: rows beside each other are compared many cells at a time.
struct Brushfire<'a> {
    lattice: &'a Lattice,
    /// The middles of a row's cells along the last axis.
    middles: Vec<f32>,
    /// Where the nearest point is; infinitely far: there is none.
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// The bits of its number: they go through the same registers, and nobody reckons with them.
    number: Vec<f32>,
    squared: Vec<f32>,
}

/// A point handed on.
#[derive(Clone, Copy)]
struct Spark {
    place: [f32; 3],
    number: f32,
}

impl<'a> Brushfire<'a> {
    fn new(lattice: &'a Lattice) -> Self {
        let [_, _, nz] = lattice.dims;
        let far = || vec![f32::INFINITY; lattice.count()];
        let middles = (0..nz).map(|cell| lattice.middle(2, cell)).collect();
        Self {
            lattice,
            middles,
            x: far(),
            y: far(),
            z: far(),
            number: vec![f32::from_bits(NOBODY); lattice.count()],
            squared: far(),
        }
    }

    /// Gives the cell of a place a point.
    fn light(&mut self, [cx, cy, cz]: [usize; 3], place: [f32; 3], number: f32) {
        let [sx, sy, _] = self.lattice.strides();
        let middle = [self.lattice.middle(0, cx), self.lattice.middle(1, cy), self.lattice.middle(2, cz)];
        let cell = cx * sx + cy * sy + cz;
        let columns = (self.x.get_mut(cell), self.y.get_mut(cell), self.z.get_mut(cell));
        if let (Some(x), Some(y), Some(z)) = columns
            && let (Some(held), Some(squared)) = (self.number.get_mut(cell), self.squared.get_mut(cell))
        {
            exchange(Spark { place, number }, middle, [x, y, z], held, squared);
        }
    }

    /// Hands points on along an axis, up and down again.
    fn sweep(&mut self, axis: usize) {
        let [nx, ny, _] = self.lattice.dims;
        match axis {
            0 => {
                (1..nx).for_each(|x| (0..ny).for_each(|y| self.hand_to_row([x - 1, y], [x, y])));
                (1..nx).rev().for_each(|x| (0..ny).for_each(|y| self.hand_to_row([x, y], [x - 1, y])));
            }
            1 => (0..nx).for_each(|x| {
                (1..ny).for_each(|y| self.hand_to_row([x, y - 1], [x, y]));
                (1..ny).rev().for_each(|y| self.hand_to_row([x, y], [x, y - 1]));
            }),
            _ => (0..nx).for_each(|x| (0..ny).for_each(|y| self.along_row([x, y]))),
        }
    }

    /// Where a row (the cells along the last axis) is in the lists.
    fn row(&self, [x, y]: [usize; 2]) -> core::ops::Range<usize> {
        let [_, ny, nz] = self.lattice.dims;
        let start = (x * ny + y) * nz;
        start..start + nz
    }

    /// Hands a row's points on to the row beside it.
    fn hand_to_row(&mut self, from: [usize; 2], to: [usize; 2]) {
        let (given, taken) = (self.row(from), self.row(to));
        let [x, y] = [self.lattice.middle(0, to[0]), self.lattice.middle(1, to[1])];
        let ((gx, tx), (gy, ty)) = (rows(&mut self.x, &given, &taken), rows(&mut self.y, &given, &taken));
        let ((gz, tz), (gn, tn)) = (rows(&mut self.z, &given, &taken), rows(&mut self.number, &given, &taken));
        let squared = self.squared.get_mut(taken).unwrap_or_default();
        let fours =
            (gx.as_chunks::<LANES>(), gy.as_chunks::<LANES>(), gz.as_chunks::<LANES>(), gn.as_chunks::<LANES>());
        let ((gx, rest_gx), (gy, rest_gy), (gz, rest_gz), (gn, rest_gn)) = fours;
        let (tx, rest_tx) = tx.as_chunks_mut::<LANES>();
        let (ty, rest_ty) = ty.as_chunks_mut::<LANES>();
        let (tz, rest_tz) = tz.as_chunks_mut::<LANES>();
        let (tn, rest_tn) = tn.as_chunks_mut::<LANES>();
        let (squared, rest_squared) = squared.as_chunks_mut::<LANES>();
        let (middles, rest_middles) = self.middles.as_chunks::<LANES>();
        let sparks = gx.iter().zip(gy).zip(gz).zip(gn);
        let cells = tx.iter_mut().zip(ty).zip(tz).zip(tn).zip(squared).zip(middles);
        let [x4, y4] = [x, y].map(f32x4::splat);
        for ((((gx, gy), gz), gn), (((((tx, ty), tz), tn), squared), z)) in sparks.zip(cells) {
            let [gx, gy, gz, gn] = [gx, gy, gz, gn].map(|four| f32x4::new(*four));
            let (dx, dy, dz) = (gx - x4, gy - y4, gz - f32x4::new(*z));
            let found = dx * dx + dy * dy + dz * dz;
            let is_nearer = found.simd_lt(f32x4::new(*squared));
            for (to, given) in [(tx, gx), (ty, gy), (tz, gz), (tn, gn), (squared, found)] {
                *to = is_nearer.select(given, f32x4::new(*to)).to_array();
            }
        }
        let sparks = rest_gx.iter().zip(rest_gy).zip(rest_gz).zip(rest_gn);
        let cells = rest_tx.iter_mut().zip(rest_ty).zip(rest_tz).zip(rest_tn).zip(rest_squared).zip(rest_middles);
        for ((((gx, gy), gz), number), (((((tx, ty), tz), held), squared), z)) in sparks.zip(cells) {
            let spark = Spark { place: [*gx, *gy, *gz], number: *number };
            exchange(spark, [x, y, *z], [tx, ty, tz], held, squared);
        }
    }

    /// Hands points on along a row, up and down again.
    fn along_row(&mut self, at: [usize; 2]) {
        let row = self.row(at);
        let [x, y] = [self.lattice.middle(0, at[0]), self.lattice.middle(1, at[1])];
        let columns = (self.x.get_mut(row.clone()), self.y.get_mut(row.clone()), self.z.get_mut(row.clone()));
        let (Some(px), Some(py), Some(pz)) = columns else { return };
        let (Some(numbers), Some(squared)) = (self.number.get_mut(row.clone()), self.squared.get_mut(row)) else {
            return;
        };
        let nothing = Spark { place: [f32::INFINITY; 3], number: f32::from_bits(NOBODY) };
        let mut given = nothing;
        let places = px.iter_mut().zip(py.iter_mut()).zip(pz.iter_mut());
        let cells = places.zip(numbers.iter_mut()).zip(squared.iter_mut()).zip(&self.middles);
        for (((((px, py), pz), held), squared), z) in cells {
            exchange(given, [x, y, *z], [px, py, pz], held, squared);
            given = Spark { place: [*px, *py, *pz], number: *held };
        }
        given = nothing;
        let places = px.iter_mut().zip(py).zip(pz);
        for (((((px, py), pz), held), squared), z) in places.zip(numbers).zip(squared).zip(&self.middles).rev() {
            exchange(given, [x, y, *z], [px, py, pz], held, squared);
            given = Spark { place: [*px, *py, *pz], number: *held };
        }
    }
}

/// Two rows of a column of cells: one to read, one to write.
fn rows<'c, T>(
    column: &'c mut [T],
    given: &core::ops::Range<usize>,
    taken: &core::ops::Range<usize>,
) -> (&'c [T], &'c mut [T]) {
    let (before, after) = column.split_at_mut(given.start.max(taken.start));
    let (given, taken) = if given.start < taken.start {
        (before.get(given.clone()), after.get_mut(..taken.len()))
    } else {
        (after.get(..given.len()), before.get_mut(taken.clone()))
    };
    (given.unwrap_or_default(), taken.unwrap_or_default())
}

/// Gives a cell another point if that is nearer to its middle than the one it has. Without a branch: which is nearer is
/// chance.
#[inline(always)]
fn exchange(given: Spark, [x, y, z]: [f32; 3], [px, py, pz]: [&mut f32; 3], held: &mut f32, squared: &mut f32) {
    let [gx, gy, gz] = given.place;
    let (dx, dy, dz) = (gx - x, gy - y, gz - z);
    let found = dx * dx + dy * dy + dz * dz;
    let is_nearer = found < *squared;
    *px = if is_nearer { gx } else { *px };
    *py = if is_nearer { gy } else { *py };
    *pz = if is_nearer { gz } else { *pz };
    *held = if is_nearer { given.number } else { *held };
    *squared = if is_nearer { found } else { *squared };
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    /// By how many edges the points found are farther than the nearest: for every cell.
    fn excess(lattice: &Lattice, points: &[[f32; 3]]) -> Vec<f32> {
        let [sx, sy, _] = lattice.strides();
        let of_cell = |(cell, number): (usize, u32)| {
            let middle =
                [lattice.middle(0, cell / sx), lattice.middle(1, cell % sx / sy), lattice.middle(2, cell % sy)];
            let squared = |p: &[f32; 3]| p.iter().zip(middle).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
            let nearest = points.iter().map(squared).fold(f32::INFINITY, f32::min).sqrt();
            (squared(&points[number as usize]).sqrt() - nearest) / lattice.edge
        };
        lattice.brushfire(points).into_iter().enumerate().map(of_cell).collect()
    }

    /// Of 80 clouds of 1 to 80 points anywhere in a box: the largest excess, and the share of cells with any.
    fn worst(lattice: &Lattice, thick: f32) -> (f32, f32) {
        let mut rng = ChaCha8Rng::seed_from_u64(17);
        let mut uniform = || rng.next_u32() as f32 / u32::MAX as f32;
        let (mut most, mut wrong, mut all) = (0.0f32, 0, 0);
        for cloud in 0..80 {
            let points: Vec<_> = (0..1 + cloud).map(|_| [thick * uniform(), uniform(), 0.7 * uniform()]).collect();
            for excess in excess(lattice, &points) {
                assert!(excess >= 0.0);
                most = most.max(excess);
                wrong += usize::from(excess > 1e-3);
                all += 1;
            }
        }
        (most, wrong as f32 / all as f32)
    }

    #[test]
    fn the_brushfire_finds_the_nearest_or_one_hardly_farther() {
        let solid = Lattice::cover([-0.2; 3], [0.7, 1.2, 0.9], 0.05, 1_000_000);
        let (most, wrong) = worst(&solid, 0.5);
        assert!(most < 2.0 && wrong < 0.05, "{most} {wrong}");
        let plane = Lattice { low: [-0.01, -0.2, -0.2], edge: 0.02, dims: [1, 70, 55] };
        let (most, wrong) = worst(&plane, 0.0);
        assert!(most < 2.0 && wrong < 0.05, "{most} {wrong}");
    }

    #[test]
    fn a_lattice_without_points_is_empty() {
        let lattice = Lattice::cover([0.0; 3], [0.0, 1.0, 1.0], 0.1, 1_000);
        assert!(lattice.brushfire(&[]).iter().all(|&number| number == NOBODY));
    }

    #[test]
    fn a_box_too_large_for_its_cells_gets_larger_cells() {
        // 10 m at 1 cm would be 10⁹ cells.
        let lattice = Lattice::cover([0.0; 3], [10.0; 3], 0.01, 1_000_000);
        assert!(lattice.count() <= 1_000_000 && lattice.edge > 0.09, "{lattice:?}");
    }
}
