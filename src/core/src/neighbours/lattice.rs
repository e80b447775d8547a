//! A box of equal cells, and the nearest point to each of them.

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
        let mut fire = Brushfire {
            lattice: self,
            points,
            nearest: vec![NOBODY; self.count()],
            squared: vec![f32::INFINITY; self.count()],
        };
        for (point, number) in points.iter().zip(0..) {
            fire.light(self.clamped(*point), number);
        }
        for _ in 0..2 {
            fire.sweep(2);
            fire.sweep(1);
            fire.sweep(0);
        }
        fire.nearest
    }
}

struct Brushfire<'a> {
    lattice: &'a Lattice,
    points: &'a [[f32; 3]],
    nearest: Vec<u32>,
    squared: Vec<f32>,
}

impl Brushfire<'_> {
    /// Gives the cell of a place a point.
    fn light(&mut self, [cx, cy, cz]: [usize; 3], number: u32) {
        let [sx, sy, _] = self.lattice.strides();
        let middle = [self.lattice.middle(0, cx), self.lattice.middle(1, cy), self.lattice.middle(2, cz)];
        let cell = cx * sx + cy * sy + cz;
        if let (Some(held), Some(squared)) = (self.nearest.get_mut(cell), self.squared.get_mut(cell)) {
            exchange(self.points, number, middle, held, squared);
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
        let (lattice, points) = (self.lattice, self.points);
        let (before, after) = self.nearest.split_at_mut(given.start.max(taken.start));
        let (given, nearest) = if given.start < taken.start {
            (before.get(given), after.get_mut(..taken.len()))
        } else {
            (after.get(..given.len()), before.get_mut(taken.clone()))
        };
        let (Some(given), Some(nearest), Some(squared)) = (given, nearest, self.squared.get_mut(taken)) else { return };
        for (cell, ((&given, held), squared)) in given.iter().zip(nearest).zip(squared).enumerate() {
            if given != *held {
                exchange(points, given, [x, y, lattice.middle(2, cell)], held, squared);
            }
        }
    }

    /// Hands points on along a row, up and down again.
    fn along_row(&mut self, at: [usize; 2]) {
        let row = self.row(at);
        let [x, y] = [self.lattice.middle(0, at[0]), self.lattice.middle(1, at[1])];
        let (lattice, points) = (self.lattice, self.points);
        let (Some(nearest), Some(squared)) = (self.nearest.get_mut(row.clone()), self.squared.get_mut(row)) else {
            return;
        };
        let hand_on = |given: &mut u32, cell: usize, held: &mut u32, squared: &mut f32| {
            if *given != *held {
                exchange(points, *given, [x, y, lattice.middle(2, cell)], held, squared);
            }
            *given = *held;
        };
        let mut given = NOBODY;
        for (cell, (held, squared)) in nearest.iter_mut().zip(squared.iter_mut()).enumerate() {
            hand_on(&mut given, cell, held, squared);
        }
        given = NOBODY;
        for (cell, (held, squared)) in nearest.iter_mut().zip(squared.iter_mut()).enumerate().rev() {
            hand_on(&mut given, cell, held, squared);
        }
    }
}

/// Gives a cell another point if that is nearer to its middle than the one it has.
#[inline]
fn exchange(points: &[[f32; 3]], given: u32, [x, y, z]: [f32; 3], held: &mut u32, squared: &mut f32) {
    let Some([px, py, pz]) = points.get(given as usize) else { return };
    let (dx, dy, dz) = (px - x, py - y, pz - z);
    let found = dx * dx + dy * dy + dz * dz;
    if found < *squared || (found == *squared && given < *held) {
        (*squared, *held) = (found, given);
    }
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
