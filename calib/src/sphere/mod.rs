//! A sphere shown to both sensors in several places.
//!
//! ```text
//!   views ─ find (camera, then LiDAR near it) ─ centre (fitted to ranges) ─ joint (centres onto centres) ─ agreement ─ gates
//! ```

mod centre;
mod find;
mod joint;

use nalgebra::{Isometry3, Vector3};

use crate::consistency::{PoseSet, agree};
use crate::coverage::{LEAST_CENTRES_M, Spread, missing_places};
use crate::extrinsic::{Extrinsic, PoseFigures, PoseOutcome, histogram, pose_gates, result_gates, unsolved};
use crate::fit::{Fit, Unsolved};
use crate::gate::Gate;
use crate::view::{Ranged, View};
use centre::Centre;

pub use find::NoSphere;
pub use joint::{CentrePair, LEAST_POSES};

/// Spheres below this radius are too small for a LiDAR's beams, m.
const ADVISED_RADIUS_M: f64 = 0.2;
/// Points of a pose kept for overlays, of either sensor.
const SAMPLES: usize = 150;

/// A place of the sphere, as both sensors have it.
struct Found {
    number: usize,
    camera: Centre,
    lidar: Centre,
}

struct Spheres<'a> {
    found: &'a [Found],
    radius_m: f64,
}

impl Found {
    fn pair(&self) -> CentrePair {
        CentrePair {
            camera: self.camera.at,
            camera_covariance: self.camera.covariance,
            lidar: self.lidar.at,
            lidar_covariance: self.lidar.covariance,
        }
    }
}

impl PoseSet for Spheres<'_> {
    fn solve(&self, which: &[usize], start: &Isometry3<f64>) -> Result<Fit, Unsolved> {
        let pairs: Vec<CentrePair> = which.iter().filter_map(|pose| self.found.get(*pose)).map(Found::pair).collect();
        joint::solve(&pairs, start)
    }

    fn beyond(&self, pose: usize, fit: &Fit) -> (f64, f64, usize) {
        let Some(found) = self.found.get(pose) else { return (0.0, 0.0, 0) };
        distances_m(found, fit, self.radius_m)
            .fold((0.0, 0.0, 0), |(squares, sum, count), off| (squares + off * off, sum + off, count + 1))
    }
}

/// Distances of the LiDAR's points, along their rays, beyond the sphere that the camera saw.
fn distances_m<'a>(found: &'a Found, fit: &Fit, radius_m: f64) -> impl Iterator<Item = f64> + 'a {
    let at = fit.t_lidar_camera * found.camera.at;
    found.lidar.points.iter().filter_map(move |ranged| Some(centre::beyond_m(&at, radius_m, ranged)?.0))
}

/// Calibrates with a sphere of a radius, m; `start` is the config's place of the camera in the LiDAR's frame.
pub fn calibrate(views: &[View], radius_m: f64, start: &Isometry3<f64>) -> Extrinsic {
    let mut poses: Vec<PoseOutcome> =
        (0..views.len()).map(|number| PoseOutcome { number, left_aside: None, seen: None }).collect();
    let aside = |poses: &mut Vec<PoseOutcome>, number: usize, why: String| {
        if let Some(pose) = poses.get_mut(number) {
            pose.left_aside = Some(why);
        }
    };
    let mut all: Vec<Found> = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let one = find::in_camera(&view.camera, radius_m).and_then(|camera| {
            let lidar = find::in_lidar(&view.lidar, &camera.at, start, radius_m)?;
            Ok(Found { number, camera, lidar })
        });
        match one {
            Ok(one) => all.push(one),
            Err(why) => aside(&mut poses, number, why.to_string()),
        }
    }
    let spread_of =
        |found: &[Found]| Spread::of_places(&found.iter().map(|one| one.camera.at.coords).collect::<Vec<_>>());
    let pairs: Vec<CentrePair> = all.iter().map(Found::pair).collect();
    let (t, agreeing) = match joint::closed_form(&pairs) {
        Ok(begun) => begun,
        Err(error) => return without(poses, start, spread_of(&all), error),
    };
    let mut found = Vec::new();
    for (one, agrees) in all.into_iter().zip(agreeing) {
        if agrees {
            found.push(one);
        } else {
            let why = "its two centres do not fit the other poses: one sensor saw something else";
            aside(&mut poses, one.number, why.to_owned());
        }
    }
    let set = Spheres { found: &found, radius_m };
    let agreement = match agree(&set, (0..found.len()).collect(), views.len(), &t) {
        Ok(agreement) => agreement,
        Err(error) => return without(poses, start, spread_of(&found), error),
    };
    for dropped in &agreement.dropped {
        if let Some(one) = found.get(dropped.pose) {
            aside(&mut poses, one.number, format!("it moves the result by {:.1} sigma", dropped.shift_sigma));
        }
    }
    for one in &found {
        if let Some(pose) = poses.get_mut(one.number) {
            pose.seen = Some(figures(one, &agreement.fit, radius_m));
        }
    }
    let used: Vec<Vector3<f64>> =
        agreement.used.iter().filter_map(|place| found.get(*place)).map(|one| one.camera.at.coords).collect();
    let spread = Spread::of_places(&used);
    let missing = missing_places(&spread);
    let reasons: Vec<String> = poses.iter().filter_map(|pose| pose.left_aside.clone()).collect();
    let mut gates = pose_gates(used.len(), views.len(), LEAST_POSES, &reasons);
    let [_, second, third] = spread.sizes.map(f64::sqrt);
    let remedy = missing.as_deref().unwrap_or_default();
    let [least_second, least_third] = LEAST_CENTRES_M;
    gates.push(Gate::at_least("spread of the centres, second", second, "m", (None, Some(least_second)), remedy));
    gates.push(Gate::at_least("spread of the centres, third", third, "m", (None, Some(least_third)), remedy));
    gates.extend(result_gates(&agreement, start, missing.as_deref()));
    let radius = "a sphere this small gives the LiDAR few points: one of radius 0.25 m is recommended";
    gates.push(Gate::at_least("radius of the sphere", radius_m, "m", (Some(ADVISED_RADIUS_M), None), radius));
    // Places in the agreement are of the spheres found, the report's are of the poses shown.
    let agreement = agreement.renumbered(&found.iter().map(|one| one.number).collect::<Vec<_>>());
    Extrinsic { start: *start, agreement: Some(agreement), poses, spread, gates }
}

fn without(poses: Vec<PoseOutcome>, start: &Isometry3<f64>, spread: Spread, error: Unsolved) -> Extrinsic {
    let reasons: Vec<String> = poses.iter().filter_map(|pose| pose.left_aside.clone()).collect();
    let usable = poses.len() - reasons.len();
    let mut gates = pose_gates(usable, poses.len(), LEAST_POSES, &reasons);
    gates.push(unsolved(error, if usable >= 2 { missing_places(&spread) } else { None }));
    Extrinsic { start: *start, agreement: None, poses, spread, gates }
}

fn figures(one: &Found, fit: &Fit, radius_m: f64) -> PoseFigures {
    let distances: Vec<f64> = distances_m(one, fit, radius_m).collect();
    let sample = |points: &[Ranged]| -> Vec<Vector3<f64>> {
        points.iter().step_by(points.len().div_ceil(SAMPLES).max(1)).map(|ranged| ranged.point.coords).collect()
    };
    PoseFigures {
        normal: None,
        middle: one.camera.at.coords,
        points: (one.camera.points.len(), one.lidar.points.len()),
        rms_mm: (1e3 * one.camera.rms_m, 1e3 * one.lidar.rms_m),
        offset_mm: 1e3 * distances.iter().sum::<f64>() / distances.len().max(1) as f64,
        angle_deg: None,
        samples: (sample(&one.camera.points), sample(&one.lidar.points)),
        histogram: histogram(distances.iter().map(|distance| 1e3 * distance)),
    }
}
