//! What of a board is measured: patches of its face, places on its edges, and the LiDAR's points.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::state::{Camera, SURFACE_TERMS};
use crate::board::{BoardSize, Found};
use crate::plane::{Moments, Plane};
use crate::robust::{huber, scale};
use crate::view::{CameraView, camera_sigma_m};

/// A patch's side in the picture, px.
const PATCH_PX: f64 = 16.0;
/// Points of the view that a patch has at least.
const LEAST_POINTS: usize = 16;
/// Nearer to a corner no edge is measured, m.
const FROM_CORNER_M: f64 = 0.08;
/// Points so far beyond the rectangle may still be the board's, m.
const BEYOND_M: f64 = 0.06;
/// Runs along a row or column that are shorter, pixels of the view, show no edge.
const LEAST_RUN: usize = 8;
/// Rows and columns of the view that are searched for edges: every so-manieth. Neighbours share what strays.
const SCANNED: usize = 2;
/// Nearer to the picture's border the board may go on, px; the device's last eight columns are empty.
const BORDER_PX: f64 = 12.0;
/// A point is the board's within so many standard deviations, and within this, m.
const BELONGS: (f64, f64) = (3.0, 0.012);

/// A patch of the board's face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Patch {
    /// Column and row of its middle.
    pub(super) pixel: [f64; 2],
    /// The measured depth there, m.
    pub(super) z: f64,
    /// Its noise, m, before the scale that the residuals tell.
    pub(super) sigma: f64,
    /// The surface's terms there.
    pub(super) terms: [f64; SURFACE_TERMS],
}

/// A place on the board's edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    /// Column and row halfway between the last pixel of the board and the first beyond.
    pub(super) pixel: [f64; 2],
    /// Which way is out: along a row or along a column, length 1.
    pub(super) out: [f64; 2],
    /// The side: of the rectangle's two axes, and the sign.
    pub(super) side: (usize, f64),
}

/// A board in one pose.
#[derive(Clone, Debug)]
pub(super) struct Shown {
    /// Which of the poses.
    pub(super) number: usize,
    /// In the camera's frame, as the camera alone has it.
    pub(super) plane: Plane,
    /// The rectangle's middle and axes, and half of its sides, m.
    pub(super) middle: Point3<f64>,
    pub(super) axes: [Vector3<f64>; 2],
    pub(super) half: [f64; 2],
    pub(super) patches: Vec<Patch>,
    pub(super) edges: Vec<Edge>,
    /// The LiDAR's points, weighted by their noise.
    pub(super) lidar: Moments,
    /// The LiDAR's own plane.
    pub(super) lidar_plane: Plane,
}

/// The samples of boards found.
pub(super) fn samples(
    found: &[Found],
    views: &[crate::view::View],
    size: &BoardSize,
    camera: &dyn Camera,
) -> Vec<Shown> {
    let residuals = |one: &Found| -> Vec<f64> { one.lidar.iter().map(|p| one.lidar_plane.residual(p)).collect() };
    let mut all: Vec<f64> = found.iter().flat_map(residuals).collect();
    let noise = scale(&mut all);
    let lidar = |one: &Found| {
        let mut moments = Moments::default();
        for ranged in &one.lidar {
            let root = one.lidar_plane.weight_root(ranged) / noise;
            let weight = huber(one.lidar_plane.residual(ranged) / noise);
            moments.add(&one.lidar_plane.set_upright(&ranged.point), weight * root * root);
        }
        moments
    };
    let shown = |one: &Found| {
        let view = &views.get(one.number)?.camera;
        Some(Shown {
            number: one.number,
            plane: one.seen.plane,
            middle: one.seen.middle,
            axes: one.seen.sides,
            half: [0.5 * size.long_m, 0.5 * size.short_m],
            patches: patches(one, camera),
            edges: edges(view, one, size, camera),
            lidar: lidar(one),
            lidar_plane: one.lidar_plane,
        })
    };
    found.iter().filter_map(shown).collect()
}

fn patches(one: &Found, camera: &dyn Camera) -> Vec<Patch> {
    // Columns, rows and 1/z: over a plane they depend on each other linearly.
    let mut sums: BTreeMap<(i32, i32), ([f64; 3], usize)> = BTreeMap::new();
    for ranged in &one.seen.points {
        let p = ranged.point;
        let [u, v] = camera.pixel(p.x / p.z, p.y / p.z);
        let (sum, count) = sums.entry(((v / PATCH_PX) as i32, (u / PATCH_PX) as i32)).or_default();
        sum.iter_mut().zip([u, v, 1.0 / p.z]).for_each(|(sum, value)| *sum += value);
        *count += 1;
    }
    let patch = |(sum, count): &([f64; 3], usize)| {
        let [u, v, inverse] = sum.map(|sum| sum / *count as f64);
        let z = 1.0 / inverse;
        Patch { pixel: [u, v], z, sigma: camera_sigma_m(z), terms: camera.terms(u, v) }
    };
    sums.values().filter(|(_, count)| *count >= LEAST_POINTS).map(patch).collect()
}

/// Where the rows and columns of the view leave the board, each at the sides it crosses most steeply.
fn edges(view: &CameraView, one: &Found, size: &BoardSize, camera: &dyn Camera) -> Vec<Edge> {
    let plane = &one.seen.plane;
    let [width, height] = camera.size();
    let step = [width / view.width.max(1) as f64, height / view.height.max(1) as f64];
    let half = [0.5 * size.long_m, 0.5 * size.short_m];
    // The point's place along both axes, if it is the board's.
    let on_board = |column: usize, row: usize| {
        let point = view.point(column, row)?;
        let way = point - one.seen.middle;
        let [a, b] = one.seen.sides.map(|side| side.dot(&way));
        let [long, short] = half;
        let near = plane.beyond_m(&point).abs() < (BELONGS.0 * camera_sigma_m(point.z)).max(BELONGS.1);
        (near && a.abs() < long + BEYOND_M && b.abs() < short + BEYOND_M).then_some((point, [a, b]))
    };
    let mut edges = Vec::new();
    let mut take = |along_row: bool, line: usize, lengths: usize| {
        let at = |n: usize| if along_row { on_board(n, line) } else { on_board(line, n) };
        let inside: Vec<usize> = (0..lengths).filter(|n| at(*n).is_some()).collect();
        let (Some(first), Some(last)) = (inside.first(), inside.last()) else { return };
        if inside.len() < LEAST_RUN {
            return;
        }
        for (end, sign) in [(*first, -1.0), (*last, 1.0)] {
            let Some((point, along)) = at(end) else { continue };
            let out = if along_row { [sign, 0.0] } else { [0.0, sign] };
            let Some(side) = side(&one.seen.sides, &half, &point, along, along_row, out) else { continue };
            let (column, row) = if along_row { (end, line) } else { (line, end) };
            let [u, v] = [column as f64 * step[0], row as f64 * step[1]];
            let clear = |at: f64, size: f64| at > BORDER_PX && at < size - BORDER_PX;
            if clear(u, width) && clear(v, height) {
                let pixel = [u + 0.5 * step[0] * out[0], v + 0.5 * step[1] * out[1]];
                edges.push(Edge { pixel, out, side });
            }
        }
    };
    (0..view.height).step_by(SCANNED).for_each(|row| take(true, row, view.width));
    (0..view.width).step_by(SCANNED).for_each(|column| take(false, column, view.height));
    edges
}

/// The side that a place near the rectangle's outline lies on, if the scan crosses it more steeply than the other scan would.
fn side(
    axes: &[Vector3<f64>; 2],
    half: &[f64; 2],
    point: &Point3<f64>,
    along: [f64; 2],
    along_row: bool,
    out: [f64; 2],
) -> Option<(usize, f64)> {
    let (x, y) = (point.x / point.z, point.y / point.z);
    let [short_of_long, short_of_short] = [half[0] - along[0].abs(), half[1] - along[1].abs()];
    let (axis, other) = if short_of_long < short_of_short { (0, short_of_short) } else { (1, short_of_long) };
    if other < FROM_CORNER_M {
        return None;
    }
    let (place, direction) = if axis == 0 { (along[0], axes[0]) } else { (along[1], axes[1]) };
    let sign = place.signum();
    // How the side's outward way looks in the picture.
    let (across, down) = (sign * (direction.x - x * direction.z), sign * (direction.y - y * direction.z));
    let steep = if along_row { across.abs() >= down.abs() } else { down.abs() > across.abs() };
    (steep && across * out[0] + down * out[1] > 0.0).then_some((axis, sign))
}
