//! A board shown to both sensors in several poses.
//!
//! ```text
//!   views ─ camera (flat region of the board's size) ─ lidar (near it) ─ start (closed form, consensus)
//!         ─ lidar again, close to the board ─ joint (planes unknown, Huber) ─ agreement ─ gates
//! ```

mod camera;
mod joint;
mod lidar;
mod start;

use nalgebra::{Isometry3, Vector3};

use crate::consistency::{PoseSet, agree};
use crate::coverage::{LEAST_NORMALS, Spread, missing_tilts};
use crate::extrinsic::{Extrinsic, PoseFigures, PoseOutcome, histogram, pose_gates, result_gates, unsolved};
use crate::fit::{Fit, Unsolved};
use crate::gate::Gate;
use crate::plane::{Moments, Plane};
use crate::robust::{huber, scale};
use crate::view::{Ranged, View};

pub use camera::{BoardSize, NotSeen, Seen};
pub use joint::{Board, LEAST_POSES};
pub(crate) use joint::{inverse, lidar_parameters, lidar_rows};
pub use lidar::NotHit;

/// Rounds of new weights after the first.
const ROUNDS: usize = 3;
/// Camera points of a pose at most: more cost time and tell nothing new, neighbours share their noise.
const CAMERA_POINTS: usize = 4_000;
/// Points of a pose kept for overlays, of either sensor.
const SAMPLES: usize = 150;
/// The depth scale is solved for with so many poses at depths of such a ratio: else a wrong one hides in the translation.
const SCALE_POSES: usize = 12;
const SCALE_RATIO: f64 = 1.6;

/// A pose in which both sensors have the board.
pub(crate) struct Found {
    /// Which of the poses.
    pub(crate) number: usize,
    /// The camera's rectangle.
    pub(crate) seen: Seen,
    camera: Vec<Ranged>,
    /// The LiDAR's points.
    pub(crate) lidar: Vec<Ranged>,
    /// Their plane.
    pub(crate) lidar_plane: Plane,
}

/// The boards with weights, for solving with any of them.
struct Boards {
    boards: Vec<Board>,
    /// The LiDAR's points, unweighted.
    lidar: Vec<Moments>,
    with_scale: bool,
}

impl PoseSet for Boards {
    fn solve(&self, which: &[usize], start: &Isometry3<f64>) -> Result<Fit, Unsolved> {
        let boards: Vec<Board> = which.iter().filter_map(|pose| self.boards.get(*pose)).copied().collect();
        joint::solve(&boards, start, self.with_scale).map(|(fit, _)| fit)
    }

    fn beyond(&self, pose: usize, fit: &Fit) -> (f64, f64, usize) {
        let (Some(board), Some(lidar)) = (self.boards.get(pose), self.lidar.get(pose)) else { return (0.0, 0.0, 0) };
        let plane = in_lidar(&board.plane, &fit.t_lidar_camera, fit.depth_scale.unwrap_or(1.0));
        let (rms, mean) = lidar.distances_m(&plane);
        let count = lidar.count as f64;
        (rms * rms * count, mean * count, lidar.count)
    }
}

/// A plane that the camera measured, its depths scaled, in the LiDAR's frame.
fn in_lidar(plane: &Plane, t: &Isometry3<f64>, depth_scale: f64) -> Plane {
    let normal = t.rotation * plane.normal;
    Plane { normal, distance_m: depth_scale * plane.distance_m + normal.dot(&t.translation.vector) }
}

/// Calibrates; `start` is the config's place of the camera in the LiDAR's frame.
pub fn calibrate(views: &[View], size: &BoardSize, start: &Isometry3<f64>) -> Extrinsic {
    let located = match locate(views, size, start) {
        Ok(located) => located,
        Err(failed) => {
            let (poses, spread, error) = *failed;
            return without(poses, start, spread, error);
        }
    };
    let Located { mut poses, boards: close, t } = located;
    let spread = self::spread(&close);
    let with_scale = scale_is_fixed(&close);
    let solved = weighted(&close, &t, with_scale).and_then(|(boards, planes)| {
        let agreement = agree(&boards, (0..close.len()).collect(), views.len(), &t)?;
        Ok((boards, planes, agreement))
    });
    let (boards, planes, agreement) = match solved {
        Ok(solved) => solved,
        Err(error) => return without(poses, start, spread, error),
    };
    for dropped in &agreement.dropped {
        if let Some(one) = close.get(dropped.pose) {
            let why = format!("it moves the result by {:.1} sigma", dropped.shift_sigma);
            aside(&mut poses, one.number, why);
        }
    }
    for (place, (one, plane)) in close.iter().zip(&planes).enumerate() {
        if let (Some(pose), Some(board)) = (poses.get_mut(one.number), boards.boards.get(place)) {
            pose.seen = Some(figures(one, board, plane, &agreement.fit));
        }
    }
    let used: Vec<&Found> = agreement.used.iter().filter_map(|place| close.get(*place)).collect();
    let normals: Vec<Vector3<f64>> = used.iter().map(|one| one.seen.plane.normal).collect();
    let spread = Spread::of_normals(&normals);
    let missing = missing_tilts(&spread);
    let reasons: Vec<String> = poses.iter().filter_map(|pose| pose.left_aside.clone()).collect();
    let mut gates = pose_gates(used.len(), views.len(), LEAST_POSES, &reasons);
    let [_, _, least] = spread.sizes;
    let remedy = missing.as_deref().unwrap_or_default();
    gates.push(Gate::at_least("spread of the boards' normals", least, "", (None, Some(LEAST_NORMALS)), remedy));
    gates.extend(result_gates(&agreement, start, missing.as_deref()));
    if !with_scale {
        gates.push(Gate::warned(
            "depth scale",
            "taken as 1: it is solved for with 12 poses or more whose depths have a ratio of 1.6; one off by 1 % costs about \
             18 mm and 0.3 degrees",
        ));
    }
    // Places in the agreement are of the boards found, the report's are of the poses shown.
    let agreement = agreement.renumbered(&close.iter().map(|one| one.number).collect::<Vec<_>>());
    Extrinsic { start: *start, agreement: Some(agreement), poses, spread, gates }
}

/// The boards of both sensors, and a first place of the sensors.
pub(crate) struct Located {
    /// All poses, those that are left aside with the reason.
    pub(crate) poses: Vec<PoseOutcome>,
    /// The boards in the others.
    pub(crate) boards: Vec<Found>,
    /// The camera in the LiDAR's frame by their planes.
    pub(crate) t: Isometry3<f64>,
}

/// Why boards have no place: the poses, how they lie, and what is missing.
pub(crate) type NotLocated = (Vec<PoseOutcome>, Spread, Unsolved);

fn aside(poses: &mut [PoseOutcome], number: usize, why: String) {
    if let Some(pose) = poses.get_mut(number) {
        pose.left_aside = Some(why);
    }
}

/// Finds the board in both sensors, and the place at which most of the planes agree.
pub(crate) fn locate(views: &[View], size: &BoardSize, start: &Isometry3<f64>) -> Result<Located, Box<NotLocated>> {
    let mut poses: Vec<PoseOutcome> =
        (0..views.len()).map(|number| PoseOutcome { number, left_aside: None, seen: None }).collect();
    let mut found: Vec<Found> = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let one = camera::find(&view.camera, size).map_err(|error| error.to_string()).and_then(|seen| {
            let (lidar_plane, lidar) =
                lidar::find(&view.lidar, &seen, start, &lidar::Margin::GUESS).map_err(|error| error.to_string())?;
            let camera = seen.points.iter().step_by(seen.points.len().div_ceil(CAMERA_POINTS)).copied().collect();
            Ok(Found { number, seen, camera, lidar, lidar_plane })
        });
        match one {
            Ok(one) => found.push(one),
            Err(why) => aside(&mut poses, number, why),
        }
    }
    let spread = spread(&found);
    let begun = start::closed_form(&planes(&found));
    let (t, agreeing) = match begun {
        Ok(begun) => begun,
        Err(error) => return Err(Box::new((poses, spread, error))),
    };
    let mut close: Vec<Found> = Vec::new();
    for (one, agrees) in found.into_iter().zip(agreeing) {
        let number = one.number;
        if !agrees {
            let why = "its two planes do not fit the other poses: one sensor saw something else, e.g. a wall";
            aside(&mut poses, number, why.to_owned());
            continue;
        }
        let lidar = views.get(number).map_or(&[][..], |view| &view.lidar);
        match lidar::find(lidar, &one.seen, &t, &lidar::Margin::FOUND) {
            Ok((lidar_plane, lidar)) => close.push(Found { lidar, lidar_plane, ..one }),
            Err(why) => aside(&mut poses, number, why.to_string()),
        }
    }
    Ok(Located { poses, boards: close, t })
}

fn without(poses: Vec<PoseOutcome>, start: &Isometry3<f64>, spread: Spread, error: Unsolved) -> Extrinsic {
    let reasons: Vec<String> = poses.iter().filter_map(|pose| pose.left_aside.clone()).collect();
    let usable = poses.len() - reasons.len();
    let mut gates = pose_gates(usable, poses.len(), LEAST_POSES, &reasons);
    let missing = if usable >= 2 { missing_tilts(&spread) } else { None };
    gates.push(unsolved(error, missing));
    Extrinsic { start: *start, agreement: None, poses, spread, gates }
}

fn planes(found: &[Found]) -> Vec<(Plane, Plane)> {
    found.iter().map(|one| (one.seen.plane, one.lidar_plane)).collect()
}

fn spread(found: &[Found]) -> Spread {
    Spread::of_normals(&found.iter().map(|one| one.seen.plane.normal).collect::<Vec<_>>())
}

fn scale_is_fixed(found: &[Found]) -> bool {
    let depths = || found.iter().map(|one| one.seen.middle.z);
    let (near, far) = (depths().fold(f64::INFINITY, f64::min), depths().fold(0.0, f64::max));
    found.len() >= SCALE_POSES && far >= SCALE_RATIO * near
}

/// The boards with Huber's weights about the planes of both sensors together, and those planes.
fn weighted(found: &[Found], t: &Isometry3<f64>, with_scale: bool) -> Result<(Boards, Vec<Plane>), Unsolved> {
    // First each sensor's own plane: nothing is known of the other's yet.
    let mut surfaces: Vec<(Plane, Plane)> = planes(found);
    let mut depth_scale = 1.0;
    let mut start = *t;
    let mut round = 0;
    loop {
        let boards = boards(found, &surfaces, depth_scale, with_scale);
        let (fit, planes) = joint::solve(&boards.boards, &start, with_scale)?;
        if round == ROUNDS {
            return Ok((boards, planes));
        }
        round += 1;
        (start, depth_scale) = (fit.t_lidar_camera, fit.depth_scale.unwrap_or(1.0));
        // A joint plane's normal is the camera's; in the LiDAR's frame its depths are scaled already.
        surfaces = planes.iter().map(|plane| (*plane, in_lidar(plane, &start, 1.0))).collect();
    }
}

/// Moments by weights about given surfaces: each sensor's noise is what its own residuals tell.
fn boards(found: &[Found], surfaces: &[(Plane, Plane)], depth_scale: f64, with_scale: bool) -> Boards {
    let scaled = |ranged: &Ranged| Ranged { point: ranged.point * depth_scale, ..*ranged };
    let of_camera = |one: &Found, plane: &Plane| -> Vec<f64> {
        one.camera.iter().map(|ranged| plane.residual(&scaled(ranged))).collect()
    };
    let of_lidar =
        |one: &Found, plane: &Plane| -> Vec<f64> { one.lidar.iter().map(|ranged| plane.residual(ranged)).collect() };
    let both = || found.iter().zip(surfaces);
    let mut all_camera: Vec<f64> = both().flat_map(|(one, (plane, _))| of_camera(one, plane)).collect();
    let mut all_lidar: Vec<f64> = both().flat_map(|(one, (_, plane))| of_lidar(one, plane)).collect();
    let (camera_scale, lidar_scale) = (scale(&mut all_camera), scale(&mut all_lidar));
    let moments = |points: &[Ranged], residuals: &[f64], plane: &Plane, scale: f64, stretch: f64| {
        let mut moments = Moments::default();
        for (ranged, residual) in points.iter().zip(residuals) {
            let at = Ranged { point: ranged.point * stretch, ..*ranged };
            let root = plane.weight_root(&at) / scale;
            let upright = plane.set_upright(&at.point) / stretch;
            moments.add(&upright, huber(residual / scale) * root * root);
        }
        moments
    };
    let mut boards = Boards { boards: Vec::new(), lidar: Vec::new(), with_scale };
    for (one, (camera_plane, lidar_plane)) in both() {
        boards.boards.push(Board {
            plane: one.seen.plane,
            camera: moments(&one.camera, &of_camera(one, camera_plane), camera_plane, camera_scale, depth_scale),
            lidar: moments(&one.lidar, &of_lidar(one, lidar_plane), lidar_plane, lidar_scale, 1.0),
        });
        let mut unweighted = Moments::default();
        one.lidar.iter().for_each(|ranged| unweighted.add(&ranged.point, 1.0));
        boards.lidar.push(unweighted);
    }
    boards
}

fn figures(one: &Found, board: &Board, plane: &Plane, fit: &Fit) -> PoseFigures {
    let depth_scale = fit.depth_scale.unwrap_or(1.0);
    let rms = |squares: f64, count: usize| 1e3 * (squares / count.max(1) as f64).sqrt();
    let camera: f64 = one
        .camera
        .iter()
        .map(|ranged| plane.beyond_m(&(ranged.point * depth_scale)))
        .fold(0.0, |sum, off| sum + off * off);
    let surface = in_lidar(plane, &fit.t_lidar_camera, 1.0);
    let distances = || one.lidar.iter().map(|ranged| surface.beyond_m(&ranged.point));
    let lidar: f64 = distances().fold(0.0, |sum, off| sum + off * off);
    let of_camera = in_lidar(&board.plane, &fit.t_lidar_camera, depth_scale);
    let offset: f64 = one.lidar.iter().map(|ranged| of_camera.beyond_m(&ranged.point)).sum();
    let cosine = of_camera.normal.dot(&one.lidar_plane.normal);
    let sine = of_camera.normal.cross(&one.lidar_plane.normal).norm();
    let sample = |points: &[Ranged]| -> Vec<Vector3<f64>> {
        points.iter().step_by(points.len().div_ceil(SAMPLES).max(1)).map(|ranged| ranged.point.coords).collect()
    };
    PoseFigures {
        normal: Some(one.seen.plane.normal),
        middle: one.seen.middle.coords,
        points: (one.camera.len(), one.lidar.len()),
        rms_mm: (rms(camera, one.camera.len()), rms(lidar, one.lidar.len())),
        offset_mm: 1e3 * offset / one.lidar.len().max(1) as f64,
        angle_deg: Some(libm::atan2(sine, cosine).to_degrees()),
        samples: (sample(&one.camera), sample(&one.lidar)),
        histogram: histogram(distances().map(|distance| 1e3 * distance)),
    }
}
