//! What a depth camera's calibration has to reach.

use nalgebra::Isometry3;

use super::Found;
use super::solve::LEAST_BOARDS;
use super::state::{Lens, SCALE};
use crate::coverage::{LEAST_NORMALS, Spread, missing_tilts};
use crate::extrinsic::{PoseOutcome, place_gates, pose_gates, unsolved};
use crate::fit::Unsolved;
use crate::gate::Gate;

/// The share of the picture that boards must have been seen in: warns, fails.
const SEEN: (f64, f64) = (0.6, 0.3);
/// Farthest board over the nearest: below it scale and surface are not told apart.
const DEPTHS: (f64, f64) = (1.6, 1.2);
/// σ of the depth scale, %.
const SIGMA_SCALE: (f64, f64) = (0.1, 0.5);
/// Of the held-out map's cells, mm.
const LEFT_MM: (f64, f64) = (3.0, 8.0);
/// A focal length this far from the one it is said to have is none of this camera, %.
const FOCAL: (f64, f64) = (2.0, 5.0);
/// Depths that move by more in a minute are a camera's that is not warm yet, mm.
const DRIFT_MM: f64 = 1.0;

/// The gates where there is no result.
pub(super) fn without(poses: &[PoseOutcome], spread: &Spread, error: Unsolved) -> Vec<Gate> {
    let reasons: Vec<String> = poses.iter().filter_map(|pose| pose.left_aside.clone()).collect();
    let usable = poses.len() - reasons.len();
    let mut gates = pose_gates(usable, poses.len(), LEAST_BOARDS, &reasons);
    gates.push(unsolved(error, if usable >= 2 { missing_tilts(spread) } else { None }));
    gates
}

/// The gates of a result.
pub(super) fn gates(
    found: &Found,
    poses: &[PoseOutcome],
    spread: &Spread,
    depths: &[f64],
    start: &Isometry3<f64>,
    said: &Lens,
) -> Vec<Gate> {
    let reasons: Vec<String> = poses.iter().filter_map(|pose| pose.left_aside.clone()).collect();
    let mut gates = pose_gates(poses.len() - reasons.len(), poses.len(), LEAST_BOARDS, &reasons);
    let missing = missing_tilts(spread);
    let [_, _, least] = spread.sizes;
    let told = missing.as_deref().unwrap_or_default();
    gates.push(Gate::at_least("spread of the boards' normals", least, "", (None, Some(LEAST_NORMALS)), told));
    let (before, after) = &found.maps;
    gates.push(Gate::at_least(
        "share of the picture with boards in it",
        after.share(),
        "",
        (Some(SEEN.0), Some(SEEN.1)),
        "where no board was seen the surface is drawn from what lies beside: show boards in the corners and at the sides of the \
         Kinect's picture",
    ));
    let (near, far) = depths.iter().fold((f64::INFINITY, 0.0_f64), |(near, far), z| (near.min(*z), far.max(*z)));
    gates.push(Gate::at_least(
        "depth of the farthest board over the nearest",
        far / near,
        "",
        (Some(DEPTHS.0), Some(DEPTHS.1)),
        "all boards were about as far away: scale and surface are not told apart; show some at 1.2 m and some at 2.6 m",
    ));
    let scale = found.sigma.get(SCALE).copied().flatten().unwrap_or(f64::NAN);
    gates.push(Gate::at_most(
        "sigma of the depth scale",
        100.0 * scale,
        "%",
        (Some(SIGMA_SCALE.0), Some(SIGMA_SCALE.1)),
        "more boards, at more different depths",
    ));
    gates.extend(place_gates(&found.covariance, &found.state.t_lidar_camera, start, missing.as_deref()));
    gates.push(Gate::at_most(
        "held-out depths beyond the LiDAR's planes, r.m.s. over the picture",
        after.rms_mm().unwrap_or(f64::NAN),
        "mm",
        (Some(LEFT_MM.0), Some(LEFT_MM.1)),
        "the model does not follow this camera: see the map in the report; a board that is not flat, one that moved, or biased \
         LiDAR beams look the same",
    ));
    if let (Some(before), Some(after)) = (before.rms_mm(), after.rms_mm())
        && after > 1.1 * before.max(0.5)
    {
        gates.push(Gate::warned(
            "held-out depths against a scale alone",
            format!("{after:.1} mm with the model and {before:.1} mm with a scale alone: the boards are too few for the model"),
        ));
    }
    if found.model.pinhole {
        let lens = &found.state.lens;
        let off = (lens.fx / said.fx - 1.0).abs().max((lens.fy / said.fy - 1.0).abs());
        gates.push(Gate::at_most(
            "focal length from the config's",
            100.0 * off,
            "%",
            (Some(FOCAL.0), Some(FOCAL.1)),
            "the focal length found is far from the camera's: measure the board's sides, and look whether its edges are seen free",
        ));
    }
    if let Some(drift) = found.drift
        && drift.mm_per_minute.abs() > 3.0 * drift.sigma
    {
        gates.push(Gate::at_most(
            "drift of the depths",
            drift.mm_per_minute.abs(),
            "mm/min",
            (Some(DRIFT_MM), None),
            "the camera was not warm yet: let it run for ten minutes, then take the poses again",
        ));
    }
    gates
}
