//! For each direction: how far the nearest ray is, and what lies around it.

use crate::neighbours::{Lattice, NOBODY};
use crate::surface::four::{indices, whole};
use wide::f32x4;

/// Cells of a raster at most (8 MB): wider ones get larger cells.
const MOST_CELLS: usize = 1 << 19;
/// The angle of a raster's cells that no ray is near to, rad.
const WIDEST: f32 = 0.5;
/// Rows that are stamped in one go: a register of four lanes.
const LANES: usize = 4;

/// A ray where a raster wants it: its place on the raster, and how distances there become angles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    /// On the raster.
    pub(crate) u: f32,
    pub(crate) v: f32,
    /// Squared angle from this ray: `uu du² + uv du dv + vv dv²`.
    pub(crate) metric: [f32; 3],
    /// To the point, m.
    pub(crate) range: f32,
    /// Radius within which it takes part in the least and the greatest range, rad.
    pub(crate) reach: f32,
}

impl Ray {
    fn squared_angle(&self, u: f32, v: f32) -> f32 {
        let (du, dv) = (u - self.u, v - self.v);
        let [uu, uv, vv] = self.metric;
        uu * du * du + uv * du * dv + vv * dv * dv
    }
}

/// What lies around a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub(crate) struct Around {
    /// To the nearest ray, rad.
    pub(crate) angle: f32,
    /// Of the nearest ray's point, m.
    pub(crate) nearest: f32,
    /// Least and greatest range among the rays within reach; of the nearest where none is, m.
    pub(crate) least: f32,
    pub(crate) greatest: f32,
}

impl Around {
    /// Of a direction that no ray is near to.
    const NOTHING: Self = Self { angle: WIDEST, nearest: 0.0, least: 0.0, greatest: 0.0 };
}

/// Cells over a plane of directions; v runs fastest.
#[derive(Clone, Debug)]
pub(crate) struct Raster {
    low: [f32; 2],
    inverse_edge: f32,
    dims: [u32; 2],
    cells: Vec<Around>,
}

impl Raster {
    /// Around rays, with a margin and cells of an edge (or larger), in the raster's units. `None`: no rays.
    pub(crate) fn build(rays: &[Ray], edge: f32, margin: f32) -> Option<Self> {
        let lattice = cover(rays, edge, margin)?;
        let places: Vec<[f32; 3]> = rays.iter().map(|ray| [0.0, ray.u, ray.v]).collect();
        let nearest = lattice.brushfire(&places);
        let mut fours = around_nearest(rays, &lattice, &nearest);
        for ray in rays {
            stamp(ray, &lattice, &mut fours);
        }
        let ([_, u, v], [_, nu, nv]) = (lattice.low, lattice.dims);
        Some(Self {
            low: [u, v],
            inverse_edge: 1.0 / lattice.edge,
            dims: [nu as u32, nv as u32],
            cells: fours.iter().flat_map(cells).collect(),
        })
    }

    /// Rows of v, and where the middle of each lies.
    pub(crate) fn rows(&self) -> impl Iterator<Item = f32> + '_ {
        let ([_, low], [_, rows]) = (self.low, self.dims);
        (0..rows).map(move |row| low + (row as f32 + 0.5) / self.inverse_edge)
    }

    /// The rows of four v, and a mask of those inside.
    #[inline(always)]
    pub(crate) fn row(&self, v: f32x4) -> (f32x4, f32x4) {
        let ([_, low], [_, rows]) = (self.low, self.dims);
        let row = (v - f32x4::splat(low)) * f32x4::splat(self.inverse_edge);
        let is_inside = row.simd_ge(f32x4::ZERO) & row.simd_lt(f32x4::splat(rows as f32));
        (whole(row & is_inside), is_inside)
    }

    /// What lies around four directions in rows that are inside, u clamped to the raster; not a number as its low end.
    #[inline(always)]
    pub(crate) fn look_in_row(&self, u: f32x4, row: f32x4) -> FourAround {
        let ([low, _], [columns, _]) = (self.low, self.dims);
        let column = (u - f32x4::splat(low)) * f32x4::splat(self.inverse_edge);
        let column = column & column.simd_gt(f32x4::ZERO);
        let last = f32x4::splat(columns.saturating_sub(1) as f32);
        self.around(column.simd_lt(last).select(whole(column), last), row)
    }

    /// What lies around four directions, and a mask of those inside.
    #[inline(always)]
    pub(crate) fn look(&self, u: f32x4, v: f32x4) -> (FourAround, f32x4) {
        let ([low, _], [columns, _]) = (self.low, self.dims);
        let column = (u - f32x4::splat(low)) * f32x4::splat(self.inverse_edge);
        let is_inside = column.simd_ge(f32x4::ZERO) & column.simd_lt(f32x4::splat(columns as f32));
        let (row, in_rows) = self.row(v);
        (self.around(whole(column & is_inside), row), is_inside & in_rows)
    }

    /// Of cells by column and row: fewer than 2²⁴ cells, so their numbers are exact.
    #[inline(always)]
    fn around(&self, column: f32x4, row: f32x4) -> FourAround {
        let [_, rows] = self.dims;
        let cells = indices(column * f32x4::splat(rows as f32) + row);
        let four = cells.map(|cell| self.cells.get(cell).unwrap_or(&Around::NOTHING));
        let columns = four.map(|around| f32x4::new([around.angle, around.nearest, around.least, around.greatest]));
        let [angle, nearest, least, greatest] = f32x4::transpose(columns);
        FourAround { angle, nearest, least, greatest }
    }
}

/// What lies around four directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FourAround {
    pub(crate) angle: f32x4,
    pub(crate) nearest: f32x4,
    pub(crate) least: f32x4,
    pub(crate) greatest: f32x4,
}

fn cover(rays: &[Ray], edge: f32, margin: f32) -> Option<Lattice> {
    if rays.is_empty() {
        return None;
    }
    let mut low = [f32::INFINITY; 2];
    let mut high = [f32::NEG_INFINITY; 2];
    for ray in rays {
        for ((low, high), c) in low.iter_mut().zip(&mut high).zip([ray.u, ray.v]) {
            *low = low.min(c);
            *high = high.max(c);
        }
    }
    let ([lu, lv], [hu, hv]) = (low.map(|c| c - margin), high.map(|c| c + margin));
    // One cell thick: the first coordinate of its middle is that of the rays.
    let mut lattice = Lattice::cover([0.0, lu, lv], [0.0, hu, hv], edge, MOST_CELLS);
    let [_, nu, nv] = lattice.dims;
    lattice.dims = [1, nu, nv.next_multiple_of(LANES)];
    lattice.low = [-0.5 * lattice.edge, lu, lv];
    Some(lattice)
}

/// Four cells of a column while rays are stamped on them: a register for each number, a cache line together.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Four {
    squared_angle: [f32; LANES],
    nearest: [f32; LANES],
    least: [f32; LANES],
    greatest: [f32; LANES],
}

/// Of each cell its nearest ray alone.
fn around_nearest(rays: &[Ray], lattice: &Lattice, nearest: &[u32]) -> Vec<Four> {
    let [_, _, nv] = lattice.dims;
    let mut fours = Vec::with_capacity(nearest.len() / LANES);
    for (column, numbers) in nearest.chunks(nv).enumerate() {
        let u = lattice.middle(1, column);
        for (block, numbers) in numbers.as_chunks::<LANES>().0.iter().enumerate() {
            let (mut squared_angle, mut range) = ([WIDEST * WIDEST; LANES], [0.0; LANES]);
            let cells = squared_angle.iter_mut().zip(&mut range).zip(numbers).zip(block * LANES..);
            for (((square, range), &number), row) in cells {
                if let Some(ray) = rays.get(number as usize).filter(|_| number != NOBODY) {
                    (*square, *range) = (ray.squared_angle(u, lattice.middle(2, row)), ray.range);
                }
            }
            fours.push(Four { squared_angle, nearest: range, least: range, greatest: range });
        }
    }
    fours
}

/// Lets a ray take part in the cells within its reach.
fn stamp(ray: &Ray, lattice: &Lattice, fours: &mut [Four]) {
    let [uu, uv, vv] = ray.metric;
    let [_, nu, nv] = lattice.dims;
    let [_, lu, lv] = lattice.low;
    // The metric hardly turns: its diagonal tells the box.
    let span = |c: f32, low: f32, metric: f32, n: usize| {
        let half = ray.reach / metric.max(1e-6).sqrt() * 1.05;
        let from = ((c - half - low) / lattice.edge) as usize;
        let to = ((c + half - low) / lattice.edge) as usize;
        (from.min(n - 1), to.min(n - 1))
    };
    let ((left, right), (bottom, top)) = (span(ray.u, lu, uu, nu), span(ray.v, lv, vv, nv));
    let (first, last) = (bottom / LANES, top / LANES);
    let reach = ray.reach * ray.reach;
    let in_column = nv / LANES;
    for column in left..=right {
        let du = lattice.middle(1, column) - ray.u;
        let (constant, slope) = (uu * du * du, uv * du);
        let mut dv = lattice.middle(2, first * LANES) - ray.v;
        for four in fours.get_mut(column * in_column + first..=column * in_column + last).unwrap_or_default() {
            let steps = [dv, dv + lattice.edge, dv + 2.0 * lattice.edge, dv + 3.0 * lattice.edge];
            let nearest = four.squared_angle.iter_mut().zip(&mut four.nearest);
            let ranges = four.least.iter_mut().zip(&mut four.greatest);
            for (((square, nearest), (least, greatest)), dv) in nearest.zip(ranges).zip(steps) {
                let found = constant + (slope + vv * dv) * dv;
                let is_nearer = found < *square;
                *square = if is_nearer { found } else { *square };
                *nearest = if is_nearer { ray.range } else { *nearest };
                *least = if (found <= reach) & (ray.range < *least) { ray.range } else { *least };
                *greatest = if (found <= reach) & (ray.range > *greatest) { ray.range } else { *greatest };
            }
            dv += LANES as f32 * lattice.edge;
        }
    }
}

fn cells(four: &Four) -> [Around; LANES] {
    let mut cells = [Around { angle: 0.0, nearest: 0.0, least: 0.0, greatest: 0.0 }; LANES];
    let nearest = four.squared_angle.iter().zip(&four.nearest);
    let ranges = four.least.iter().zip(&four.greatest);
    for ((cell, (&square, &nearest)), (&least, &greatest)) in cells.iter_mut().zip(nearest).zip(ranges) {
        // Rounding may make the square of nothing a little less.
        let angle = if square > 0.0 { square.sqrt() } else { 0.0 };
        *cell = Around { angle, nearest, least, greatest };
    }
    cells
}
