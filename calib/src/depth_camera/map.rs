//! How far the camera's depths are from the LiDAR's planes over the picture, of boards that were held back; and in time.

use nalgebra::Isometry3;

use super::samples::Shown;
use super::solve::{Solved, patch_residual};
use super::state::{Camera, State};
use crate::plane::Plane;

/// Cells across and down the picture.
pub const MAP: [usize; 2] = [16, 12];
/// A cell is told of so many boards at least.
const LEAST_BOARDS: u32 = 2;

/// Mean depth beyond the LiDAR's planes by cell, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// mm; `None`: fewer than two boards were seen there.
    pub cells_mm: Vec<Option<f64>>,
    /// Boards seen by cell.
    pub boards: Vec<u32>,
}

impl Map {
    /// Root mean square of the cells, mm; `None`: there are none.
    pub fn rms_mm(&self) -> Option<f64> {
        let told: Vec<f64> = self.cells_mm.iter().flatten().copied().collect();
        (!told.is_empty()).then(|| (told.iter().map(|mm| mm * mm).sum::<f64>() / told.len() as f64).sqrt())
    }

    /// The share of the picture that boards were seen in.
    pub fn share(&self) -> f64 {
        let seen = self.boards.iter().filter(|boards| **boards > 0).count();
        seen as f64 / self.boards.len().max(1) as f64
    }
}

/// A plane of the LiDAR's in the camera's frame.
fn in_camera(plane: &Plane, t: &Isometry3<f64>) -> Plane {
    let distance_m = plane.distance_m - plane.normal.dot(&t.translation.vector);
    Plane { normal: t.rotation.inverse() * plane.normal, distance_m }
}

/// The map of boards, each with a solution that it had no part in.
pub(super) fn map<'a>(boards: impl Iterator<Item = (&'a Shown, &'a State)>, camera: &dyn Camera) -> Map {
    let [columns, rows] = MAP;
    let [width, height] = camera.size();
    let cells = columns * rows;
    let (mut sums, mut weights, mut seen) = (vec![0.0; cells], vec![0.0; cells], vec![0_u32; cells]);
    for (board, state) in boards {
        let plane = in_camera(&board.lidar_plane, &state.t_lidar_camera);
        let mut here = vec![false; cells];
        for patch in &board.patches {
            let Some(residual) = patch_residual(patch, &plane, state, camera) else { continue };
            let column = ((patch.pixel[0] / width * columns as f64) as usize).min(columns - 1);
            let cell = ((patch.pixel[1] / height * rows as f64) as usize).min(rows - 1) * columns + column;
            let weight = 1.0 / (patch.sigma * patch.sigma);
            if let (Some(sum), Some(whole), Some(here)) =
                (sums.get_mut(cell), weights.get_mut(cell), here.get_mut(cell))
            {
                *sum += weight * residual;
                *whole += weight;
                *here = true;
            }
        }
        seen.iter_mut().zip(here).for_each(|(boards, here)| *boards += u32::from(here));
    }
    let mean = |((sum, weight), boards): ((&f64, &f64), &u32)| (*boards >= LEAST_BOARDS).then(|| 1e3 * sum / weight);
    Map { cells_mm: sums.iter().zip(&weights).zip(&seen).map(mean).collect(), boards: seen }
}

/// How the depths move in time: what a camera that warms up does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// mm of depth a minute.
    pub mm_per_minute: f64,
    /// One standard deviation.
    pub sigma: f64,
    /// From the first pose to the last, s.
    pub seconds: f64,
}

/// The drift over poses by the time of each, s; `None`: fewer than four, or all at once.
pub(super) fn drift(solved: &Solved, boards: &[&Shown], seconds: &[f64], camera: &dyn Camera) -> Option<Drift> {
    let offset = |board: &&Shown| {
        let plane = in_camera(&board.lidar_plane, &solved.state.t_lidar_camera);
        let (sum, weight) = board.patches.iter().fold((0.0, 0.0), |(sum, weight), patch| {
            let residual = patch_residual(patch, &plane, &solved.state, camera).unwrap_or_default();
            let one = 1.0 / (patch.sigma * patch.sigma);
            (sum + one * residual, weight + one)
        });
        Some((*seconds.get(board.number)? / 60.0, 1e3 * sum / weight))
    };
    let points: Vec<(f64, f64)> = boards.iter().filter_map(offset).filter(|(_, mm)| mm.is_finite()).collect();
    let count = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |(t, mm), point| (t + point.0 / count, mm + point.1 / count));
    let (mut spread, mut product) = (0.0, 0.0);
    for (t, mm) in &points {
        spread += (t - mean.0) * (t - mean.0);
        product += (t - mean.0) * (mm - mean.1);
    }
    if points.len() < 4 || spread <= 1e-6 {
        return None;
    }
    let slope = product / spread;
    let left = points.iter().map(|(t, mm)| {
        let off = mm - mean.1 - slope * (t - mean.0);
        off * off
    });
    let sigma = (left.sum::<f64>() / (count - 2.0) / spread).sqrt();
    let (first, last) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (t, _)| (a.min(*t), b.max(*t)));
    Some(Drift { mm_per_minute: slope, sigma, seconds: 60.0 * (last - first) })
}
