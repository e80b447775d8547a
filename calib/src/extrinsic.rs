//! A calibrated place of a camera relative to a LiDAR: the result, its poses, and what it has to reach.

use nalgebra::{Isometry3, Vector3};

use crate::consistency::{Agreement, DROPPED_SHARE};
use crate::coverage::Spread;
use crate::fit::{Covariance, Fit, Unsolved, difference};
use crate::gate::Gate;

/// Fewer poses warn.
const WANTED_POSES: f64 = 10.0;
/// σ that warns and fails, degrees and mm, of the axis that is known worst.
const SIGMA_DEG: (f64, f64) = (0.2, 0.5);
const SIGMA_MM: (f64, f64) = (6.0, 15.0);
/// A result this far from the start is none: the drawing is wrong or the target was taken for something else.
const FROM_START: (f64, f64) = (15.0, 300.0);
/// Held-out poses: r.m.s. and mean of the LiDAR's points beyond the camera's surface, mm.
const HELD_OUT_MM: (f64, f64) = (30.0, 8.0);
/// The halves must agree within so many standard deviations.
const SPLIT_SIGMA: f64 = 3.0;
/// Variances this many times what the points' noise explains warn: something systematic is left.
const VARIANCE_FACTOR: f64 = 9.0;

/// A pose as the report has it.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseOutcome {
    /// Counts the poses from 0, in the order they were given.
    pub number: usize,
    /// Why it is not used; `None`: it is.
    pub left_aside: Option<String>,
    /// What the sensors saw; `None`: one of them did not see the target.
    pub seen: Option<PoseFigures>,
}

/// What the sensors saw in a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseFigures {
    /// The board's normal (length 1), or nothing of a sphere: in the camera's frame.
    pub normal: Option<Vector3<f64>>,
    /// The board's or sphere's middle in the camera's frame, m.
    pub middle: Vector3<f64>,
    /// Points: the camera's, the LiDAR's.
    pub points: (usize, usize),
    /// Root mean square distance from the surface of both sensors together, mm: the camera's points, the LiDAR's.
    pub rms_mm: (f64, f64),
    /// Mean distance of the LiDAR's points beyond the surface that the camera alone saw, mm.
    pub offset_mm: f64,
    /// Between the two sensors' own planes, degrees; `None`: a sphere.
    pub angle_deg: Option<f64>,
    /// Some of the camera's points in its frame, and of the LiDAR's in its own: for overlays.
    pub samples: (Vec<Vector3<f64>>, Vec<Vector3<f64>>),
    /// Distances of the LiDAR's points from the surface, mm, in classes from -75 mm on, each 5 mm wide, 30 in all.
    pub histogram: Vec<u32>,
}

/// Classes of [`PoseFigures::histogram`].
pub const CLASSES: usize = 30;
/// Their width, mm.
pub const CLASS_MM: f64 = 5.0;

/// Counts distances, mm, in classes.
pub(crate) fn histogram(distances_mm: impl Iterator<Item = f64>) -> Vec<u32> {
    let mut classes = vec![0; CLASSES];
    for distance in distances_mm {
        let class = ((distance + 0.5 * CLASSES as f64 * CLASS_MM) / CLASS_MM).floor();
        if class >= 0.0
            && let Some(count) = classes.get_mut(class as usize)
        {
            *count += 1;
        }
    }
    classes
}

/// What a calibration came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Extrinsic {
    /// Where it began: the config's place of the camera in the LiDAR's frame.
    pub start: Isometry3<f64>,
    /// The result and how the poses agree; `None`: there is none, and the gates say why.
    pub agreement: Option<Agreement>,
    /// The poses in their order.
    pub poses: Vec<PoseOutcome>,
    /// How the boards' normals or the spheres' middles are spread, in the camera's frame; of the poses used.
    pub spread: Spread,
    /// What was asked of it.
    pub gates: Vec<Gate>,
}

impl Extrinsic {
    /// The result where there is one.
    pub fn fit(&self) -> Option<&Fit> {
        self.agreement.as_ref().map(|agreement| &agreement.fit)
    }
}

/// The gates on how many poses there are.
pub(crate) fn pose_gates(used: usize, all: usize, least: usize, aside: &[String]) -> Vec<Gate> {
    let mut told: Vec<&String> = aside.iter().collect();
    told.dedup();
    let reasons: Vec<&str> = told.iter().take(3).map(|reason| reason.as_str()).collect();
    let why = if reasons.is_empty() { String::new() } else { format!("; left aside: {}", reasons.join("; ")) };
    let remedy = format!("{used} of {all} poses are usable, at least {least} are needed and 10 wanted: show more{why}");
    let mut gates =
        vec![Gate::at_least("usable poses", used as f64, "", (Some(WANTED_POSES), Some(least as f64)), &remedy)];
    if all > 0 {
        let share = aside.len() as f64 / all as f64;
        let remedy = format!("{} of {all} poses were left aside{why}", aside.len());
        gates.push(Gate::at_most("share of poses left aside", share, "", (Some(DROPPED_SHARE), Some(0.5)), &remedy));
    }
    gates
}

/// The gates on a camera's place: how well it is known, and how far it is from the config's.
pub(crate) fn place_gates(
    covariance: &Covariance,
    t_lidar_camera: &Isometry3<f64>,
    start: &Isometry3<f64>,
    missing: Option<&str>,
) -> Vec<Gate> {
    let sigma = |n: usize| covariance.get((n, n)).copied().unwrap_or_default().max(0.0).sqrt();
    let worst = |from: usize, unit: f64| (from..from + 3).map(sigma).fold(0.0, f64::max) * unit;
    let weak = missing.unwrap_or("more poses, nearer and more tilted, or a larger target");
    let moved = difference(t_lidar_camera, start, 0.0);
    let (rotation, translation) = (moved.fixed_rows::<3>(0).norm().to_degrees(), 1e3 * moved.fixed_rows::<3>(3).norm());
    let remedy = "the result is far from the config's mounting: correct the mounting in the config if it is wrong, else the \
                  target was taken for something else";
    vec![
        Gate::at_most(
            "sigma of the rotation",
            worst(0, 180.0 / core::f64::consts::PI),
            "deg",
            (Some(SIGMA_DEG.0), Some(SIGMA_DEG.1)),
            weak,
        ),
        Gate::at_most("sigma of the translation", worst(3, 1e3), "mm", (Some(SIGMA_MM.0), Some(SIGMA_MM.1)), weak),
        Gate::at_most("rotation from the config's", rotation, "deg", (None, Some(FROM_START.0)), remedy),
        Gate::at_most("translation from the config's", translation, "mm", (None, Some(FROM_START.1)), remedy),
    ]
}

/// The gates on a result.
pub(crate) fn result_gates(agreement: &Agreement, start: &Isometry3<f64>, missing: Option<&str>) -> Vec<Gate> {
    let fit = &agreement.fit;
    let mut gates = place_gates(&fit.covariance, &fit.t_lidar_camera, start, missing);
    gates.push(Gate::at_most(
        "disagreement of the sensors over the points' noise",
        fit.chi_square / fit.freedom.max(1) as f64,
        "",
        (Some(VARIANCE_FACTOR), None),
        "the two sensors' surfaces differ by more than noise: a warped depth, a moving target, or a wrong lens model; the \
         covariance has been enlarged by it",
    ));
    if let Some(worst) = agreement.left_out.iter().map(|left| left.shift_sigma).max_by(f64::total_cmp) {
        gates.push(Gate::at_most(
            "largest shift when one pose is left out",
            worst,
            "sigma",
            (Some(3.0), None),
            "the result hangs on single poses: add more of their kind",
        ));
    }
    gates.push(match agreement.split {
        Some(split) => Gate::at_most(
            "odd poses against even ones",
            split.sigma,
            "sigma",
            (Some(SPLIT_SIGMA), None),
            "the two halves of the poses tell different places: something moved between them, or more poses are needed",
        ),
        None => Gate::warned("odd poses against even ones", "half of the poses do not fix the result: add more"),
    });
    match agreement.held_out {
        Some(held) => {
            let (rms, mean) = HELD_OUT_MM;
            let remedy = "poses that were not used do not fit: see them in the report, and take new ones";
            gates.push(Gate::at_most("held-out points: r.m.s.", held.rms_mm, "mm", (None, Some(rms)), remedy));
            gates.push(Gate::at_most("held-out points: mean", held.mean_mm.abs(), "mm", (None, Some(mean)), remedy));
        }
        None => gates.push(Gate::warned("held-out points", "too few poses to hold some back: add more")),
    }
    gates
}

/// The gate of a set of poses without a result.
pub(crate) fn unsolved(error: Unsolved, missing: Option<String>) -> Gate {
    Gate::failed("solution", missing.map_or_else(|| error.to_string(), |missing| format!("{error}; {missing}")))
}
