//! POINT: the motion of one named point of the target.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::{Mode, NamedPoint, PointMotion, TargetMotion, TargetState, Validity};
use tumbled_model::{RigNs, Span, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// Where a point of the target is after an epoch, how it moves, and where it will be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: POINT")]
pub struct PointLine {
    /// POINT.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The epoch it follows.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// The point's name in the config.
    pub name: String,
    /// How much is known of the target.
    pub mode: Mode,
    /// How far it may be trusted.
    pub validity: Validity,
    /// The frame of positions, and of velocities' axes: `rig`.
    pub frame: String,
    /// m; null: nobody knows.
    pub position_m: Option<[f64; 3]>,
    /// m/s; null: nobody knows.
    pub velocity_mps: Option<[f64; 3]>,
    /// 6 × 6: position, m², then velocity, (m/s)²; null: nobody knows.
    pub covariance: Option<[[f64; 6]; 6]>,
    /// Where it will be, a prediction for each of `[stream] point_horizons_ms`; empty: nobody knows.
    pub predictions: Vec<PointPrediction>,
}

/// Where a point will be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PointPrediction {
    /// After the epoch's time, ms.
    pub after_ms: f64,
    /// The instant, ns on the session's timeline.
    pub t_ns: i64,
    /// m, rig frame.
    pub position_m: [f64; 3],
    /// m/s, rig axes.
    pub velocity_mps: [f64; 3],
    /// 6 × 6: position, m², then velocity, (m/s)².
    pub covariance: [[f64; 6]; 6],
}

/// A target's motion some time after an epoch.
#[derive(Clone, Debug, PartialEq)]
pub struct Ahead {
    /// How long after.
    pub after: Span,
    /// How it moves then.
    pub motion: TargetMotion,
}

impl PointLine {
    /// Of a point after an epoch; `unix` is the wall time at the epoch's, `ahead` the target later on.
    pub fn new(origin: StreamOrigin, state: &TargetState, unix: UnixNs, point: &NamedPoint, ahead: &[Ahead]) -> Self {
        let now = state.motion.as_ref().map(|motion| motion.point(&point.position_m));
        Self {
            class: Class::Point,
            origin,
            epoch: state.epoch,
            t_ns: state.t.0,
            unix_ns: unix.0.to_string(),
            name: point.name.clone(),
            mode: state.mode,
            validity: state.validity,
            frame: "rig".to_owned(),
            position_m: now.map(|point| point.position_m.into()),
            velocity_mps: now.map(|point| point.velocity_mps.into()),
            covariance: now.map(|point| rows(&point)),
            predictions: ahead.iter().map(|ahead| PointPrediction::new(state.t, ahead, &point.position_m)).collect(),
        }
    }
}

impl PointPrediction {
    fn new(t: RigNs, ahead: &Ahead, point: &Vector3<f64>) -> Self {
        let motion = ahead.motion.point(point);
        Self {
            after_ms: ahead.after.0 as f64 * 1e-6,
            t_ns: (t + ahead.after).0,
            position_m: motion.position_m.into(),
            velocity_mps: motion.velocity_mps.into(),
            covariance: rows(&motion),
        }
    }
}

fn rows(point: &PointMotion) -> [[f64; 6]; 6] {
    core::array::from_fn(|row| core::array::from_fn(|column| point.covariance[(row, column)]))
}
