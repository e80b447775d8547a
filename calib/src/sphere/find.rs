//! The sphere in both sensors' views.

use nalgebra::{Isometry3, Point3};

use super::centre::{Centre, beyond_m, fit};
use crate::blocks::Blocks;
use crate::view::{CameraView, LidarPoint, Ranged, camera_sigma_m};

/// Spheres are not looked for farther away, m.
const FARTHEST_M: f64 = 4.0;
/// Of the pixels that the sphere must fill so many must lie on it: of a wall that touches it fewer do.
const LEAST_FILLED: f64 = 0.7;
/// How much nearer than its surroundings the front of a sphere is, m.
const BUMP_M: (f64, f64) = (0.003, 0.08);
/// Shares of the radius that others are tried at.
const RADII: [f64; 15] = [0.4, 0.47, 0.55, 0.63, 0.72, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6, 1.8, 2.1, 2.5];
/// A sphere whose radius is off by more than this share is another one.
const RADIUS_SHARE: f64 = 0.15;
/// A LiDAR's points on it at least.
const LEAST_POINTS: usize = 40;
/// A LiDAR's noise: points farther along their rays are of something else, m.
const LIDAR_GATE_M: f64 = 0.08;
/// How far from where the camera has it a LiDAR's points are looked at, m.
const LOOKED_AT_M: f64 = 0.35;
/// Starts tried among a LiDAR's points.
const STARTS: usize = 24;

/// Why there is no sphere.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoSphere {
    /// Nothing of its shape.
    #[error("the Kinect sees no sphere of radius {radius_m:.3} m within {FARTHEST_M} m")]
    NotSeen {
        /// The one looked for, m.
        radius_m: f64,
    },
    /// One of another size.
    #[error("the Kinect sees a sphere of radius about {found_m:.2} m, {radius_m:.3} m was said")]
    OtherRadius {
        /// What it sees, m.
        found_m: f64,
        /// What was said, m.
        radius_m: f64,
    },
    /// Too few points where it must be.
    #[error("the LiDAR has {points} points on the sphere, {LEAST_POINTS} are needed")]
    NotHit {
        /// Points.
        points: usize,
    },
}

/// The sphere in the camera's view: where most of the pixels that it must fill lie on it.
pub(super) fn in_camera(view: &CameraView, radius_m: f64) -> Result<Centre, NoSphere> {
    let blocks = Blocks::new(view, FARTHEST_M);
    let mut best: Option<(f64, Centre)> = None;
    for block in (0..blocks.len()).filter(|block| is_bump(&blocks, *block)) {
        let Some(front) = blocks.point(block) else { continue };
        let ray = front.coords.normalize();
        let start = Point3::from(front.coords + ray * radius_m);
        // A block of the same sphere found already.
        if best.as_ref().is_some_and(|(_, centre)| (centre.at - start).norm() < 0.3 * radius_m) {
            continue;
        }
        let gate = (5.0 * camera_sigma_m(front.z)).max(0.025);
        let Some(rough) = fit(&around(view, &start, radius_m, 6), radius_m, &start, 2.0 * gate) else { continue };
        if (rough.at - start).norm() > radius_m {
            continue;
        }
        let Some(centre) = fit(&around(view, &rough.at, radius_m, 2), radius_m, &rough.at, gate) else { continue };
        let filled = filled(view, &centre, radius_m, gate);
        if best.as_ref().is_none_or(|(most, _)| filled > *most) {
            best = Some((filled, centre));
        }
    }
    let Some((most, centre)) = best else { return Err(NoSphere::NotSeen { radius_m }) };
    let (found_m, filled_by_other) = best_radius(view, &centre, radius_m);
    if most.max(filled_by_other) < LEAST_FILLED {
        Err(NoSphere::NotSeen { radius_m })
    } else if (found_m / radius_m - 1.0).abs() > RADIUS_SHARE {
        Err(NoSphere::OtherRadius { found_m, radius_m })
    } else {
        Ok(centre)
    }
}

/// The radius with which most pixels lie on a sphere about where one was found, m, and how much of it they fill.
fn best_radius(view: &CameraView, found: &Centre, radius_m: f64) -> (f64, f64) {
    let ray = found.at.coords.normalize();
    let front = found.at.coords - ray * radius_m;
    let gate = (3.0 * camera_sigma_m(front.norm())).max(0.01);
    let tried = RADII.map(|share| {
        let radius_m = share * radius_m;
        let start = Point3::from(front + ray * radius_m);
        let centre = fit(&around(view, &start, radius_m, 2), radius_m, &start, gate);
        let filled = centre.as_ref().map_or(0.0, |centre| filled(view, centre, radius_m, gate));
        let (count, rms_m) = centre.map_or((0, f64::INFINITY), |centre| (centre.points.len(), centre.rms_m));
        (count, rms_m, radius_m, filled)
    });
    // Of those that hold nearly as many points as any: the one that they lie on best.
    let filling = || tried.iter().filter(|(.., filled)| *filled >= LEAST_FILLED);
    let most = filling().map(|(count, ..)| *count).max().unwrap_or(0);
    let best = filling().filter(|(count, ..)| 10 * count >= 8 * most).min_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or((radius_m, 0.0), |(_, _, radius_m, filled)| (*radius_m, *filled))
}

/// Nearer than the mean of the blocks around it, as the front of a sphere is and no plane, however it is tilted.
fn is_bump(blocks: &Blocks, block: usize) -> bool {
    let Some(here) = blocks.point(block) else { return false };
    let around = || blocks.around(block, 3).filter_map(|other| blocks.point(other)).map(|point| point.z);
    let count = around().count();
    // A step of the depth is no bump.
    let mean = around().sum::<f64>() / count.max(1) as f64;
    count >= 40 && (BUMP_M.0..BUMP_M.1).contains(&(mean - here.z))
}

/// Every `step`th pixel near a sphere.
fn around(view: &CameraView, centre: &Point3<f64>, radius_m: f64, step: usize) -> Vec<Ranged> {
    let mut points = Vec::new();
    for row in (0..view.height).step_by(step) {
        for column in (0..view.width).step_by(step) {
            if let Some(point) = view.point(column, row)
                && (point - centre).norm() < 1.4 * radius_m
            {
                points.push(Ranged::of_camera(point));
            }
        }
    }
    points
}

/// Of the pixels whose ray meets the sphere well inside its edge, the share that lies on it.
fn filled(view: &CameraView, centre: &Centre, radius_m: f64, gate_m: f64) -> f64 {
    let (mut all, mut on) = (0_usize, 0_usize);
    for row in (0..view.height).step_by(2) {
        for column in (0..view.width).step_by(2) {
            let Some(point) = view.point(column, row) else { continue };
            if let Some((beyond, _)) = beyond_m(&centre.at, radius_m, &Ranged::of_camera(point)) {
                all += 1;
                on += usize::from(beyond.abs() < gate_m);
            }
        }
    }
    if all < 50 { 0.0 } else { on as f64 / all as f64 }
}

/// The sphere among a LiDAR's points, near where the camera has it by a place of the camera in the LiDAR's frame.
pub(super) fn in_lidar(
    points: &[LidarPoint],
    seen: &Point3<f64>,
    t_lidar_camera: &Isometry3<f64>,
    radius_m: f64,
) -> Result<Centre, NoSphere> {
    let expected = t_lidar_camera * seen;
    let near: Vec<Ranged> = points
        .iter()
        .map(LidarPoint::point)
        .filter(|point| (point - expected).norm() < radius_m + LOOKED_AT_M)
        .map(Ranged::of_lidar)
        .collect();
    let fits = |start: &Point3<f64>| {
        let rough = fit(&near, radius_m, start, 2.0 * LIDAR_GATE_M)?;
        fit(&near, radius_m, &rough.at, LIDAR_GATE_M)
    };
    // The guess, and behind some of the points: the one that most points agree with.
    let behind = near
        .iter()
        .step_by(near.len().div_ceil(STARTS).max(1))
        .map(|ranged| Point3::from(ranged.point.coords + ranged.ray() * radius_m));
    let found = std::iter::once(expected)
        .chain(behind)
        .filter_map(|start| fits(&start))
        .filter(|centre| (centre.at - expected).norm() < LOOKED_AT_M)
        .max_by_key(|centre| centre.points.len());
    match found {
        Some(centre) if centre.points.len() >= LEAST_POINTS => Ok(centre),
        found => Err(NoSphere::NotHit { points: found.map_or(0, |centre| centre.points.len()) }),
    }
}
