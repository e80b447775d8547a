//! A box of equal cells, and the nearest point to each of them.

/// No point.
pub(crate) const NOBODY: u32 = u32::MAX;

/// Equal cells in a box; the last axis runs fastest. A picture is a lattice one cell thick.
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
    /// `rounds` of sweeps along each axis both ways. One point stands for all in its cell, and a point that is nearest
    /// nowhere on the way is lost behind another: with two rounds the point found is less than a cell's diagonal farther
    /// than the nearest.
    pub(crate) fn brushfire(&self, points: &[[f32; 3]], rounds: usize) -> Vec<u32> {
        let mut fire = Brushfire {
            lattice: self,
            points,
            nearest: vec![NOBODY; self.count()],
            squared: vec![f32::INFINITY; self.count()],
        };
        for (point, number) in points.iter().zip(0..) {
            let [cx, cy, cz] = self.clamped(*point);
            let [sx, sy, _] = self.strides();
            let middle = [self.middle(0, cx), self.middle(1, cy), self.middle(2, cz)];
            fire.offer(cx * sx + cy * sy + cz, number, middle);
        }
        for _ in 0..rounds {
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
    /// Gives a cell a point if that is nearer to its middle than the one it has.
    fn offer(&mut self, cell: usize, number: u32, [x, y, z]: [f32; 3]) {
        let Some([px, py, pz]) = self.points.get(number as usize) else { return };
        let (Some(squared), Some(nearest)) = (self.squared.get_mut(cell), self.nearest.get_mut(cell)) else { return };
        let (dx, dy, dz) = (px - x, py - y, pz - z);
        let found = dx * dx + dy * dy + dz * dz;
        if found < *squared || (found == *squared && number < *nearest) {
            (*squared, *nearest) = (found, number);
        }
    }

    /// Hands points on along an axis, up and down again.
    fn sweep(&mut self, axis: usize) {
        let (a, b) = match axis {
            0 => (1, 2),
            1 => (0, 2),
            _ => (0, 1),
        };
        let (dims, strides) = (self.lattice.dims, self.lattice.strides());
        let size = |axis: usize| dims.get(axis).copied().unwrap_or(1);
        let stride = |axis: usize| strides.get(axis).copied().unwrap_or(1);
        let (count, step) = (size(axis), stride(axis));
        for i in 0..size(a) {
            for j in 0..size(b) {
                let line = i * stride(a) + j * stride(b);
                let mut middle = [0.0; 3];
                set(&mut middle, a, self.lattice.middle(a, i));
                set(&mut middle, b, self.lattice.middle(b, j));
                for cell in 1..count {
                    set(&mut middle, axis, self.lattice.middle(axis, cell));
                    self.hand_on(line + (cell - 1) * step, line + cell * step, middle);
                }
                for cell in (1..count).rev() {
                    set(&mut middle, axis, self.lattice.middle(axis, cell - 1));
                    self.hand_on(line + cell * step, line + (cell - 1) * step, middle);
                }
            }
        }
    }

    fn hand_on(&mut self, from: usize, to: usize, middle: [f32; 3]) {
        let (Some(&given), Some(&held)) = (self.nearest.get(from), self.nearest.get(to)) else { return };
        if given != held && given != NOBODY {
            self.offer(to, given, middle);
        }
    }
}

fn set([x, y, z]: &mut [f32; 3], axis: usize, value: f32) {
    match axis {
        0 => *x = value,
        1 => *y = value,
        _ => *z = value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_brushfire_finds_the_nearest_or_one_hardly_farther(
            points in proptest::collection::vec((0.0..1.0f32, 0.0..0.7f32, 0.0..0.5f32), 1..60),
        ) {
            let points: Vec<[f32; 3]> = points.into_iter().map(|(x, y, z)| [x, y, z]).collect();
            let lattice = Lattice::cover([-0.2; 3], [1.2, 0.9, 0.7], 0.05, 1_000_000);
            let found = lattice.brushfire(&points, 2);
            let [sx, sy, _] = lattice.strides();
            for (cell, &number) in found.iter().enumerate() {
                let at = [cell / sx, cell % sx / sy, cell % sy];
                let squared = |p: &[f32; 3]| (0..3).map(|k| p[k] - lattice.middle(k, at[k])).map(|d| d * d).sum::<f32>();
                let nearest = points.iter().map(squared).fold(f32::INFINITY, f32::min).sqrt();
                let excess = squared(&points[number as usize]).sqrt() - nearest;
                prop_assert!((0.0..0.05 * 3f32.sqrt()).contains(&excess), "{excess}");
            }
        }
    }

    #[test]
    fn a_lattice_without_points_is_empty() {
        let lattice = Lattice::cover([0.0; 3], [1.0, 1.0, 0.0], 0.1, 1_000);
        assert!(lattice.brushfire(&[], 2).iter().all(|&number| number == NOBODY));
    }

    #[test]
    fn a_box_too_large_for_its_cells_gets_larger_cells() {
        // 10 m at 1 cm would be 10⁹ cells.
        let lattice = Lattice::cover([0.0; 3], [10.0; 3], 0.01, 1_000_000);
        assert!(lattice.count() <= 1_000_000 && lattice.edge > 0.09, "{lattice:?}");
    }
}
