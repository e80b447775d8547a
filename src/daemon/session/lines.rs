//! Epochs as lines of text: what a session made of its data, for people and scripts.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::{ClockState, Epoch, Scan, TimeBasis};
use tumbled_model::UnixNs;

/// One epoch, without its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled replay --epochs")]
pub struct EpochLine {
    /// EPOCH.
    pub class: String,
    /// Counts the epochs from 0.
    pub epoch: u64,
    /// The sensor.
    pub sensor: String,
    /// `kinect` or `lidar`.
    pub kind: String,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// One standard deviation of `t_ns`, the unknown least delay excluded.
    pub sigma_ns: i64,
    /// The state of the sensor's clock; null: the time is the arrival's.
    #[schemars(with = "Option<String>")]
    pub clock: Option<ClockState>,
    /// When the host had the last of it, ns.
    pub arrived_ns: i64,
    /// Points.
    pub points: u64,
    /// Points in the region of interest.
    pub points_in_roi: u64,
    /// LiDAR: how much of the region of interest the head was seen to sweep, 0..=1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coverage: Option<f64>,
}

impl EpochLine {
    /// The line of an epoch; `unix` is its wall time.
    pub fn new(epoch: &Epoch, unix: UnixNs) -> Self {
        Self {
            class: "EPOCH".to_owned(),
            epoch: epoch.number,
            sensor: epoch.sensor.to_string(),
            kind: epoch.scan.kind().to_owned(),
            t_ns: epoch.t.0,
            unix_ns: unix.0.to_string(),
            sigma_ns: epoch.sigma.0,
            clock: match epoch.basis {
                TimeBasis::Device(state) => Some(state),
                TimeBasis::Arrival => None,
            },
            arrived_ns: epoch.arrived.0,
            points: epoch.scan.len() as u64,
            points_in_roi: epoch.rig.points_in_roi() as u64,
            coverage: match &epoch.scan {
                Scan::Lidar(scan) => Some(scan.coverage),
                Scan::Kinect(_) => None,
            },
        }
    }
}
