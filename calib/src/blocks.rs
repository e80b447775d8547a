//! A camera's view in blocks of pixels: small enough to be walked over often, large enough to be calm.

use nalgebra::Point3;

use crate::view::CameraView;

/// Pixels along a block's side.
pub(crate) const SIDE: usize = 4;
/// Of a block's pixels so many must have a depth near the block's median.
const LEAST_PIXELS: usize = 10;
/// How near: a share of the depth.
const NEAR: f64 = 0.04;

/// The mean point of every block.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    points: Vec<Option<Point3<f64>>>,
}

impl Blocks {
    /// Of a view, of what is nearer than `farthest_m`.
    pub(crate) fn new(view: &CameraView, farthest_m: f64) -> Self {
        let (columns, rows) = (view.width / SIDE, view.height / SIDE);
        let mut points = Vec::with_capacity(columns * rows);
        let mut inside: Vec<Point3<f64>> = Vec::with_capacity(SIDE * SIDE);
        for row in 0..rows {
            for column in 0..columns {
                inside.clear();
                inside.extend(pixels_of(column, row).filter_map(|(u, v)| view.point(u, v)));
                inside.sort_by(|a, b| a.z.total_cmp(&b.z));
                let median = inside.get(inside.len() / 2).map_or(f64::INFINITY, |point| point.z);
                let near = inside.iter().filter(|point| (point.z - median).abs() < NEAR * median);
                let (sum, count) = near.fold((nalgebra::Vector3::zeros(), 0), |(s, n), p| (s + p.coords, n + 1));
                let usable = count >= LEAST_PIXELS && median < farthest_m;
                points.push(usable.then(|| Point3::from(sum / count as f64)));
            }
        }
        Self { columns, rows, points }
    }

    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    pub(crate) fn point(&self, block: usize) -> Option<Point3<f64>> {
        self.points.get(block).copied().flatten()
    }

    /// The blocks at most `reach` columns and rows away, itself included.
    pub(crate) fn around(&self, block: usize, reach: usize) -> impl Iterator<Item = usize> + Clone {
        let (column, row) = (block % self.columns.max(1), block / self.columns.max(1));
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(self.columns);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(self.rows);
        let width = self.columns;
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    /// The pixels of a block: column, row.
    pub(crate) fn pixels(&self, block: usize) -> impl Iterator<Item = (usize, usize)> {
        pixels_of(block % self.columns.max(1), block / self.columns.max(1))
    }
}

fn pixels_of(column: usize, row: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..SIDE).flat_map(move |v| (0..SIDE).map(move |u| (column * SIDE + u, row * SIDE + v)))
}
