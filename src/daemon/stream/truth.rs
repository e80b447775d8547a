//! TRUTH: where a simulated target truly is, to be shown beside what was measured.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::evaluate::TruthSample;
use tumbled_model::{RigNs, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// A simulated target at an epoch's time. The origin of its frame is the mesh's: another one than STATE's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: TRUTH")]
pub struct TruthLine {
    /// TRUTH.
    pub class: Class,
    /// Where the data come from: never `live`.
    pub origin: StreamOrigin,
    /// The epoch.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// Origin of the mesh's frame in the rig's, m.
    pub position_m: [f64; 3],
    /// The mesh's axes in the rig, a unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
    /// Rig axes, rad/s.
    pub angular_velocity_rps: [f64; 3],
    /// The spin's axis, of length 1, rig axes; null: it does not turn.
    pub axis: Option<[f64; 3]>,
    /// Its rate, °/s.
    pub rate_dps: f64,
}

impl TruthLine {
    /// At an epoch; `unix` is the wall time at the sample's.
    pub fn new(origin: StreamOrigin, epoch: u64, sample: &TruthSample, unix: UnixNs) -> Self {
        let RigNs(t_ns) = sample.t;
        let (pose, spin) = (&sample.t_rig_target, sample.angular_velocity_rps);
        let q = pose.rotation;
        Self {
            class: Class::Truth,
            origin,
            epoch,
            t_ns,
            unix_ns: unix.0.to_string(),
            position_m: pose.translation.vector.into(),
            rotation_xyzw: [q.i, q.j, q.k, q.w],
            angular_velocity_rps: spin.into(),
            axis: spin.try_normalize(1e-9).map(Into::into),
            rate_dps: spin.norm().to_degrees(),
        }
    }
}
