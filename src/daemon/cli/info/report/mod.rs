//! What `tumbled info --json` prints. Absent things are null, never left out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub mod config;
pub mod hdl64e;
pub mod input;
pub mod kinect;
pub mod lidar;

pub use config::{ConfigOrigin, UsedConfig};
pub use input::InputReport;
pub use kinect::KinectReport;
pub use lidar::LidarReport;

/// What the inputs hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled info --json")]
pub struct InfoReport {
    /// Wall time at `t_ns` 0, ns since 1970-01-01 UTC as a decimal string: the earliest host stamp over all inputs. Null:
    /// no record, or the inputs have no times of their own.
    pub epoch_unix_ns: Option<String>,
    /// The config the inputs were read with.
    pub config: UsedConfig,
    /// The inputs, in the order given.
    pub inputs: Vec<InputReport>,
    /// The LiDARs of the config that have any payload in the inputs, in the config's order.
    pub lidars: Vec<LidarReport>,
    /// The Kinects of the config that have any frame in the inputs, in the config's order.
    pub kinects: Vec<KinectReport>,
    /// The sensors of the config that have nothing in the inputs.
    pub absent: Vec<Absent>,
    /// What is missing, all in all.
    pub verdict: Verdict,
}

/// A sensor of the config that has nothing in the inputs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Absent {
    /// What it is.
    pub kind: SensorKind,
    /// Its id.
    pub id: String,
}

/// Kinds of sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorKind {
    /// A Velodyne LiDAR.
    Lidar,
    /// A Kinect v1.
    Kinect,
}

/// What is missing, all in all.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// Every input could be read and delivered whole; otherwise the exit code is 3.
    pub inputs_whole: bool,
    /// LiDAR packets that the stamps say were sent and that the inputs do not hold, over all LiDARs.
    pub lidar_packets_lost: u64,
    /// LiDAR payloads that gave no points, over all LiDARs.
    pub lidar_payloads_rejected: u64,
    /// USB packets missing in the depth frames, over all Kinects.
    pub kinect_packets_lost: u64,
    /// Depth frames that the device's stamps say were made and that the inputs do not hold, over all Kinects.
    pub kinect_frames_missing: u64,
    /// Depth frames that could not be decoded, over all Kinects.
    pub kinect_frames_refused: u64,
    /// Depth frames that repeat the one before them, over all Kinects.
    pub kinect_frames_repeated: u64,
}

/// An instant on the wall clock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallTime {
    /// Nanoseconds since 1970-01-01 UTC, a decimal string.
    pub unix_ns: String,
    /// The same for people: RFC 3339 in UTC, nine decimals.
    pub utc: String,
}

impl From<tumbled_model::UnixNs> for WallTime {
    fn from(t: tumbled_model::UnixNs) -> Self {
        Self { unix_ns: t.0.to_string(), utc: tumbled_model::CivilTime::from_unix(t).to_string() }
    }
}

/// Which clock a rate was measured with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RateClock {
    /// The sensor's own stamps.
    Device,
    /// The host stamps of the inputs.
    Host,
}

/// Smallest, middle and greatest of many numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// The smallest.
    pub min: f64,
    /// Half of the numbers are smaller; to the nearest centimetre (LiDAR ranges) or millimetre (Kinect depths).
    pub median: f64,
    /// The greatest.
    pub max: f64,
}

/// Something that could not be used, and how often.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Refusal {
    /// Why, with the remedy; where it names a value found, that of the first.
    pub reason: String,
    /// How often.
    pub count: u64,
}
