//! For each direction: how far the nearest ray is, and what lies around it.

use crate::neighbours::{Lattice, NOBODY};

/// Cells of a raster at most (4 MB): wider ones get larger cells.
const MOST_CELLS: usize = 1 << 19;
/// What the largest number of a cell's entry stands for, of an angle, rad. Larger ones are told no better.
const WIDEST: f32 = 0.5;

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
pub(crate) struct Around {
    /// To the nearest ray, rad.
    pub(crate) angle: f32,
    /// Of the nearest ray's point, m.
    pub(crate) nearest: f32,
    /// Least and greatest range among the rays within reach; of the nearest where none is, m.
    pub(crate) least: f32,
    pub(crate) greatest: f32,
}

/// [`Around`] in 8 bytes, in units of the raster.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    angle: u16,
    nearest: u16,
    least: u16,
    greatest: u16,
}

/// Cells over a plane of directions; v runs fastest.
#[derive(Clone, Debug)]
pub(crate) struct Raster {
    low: [f32; 2],
    inverse_edge: f32,
    dims: [u32; 2],
    range_unit: f32,
    cells: Vec<Cell>,
}

impl Raster {
    /// Around rays, with a margin and cells of an edge (or larger), in the raster's units. `None`: no rays.
    pub(crate) fn build(rays: &[Ray], edge: f32, margin: f32) -> Option<Self> {
        let lattice = cover(rays, edge, margin)?;
        let places: Vec<[f32; 3]> = rays.iter().map(|ray| [ray.u, ray.v, 0.0]).collect();
        let nearest = lattice.brushfire(&places, 2);
        let mut found = around_nearest(rays, &lattice, &nearest);
        for ray in rays {
            stamp(ray, &lattice, &mut found);
        }
        let farthest = rays.iter().map(|ray| ray.range).fold(0.0, f32::max);
        let range_unit = farthest / f32::from(u16::MAX);
        let short = |value: f32, unit: f32| (value / unit + 0.5) as u16;
        let cell = |around: &Around| Cell {
            angle: short(around.angle, WIDEST / f32::from(u16::MAX)),
            nearest: short(around.nearest, range_unit),
            least: short(around.least, range_unit),
            greatest: short(around.greatest, range_unit),
        };
        let ([u, v, _], [nu, nv, _]) = (lattice.low, lattice.dims);
        Some(Self {
            low: [u, v],
            inverse_edge: 1.0 / lattice.edge,
            dims: [nu as u32, nv as u32],
            range_unit,
            cells: found.iter().map(cell).collect(),
        })
    }

    /// Rows of v, and where the middle of each lies.
    pub(crate) fn rows(&self) -> impl Iterator<Item = f32> + '_ {
        let ([_, low], [_, rows]) = (self.low, self.dims);
        (0..rows).map(move |row| low + (row as f32 + 0.5) / self.inverse_edge)
    }

    /// The row of a v. `None`: outside.
    #[inline]
    pub(crate) fn row(&self, v: f32) -> Option<u32> {
        let ([_, low], [_, rows]) = (self.low, self.dims);
        let row = (v - low) * self.inverse_edge;
        (row >= 0.0 && row < rows as f32).then_some(row as u32)
    }

    /// What lies around a direction in a row, u clamped to the raster.
    #[inline]
    pub(crate) fn look_in_row(&self, u: f32, row: u32) -> Option<Around> {
        let ([low, _], [columns, rows]) = (self.low, self.dims);
        let column = (((u - low) * self.inverse_edge) as u32).min(columns - 1);
        self.cells.get((column * rows + row) as usize).map(|cell| self.read(cell))
    }

    /// What lies around a direction. `None`: it is outside.
    #[inline]
    pub(crate) fn look(&self, u: f32, v: f32) -> Option<Around> {
        let ([low, _], [columns, rows]) = (self.low, self.dims);
        let column = (u - low) * self.inverse_edge;
        let row = self.row(v)?;
        if !(column >= 0.0 && column < columns as f32) {
            return None;
        }
        self.cells.get((column as u32 * rows + row) as usize).map(|cell| self.read(cell))
    }

    #[inline]
    fn read(&self, cell: &Cell) -> Around {
        Around {
            angle: f32::from(cell.angle) * (WIDEST / f32::from(u16::MAX)),
            nearest: f32::from(cell.nearest) * self.range_unit,
            least: f32::from(cell.least) * self.range_unit,
            greatest: f32::from(cell.greatest) * self.range_unit,
        }
    }
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
    // One cell thick: the third coordinate of its middle is that of the rays.
    let mut lattice = Lattice::cover([lu, lv, 0.0], [hu, hv, 0.0], edge, MOST_CELLS);
    lattice.low = [lu, lv, -0.5 * lattice.edge];
    Some(lattice)
}

fn around_nearest(rays: &[Ray], lattice: &Lattice, nearest: &[u32]) -> Vec<Around> {
    let [_, nv, _] = lattice.dims;
    let mut all = Vec::with_capacity(nearest.len());
    for (column, numbers) in nearest.chunks(nv).enumerate() {
        let u = lattice.middle(0, column);
        for (row, &number) in numbers.iter().enumerate() {
            let ray = rays.get(number as usize).filter(|_| number != NOBODY);
            all.push(ray.map_or(Around { angle: WIDEST, nearest: 0.0, least: 0.0, greatest: 0.0 }, |ray| {
                let angle = ray.squared_angle(u, lattice.middle(1, row)).max(0.0).sqrt();
                Around { angle, nearest: ray.range, least: ray.range, greatest: ray.range }
            }));
        }
    }
    all
}

/// Lets a ray take part in the cells within its reach.
fn stamp(ray: &Ray, lattice: &Lattice, found: &mut [Around]) {
    let [uu, _, vv] = ray.metric;
    let [nu, nv, _] = lattice.dims;
    let [lu, lv, _] = lattice.low;
    // The metric hardly turns: its diagonal tells the box.
    let span = |c: f32, low: f32, metric: f32, n: usize| {
        let half = ray.reach / metric.max(1e-6).sqrt() * 1.05;
        let from = ((c - half - low) / lattice.edge) as usize;
        let to = ((c + half - low) / lattice.edge) as usize;
        (from.min(n - 1), to.min(n - 1))
    };
    let (columns, rows) = (span(ray.u, lu, uu, nu), span(ray.v, lv, vv, nv));
    let reach = ray.reach * ray.reach;
    for column in columns.0..=columns.1 {
        let u = lattice.middle(0, column);
        let Some(cells) = found.get_mut(column * nv + rows.0..=column * nv + rows.1) else { continue };
        for (row, around) in (rows.0..).zip(cells) {
            let squared = ray.squared_angle(u, lattice.middle(1, row));
            if squared > reach {
                continue;
            }
            if squared < around.angle * around.angle {
                around.angle = squared.max(0.0).sqrt();
                around.nearest = ray.range;
            }
            around.least = around.least.min(ray.range);
            around.greatest = around.greatest.max(ray.range);
        }
    }
}
