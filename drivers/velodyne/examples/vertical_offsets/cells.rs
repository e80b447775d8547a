//! Returns to cells, and cells to a plane.
//!
//! The returns of one ring within 5° of azimuth become one cell: dozens of them average their noise out, and what is
//! left is what the laser and the surface do.

use crate::capture::Sample;
use crate::surfaces::Surface;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::collections::BTreeMap;

/// Width of a cell.
const CELL_DEG: f64 = 5.0;
/// Fewest returns that make a cell.
const MIN_RETURNS: usize = 4;
/// No cell counts as better than this, metres: less than the 4 mm in which a VLP-32C counts distances.
const CELL_SIGMA_M: f64 = 0.003;
/// Cells farther than this from the plane belong to something else, metres.
const MAX_DISTANCE_M: f64 = 0.05;
/// The planes are found half-way between the two hypotheses, so that the choice of cells favours neither.
const NEUTRAL: f64 = 0.5;

/// The mean of one ring's returns over 5° of azimuth.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    pub(crate) ring: u8,
    /// Where the mean beam meets the surface, without the offset, metres.
    pub(crate) point: Vector3<f64>,
    /// Mean direction of the beams: how the point moves with the range.
    pub(crate) beam: Vector3<f64>,
    /// How the point moves with the elevation, metres per radian.
    pub(crate) lift: Vector3<f64>,
    /// The offset in question, metres.
    pub(crate) height_m: f64,
}

impl Cell {
    /// The point with half the offset.
    fn neutral(&self) -> Vector3<f64> {
        self.point + Vector3::z() * (NEUTRAL * self.height_m)
    }
}

/// A flat surface as its cells show it.
#[derive(Clone, Debug)]
pub(crate) struct Plane {
    /// Away from the sensor, length 1.
    pub(crate) normal: Vector3<f64>,
    /// From the sensor's origin along the normal, metres.
    pub(crate) distance_m: f64,
    /// The cells that lie on it.
    pub(crate) cells: Vec<Cell>,
    /// Spread of the cells within their rings, metres.
    pub(crate) sigma_m: f64,
}

/// The cells of the returns near a surface, by ring and azimuth.
pub(crate) fn gather(samples: &[Sample], surface: &Surface) -> Vec<Cell> {
    let normal = Vector3::from(surface.normal).normalize();
    let mut groups: BTreeMap<(u8, i32), Vec<&Sample>> = BTreeMap::new();
    for sample in samples.iter().filter(|sample| is_near(sample, surface, &normal)) {
        let sector = (sample.azimuth_deg / CELL_DEG) as i32;
        groups.entry((sample.ring, sector)).or_default().push(sample);
    }
    groups.retain(|_, group| group.len() >= MIN_RETURNS);
    groups.values().map(|group| cell(group, &normal)).collect()
}

fn is_near(sample: &Sample, surface: &Surface, normal: &Vector3<f64>) -> bool {
    let range = sample.point.norm();
    let [x, y] = [sample.point.x, sample.point.y];
    let distance = sample.point.dot(normal) + NEUTRAL * sample.height_m * normal.z - surface.distance_m;
    distance.abs() < surface.gate_m
        && (surface.range_m.0..surface.range_m.1).contains(&range)
        && (surface.rings.0..=surface.rings.1).contains(&sample.ring)
        && surface.window_m.is_none_or(|[x0, x1, y0, y1]| (x0..=x1).contains(&x) && (y0..=y1).contains(&y))
}

/// One ring's returns in one sector. The mean beam is cut with the plane at the median distance, so that neither the
/// slant of the surface within the cell nor a stray return moves it.
fn cell(group: &[&Sample], normal: &Vector3<f64>) -> Cell {
    let directions = group.iter().map(|sample| sample.point / sample.point.norm());
    let beam = directions.sum::<Vector3<f64>>() / group.len() as f64;
    let distance = median(group.iter().map(|sample| sample.point.dot(normal)).collect());
    let point = beam * (distance / beam.dot(normal));
    let horizontal = (point.x * point.x + point.y * point.y).sqrt();
    let lift = Vector3::new(-point.z * point.x / horizontal, -point.z * point.y / horizontal, horizontal);
    let (ring, height_m) = group.first().map_or((0, 0.0), |sample| (sample.ring, sample.height_m));
    Cell { ring, point, beam, lift, height_m }
}

impl Plane {
    /// The plane of least squared distances through the cells, those left out that lie off the rest of their ring.
    ///
    /// Cells are judged against the median of their own ring, so that a ring which lies off as a whole, which is
    /// what the question is about, keeps its cells. `outward` only gives the normal its sign.
    pub(crate) fn fit(cells: &[Cell], outward: &Vector3<f64>) -> Self {
        let mut plane = Self { normal: *outward, distance_m: 0.0, cells: cells.to_vec(), sigma_m: CELL_SIGMA_M };
        for _ in 0..8 {
            (plane.normal, plane.distance_m) = least_squares(&plane.cells, outward);
            let residual = |cell: &Cell| cell.neutral().dot(&plane.normal) - plane.distance_m;
            let mut rings: BTreeMap<u8, Vec<f64>> = BTreeMap::new();
            for cell in &plane.cells {
                rings.entry(cell.ring).or_default().push(residual(cell));
            }
            let middle: BTreeMap<u8, f64> = rings.into_iter().map(|(ring, of_ring)| (ring, median(of_ring))).collect();
            let off_ring = |cell: &Cell| (residual(cell) - middle.get(&cell.ring).copied().unwrap_or(0.0)).abs();
            // 1.4826 × the median of absolute values is the σ of a normal spread; 3.5 σ is its outermost 0.05 %.
            let sigma_m = (1.4826 * median(plane.cells.iter().map(off_ring).collect())).max(0.001);
            let kept =
                cells.iter().filter(|cell| off_ring(cell) < 3.5 * sigma_m && residual(cell).abs() < MAX_DISTANCE_M);
            plane.cells = kept.cloned().collect();
            plane.sigma_m = sigma_m.max(CELL_SIGMA_M);
        }
        plane
    }

    /// The plane of some of the rings alone.
    pub(crate) fn of_rings(&self, first: u8, last: u8) -> Self {
        let chosen: Vec<Cell> = self.cells.iter().filter(|cell| (first..=last).contains(&cell.ring)).cloned().collect();
        Self::fit(&chosen, &self.normal)
    }
}

/// Normal and distance of the plane through the cells' neutral points: the direction in which they spread least.
fn least_squares(cells: &[Cell], outward: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let centre = cells.iter().map(Cell::neutral).sum::<Vector3<f64>>() / cells.len() as f64;
    let spread: Matrix3<f64> = cells.iter().map(|cell| cell.neutral() - centre).map(|d| d * d.transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let normal = if normal.dot(outward) < 0.0 { -normal } else { normal };
    (normal, normal.dot(&centre))
}

/// The middle value, or the mean of the two middle ones; NaN of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    match values.get(half) {
        Some(upper) if values.len().is_multiple_of(2) => (upper + values[half - 1]) / 2.0,
        Some(middle) => *middle,
        None => f64::NAN,
    }
}
