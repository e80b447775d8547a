//! What of one epoch is registered: points with normals and noise, in the rig's frame.

use super::deskew::RigMotion;
use super::voxels::{self, Voxels};
use crate::neighbours::{KdTree, Neighbours, each_knn};
use crate::register::SensorKind;
use crate::surface::{Local, least_eigenvector};
use nalgebra::{Point3, Vector3};
use tumbled_model::RigNs;

/// Edge of the voxels a Kinect's pixels are averaged in, m.
const VOXEL_M: f64 = 0.0145;
/// Pixels that share an error: as many count as one.
const PIXELS_AS_ONE: f64 = 2.0;
/// As many independent ones as averaging pays for.
const MOST_INDEPENDENT: f64 = 4.0;
/// Points of a neighbourhood, the point itself among them: voxels, LiDAR returns.
const KINECT_NEIGHBOURS: usize = 16;
const LIDAR_NEIGHBOURS: usize = 25;
/// By how much a LiDAR's neighbourhood grows where it lies along one ring.
const WIDER: usize = 3;
/// A neighbourhood whose second spread is less than this share of its first lies on a line: it has no normal.
const LINE: f64 = 0.02;
/// A neighbourhood of a greater spread, m, belongs to no surface that was seen: voxels, LiDAR returns.
const KINECT_SPREAD_M: f64 = 0.05;
const LIDAR_SPREAD_M: f64 = 0.15;
/// A surface seen at a smaller cosine is not registered: no such part of the model is.
pub(super) const GRAZING: f64 = 0.15;
/// Returns of a LiDAR at most; of more every n-th is taken.
const MOST_RETURNS: usize = 16_384;
/// Voxels of a Kinect at most; pixels beyond them are left out.
const MOST_VOXELS: usize = 32_768;

/// Which sensor took the frame, when and from where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// The sensor's number in the session, from 0: below [`MOST_SENSORS`](super::MOST_SENSORS).
    pub sensor: usize,
    /// The epoch's time: that of all its points.
    pub t: RigNs,
    /// Where the sensor stood, rig frame, m.
    pub viewpoint: Point3<f64>,
}

/// A Kinect's pixel on the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Rig frame, m.
    pub point: Point3<f32>,
    /// Standard deviation along the sight, m, above 0.
    pub sigma_m: f32,
}

/// A LiDAR's return from the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarReturn {
    /// Where it was measured, rig frame, m.
    pub point: Point3<f32>,
    /// The beam, by its laser's number.
    pub beam: u8,
    /// When, after the epoch's time, s.
    pub dt_s: f32,
}

/// Points of one epoch with normals towards the sensor, all at the epoch's time and in the rig's frame: columns of equal
/// length.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackFrame {
    kind: SensorKind,
    shot: Shot,
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    sigma_m: Vec<f64>,
    beams: Vec<u8>,
}

impl TrackFrame {
    /// Of a Kinect's pixels: means of voxels of 14.5 mm. Pixels that are not finite, or whose σ is no length, are left out;
    /// so are voxels without a surface around them, and surfaces seen edge-on.
    pub fn of_kinect(shot: Shot, pixels: impl IntoIterator<Item = Pixel>) -> Self {
        let pixels = pixels.into_iter();
        let expected = pixels.size_hint().0.min(MOST_VOXELS);
        let mut sums: Vec<[f64; 5]> = Vec::with_capacity(expected / 4);
        let mut voxels = Voxels::with_capacity(MOST_VOXELS);
        let mut last = (u64::MAX, 0);
        for Pixel { point, sigma_m } in pixels {
            let point = point.cast::<f64>();
            if !(point.iter().all(|c| c.is_finite()) && sigma_m > 0.0 && sigma_m.is_finite()) {
                continue;
            }
            let key = voxels::key(&point, VOXEL_M, 0);
            // Neighbours in a row mostly share the voxel.
            if key != last.0 {
                let Some(number) = voxels.number(key) else { continue };
                last = (key, number);
            }
            if last.1 == sums.len() {
                sums.push([0.0; 5]);
            }
            if let Some([count, x, y, z, sigma]) = sums.get_mut(last.1) {
                *count += 1.0;
                *x += point.x;
                *y += point.y;
                *z += point.z;
                *sigma += f64::from(sigma_m);
            }
        }
        let points: Vec<_> = sums.iter().map(|[n, x, y, z, _]| Point3::new(x / n, y / n, z / n)).collect();
        let sigma_m =
            sums.iter().map(|[n, .., sigma]| sigma / n / (n / PIXELS_AS_ONE).clamp(1.0, MOST_INDEPENDENT).sqrt());
        let sigma_m = sigma_m.collect();
        Self::with_normals(SensorKind::Kinect, shot, Columns { points, sigma_m, beams: Vec::new() })
    }

    /// Of a LiDAR's returns of one crossing, each moved to the epoch's time by the target's motion; `sigma_m`: standard
    /// deviation of a range, m, the beams' own biases apart. What is not finite is left out, as are returns without a surface
    /// around them and surfaces seen edge-on.
    pub fn of_lidar(
        shot: Shot,
        returns: impl IntoIterator<Item = LidarReturn>,
        sigma_m: f64,
        motion: &RigMotion,
    ) -> Self {
        let is_finite = |r: &LidarReturn| r.point.iter().all(|c| c.is_finite()) && r.dt_s.is_finite();
        let returns: Vec<LidarReturn> = returns.into_iter().filter(is_finite).collect();
        // An odd step: with the even numbers of lasers there are, it passes no beam over.
        let step = returns.len().div_ceil(MOST_RETURNS).max(1) | 1;
        let taken = || returns.iter().step_by(step);
        let points: Vec<_> = taken().map(|r| motion.to_epoch(&r.point.cast(), f64::from(r.dt_s))).collect();
        let columns =
            Columns { sigma_m: vec![sigma_m; points.len()], beams: taken().map(|r| r.beam).collect(), points };
        Self::with_normals(SensorKind::Lidar, shot, columns)
    }

    fn with_normals(kind: SensorKind, shot: Shot, columns: Columns) -> Self {
        let normals = normals(kind, &columns.points);
        let mut frame = Self {
            kind,
            shot,
            points: Vec::with_capacity(normals.len()),
            normals: Vec::with_capacity(normals.len()),
            sigma_m: Vec::with_capacity(normals.len()),
            beams: Vec::with_capacity(columns.beams.len()),
        };
        let rows = columns.points.iter().zip(&columns.sigma_m).zip(&normals).zip(0..);
        for (((point, sigma_m), normal), number) in rows {
            let (Some(normal), sight) = (normal, shot.viewpoint - point) else { continue };
            let toward = normal.dot(&sight);
            if toward.abs() <= GRAZING * sight.norm() {
                continue;
            }
            frame.points.push(*point);
            frame.normals.push(if toward < 0.0 { -normal } else { *normal });
            frame.sigma_m.push(*sigma_m);
            columns.beams.get(number).into_iter().for_each(|beam| frame.beams.push(*beam));
        }
        frame
    }

    /// What made it.
    pub fn kind(&self) -> SensorKind {
        self.kind
    }

    /// Which sensor, when and from where.
    pub fn shot(&self) -> &Shot {
        &self.shot
    }

    /// The points, rig frame, m.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Unit normals towards the sensor, rig axes.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Standard deviations along the sight, m.
    pub fn sigma_m(&self) -> &[f64] {
        &self.sigma_m
    }

    /// Each point's beam; empty of a Kinect.
    pub fn beams(&self) -> &[u8] {
        &self.beams
    }

    /// How many points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

struct Columns {
    points: Vec<Point3<f64>>,
    sigma_m: Vec<f64>,
    beams: Vec<u8>,
}

/// Each point's normal, of either sign, where its neighbours lie on a surface.
fn normals(kind: SensorKind, points: &[Point3<f64>]) -> Vec<Option<Vector3<f64>>> {
    let (k, spread_m) = match kind {
        SensorKind::Kinect => (KINECT_NEIGHBOURS, KINECT_SPREAD_M),
        SensorKind::Lidar => (LIDAR_NEIGHBOURS, LIDAR_SPREAD_M),
    };
    let mut normals = vec![None; points.len()];
    if points.len() < k / 2 {
        return normals;
    }
    let points: Vec<Point3<f32>> = points.iter().map(|point| point.cast()).collect();
    let mut lines = Vec::new();
    each_knn(&points, k, |near| {
        let local = Local::fit(near, false);
        let [_, middle, most] = local.eigenvalues;
        if most > spread_m * spread_m {
            return;
        }
        if middle < LINE * most {
            lines.push(near.index);
        } else if let Some(normal) = normals.get_mut(near.index as usize) {
            *normal = Some(local.normal);
        }
    });
    if kind == SensorKind::Lidar && !lines.is_empty() {
        widen(&points, &lines, k * WIDER, spread_m, &mut normals);
    }
    normals
}

/// Normals of points whose near neighbours are all of one ring, from so many that others are among them.
fn widen(points: &[Point3<f32>], lines: &[u32], k: usize, spread_m: f64, normals: &mut [Option<Vector3<f64>>]) {
    let tree = KdTree::build(points);
    let mut near = Neighbours::with_capacity(k);
    for &line in lines {
        let Some(point) = points.get(line as usize) else { continue };
        tree.knn(point, k, &mut near);
        let (mut sum, mut square) = (Vector3::zeros(), [0.0; 6]);
        let offsets = near.iter().filter_map(|(number, _)| points.get(number as usize));
        for offset in offsets.map(|other| (other - point).cast::<f64>()) {
            sum += offset;
            let [x, y, z] = offset.into();
            for (entry, term) in square.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
                *entry += term;
            }
        }
        let share = 1.0 / near.len().max(1) as f64;
        let [x, y, z] = (sum * share).into();
        for (entry, mean) in square.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *entry = *entry * share - mean;
        }
        let ([_, middle, most], normal) = least_eigenvector(square);
        if middle >= LINE * most
            && most <= spread_m * spread_m
            && let Some(to) = normals.get_mut(line as usize)
        {
            *to = Some(normal);
        }
    }
}
