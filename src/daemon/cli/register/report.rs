//! What `register` reports.

use nalgebra::{Isometry3, Matrix6};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::register::{Method, Mode, Registration, SensorKind};

use super::arguments::Sensors;
use crate::clouds::ReadCloud;
use crate::experiment::trial::reason;

/// The result of a registration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled register --json")]
pub struct RegisterReport {
    /// Coordinates of MOVING to coordinates of REFERENCE.
    pub t_reference_moving: PoseReport,
    /// Covariance of the twist ξ in `Exp(ξ) T`: left perturbation, frame of REFERENCE, rotation first, rad² and m².
    pub covariance: [[f64; 6]; 6],
    /// Whether it may be used as a measurement. If not, it is the best candidate all the same.
    pub accepted: bool,
    /// Why it is not accepted; null: it is.
    pub reason: Option<String>,
    /// How well the pose explains what both sensors saw: 1 and more is very well.
    pub score: f64,
    /// By how much the best other mode scores less; null: none was looked for, or none was found.
    pub gap: Option<f64>,
    /// The share of the sparser cloud's points that lie on the surface.
    pub inliers: f64,
    /// Their root mean square distance from it, m.
    pub rmse_m: f64,
    /// Iterations of the refinement.
    pub iterations: u32,
    /// Wall time from loaded clouds to the result, ms: normals, grids, search, verification; not the reading of files.
    pub time_ms: f64,
    /// Other poses that explain the clouds, best first.
    pub alternatives: Vec<Alternative>,
    /// The method.
    pub method: String,
    /// The probability of the pose among those found; 1 where no other was looked for.
    pub probability: f64,
    /// The moving cloud.
    pub moving: CloudReport,
    /// The reference.
    pub reference: CloudReport,
}

/// A pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseReport {
    /// x, y, z, m.
    pub translation_m: [f64; 3],
    /// A unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

/// Another mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Alternative {
    /// Coordinates of MOVING to coordinates of REFERENCE.
    pub t_reference_moving: PoseReport,
    /// Its score.
    pub score: f64,
    /// Its probability among the poses found.
    pub probability: f64,
}

/// What was read of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CloudReport {
    /// `lidar` or `kinect`: as stated, or by density.
    pub sensor: String,
    /// Finite points.
    pub points: u64,
    /// Points left out because they are not finite.
    pub not_finite: u64,
}

impl RegisterReport {
    pub(super) fn new(
        method: Method,
        [moving, reference]: [&ReadCloud; 2],
        sensors: Sensors,
        found: &Registration,
        time_ms: f64,
    ) -> Self {
        let alternative = |mode: &Mode| Alternative {
            t_reference_moving: (&mode.t_reference_moving).into(),
            score: mode.score,
            probability: mode.probability,
        };
        Self {
            t_reference_moving: (&found.t_reference_moving).into(),
            covariance: rows(&found.covariance),
            accepted: found.accepted,
            reason: reason(found),
            score: found.score,
            gap: found.gap,
            inliers: found.inliers,
            rmse_m: found.rmse_m,
            iterations: found.iterations,
            time_ms,
            alternatives: found.alternatives.iter().map(alternative).collect(),
            method: method.name().to_owned(),
            probability: found.probability,
            moving: CloudReport::new(moving, sensors.moving),
            reference: CloudReport::new(reference, sensors.reference),
        }
    }
}

impl CloudReport {
    fn new(cloud: &ReadCloud, sensor: SensorKind) -> Self {
        let sensor = match sensor {
            SensorKind::Lidar => "lidar",
            SensorKind::Kinect => "kinect",
        };
        Self { sensor: sensor.to_owned(), points: cloud.points.len() as u64, not_finite: cloud.not_finite as u64 }
    }
}

impl From<&Isometry3<f64>> for PoseReport {
    fn from(pose: &Isometry3<f64>) -> Self {
        let q = pose.rotation.coords;
        // q and −q are one rotation: the one with w ≥ 0 is written.
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        Self { translation_m: pose.translation.vector.into(), rotation_xyzw: [q.x, q.y, q.z, q.w].map(|n| sign * n) }
    }
}

fn rows(matrix: &Matrix6<f64>) -> [[f64; 6]; 6] {
    // Column by column: the matrix is symmetric.
    (*matrix).into()
}
