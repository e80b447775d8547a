//! The sections of the config that are about a session rather than about the rig: time, filter,
//! stream, record.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::session::{DEFAULT_CONTROL_SOCKET, DEFAULT_HTTP, DEFAULT_STREAM_SOCKET};

/// How the sensors' data are brought to one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawTime {
    /// Milliseconds an epoch waits at most for the data of the other sensors.
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub hold_ms: f64,
    /// Milliseconds of silence after which a sensor is no longer waited for; half a second at least, which a returning
    /// sensor takes to be waited for again.
    #[schemars(range(min = 500.0, max = 3_600_000.0))]
    pub silent_after_ms: f64,
    /// How device stamps become times: `hull` takes the least delayed arrivals, `kalman` their mean delay, `arrival`
    /// believes no device clock.
    pub clock: ClockMethod,
}

impl Default for RawTime {
    fn default() -> Self {
        Self { hold_ms: 150.0, silent_after_ms: 2_000.0, clock: ClockMethod::Hull }
    }
}

/// How device stamps become times on the session's timeline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ClockMethod {
    /// By the lower convex hull of the arrivals: free of jitter and queueing.
    #[default]
    Hull,
    /// By a filter of the mean delay: smooth, but late by that mean. For comparison.
    Kalman,
    /// By the arrivals alone: every delay is an error of time. For comparison, and for broken device clocks.
    Arrival,
}

/// How the target's motion is estimated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawFilter {
    /// `ours`, or `paper`: Algorithm 1 of the publication, for comparison.
    pub method: FilterMethodName,
    /// How the target may turn: `fixed-axis` on a turntable, `tumble` when free; `auto` begins with a fixed axis and
    /// goes over to a tumble when the axis does not stay.
    pub motion: MotionName,
    /// Mean motion of the orbit that is imitated, rad/s: 0 where nothing falls.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub mean_motion_rps: f64,
    /// The orbit's point of reference, rig frame, m; left out: where the target is acquired.
    pub orbit_center_m: Option<[f64; 3]>,
}

impl Default for RawFilter {
    fn default() -> Self {
        Self { method: FilterMethodName::Ours, motion: MotionName::Auto, mean_motion_rps: 0.0, orbit_center_m: None }
    }
}

/// Which filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FilterMethodName {
    /// On twists, with the sensors' calibration errors in the state.
    #[default]
    Ours,
    /// Algorithm 1 of Li et al. 2021.
    Paper,
}

/// How a target may turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MotionName {
    /// Found out while it is tracked.
    #[default]
    Auto,
    /// About an axis that stays.
    FixedAxis,
    /// Free, with an unknown inertia.
    Tumble,
}

/// Which states telemetry sends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TelemetryKinds {
    /// Those of measurement epochs.
    #[default]
    Epoch,
    /// Those predicted to the moment of sending.
    Predicted,
    /// Both.
    Both,
}

impl TelemetryKinds {
    /// Whether it sends the states of epochs.
    pub const fn epochs(self) -> bool {
        matches!(self, Self::Epoch | Self::Both)
    }

    /// Whether it sends predicted states.
    pub const fn predicted(self) -> bool {
        matches!(self, Self::Predicted | Self::Both)
    }
}

/// Where the state is told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawStream {
    /// Address and port of the state stream; port 0 = any free port; empty: none.
    pub tcp: String,
    /// Unix socket of the state stream; empty: none.
    pub unix: String,
    /// Unix socket where operators give orders; empty: none.
    pub control: String,
    /// Address and port of the operator's page and of the metrics; port 0 = any free port; empty: none.
    pub http: String,
    /// Whether the operator's page may give orders (`POST /api/control`), from this machine alone.
    pub http_control: bool,
    /// Address and port where viewers that speak the Foxglove protocol connect; port 0 = any free port; empty: none.
    pub foxglove: String,
    /// Where telemetry is sent, a UDP datagram for each state: address and port; empty: nowhere.
    pub telemetry: String,
    /// Which states telemetry sends: `epoch` those of measurements, `predicted` those at `rate_hz`, or `both`.
    pub telemetry_kind: TelemetryKinds,
    /// Predicted states a second, of a live or paced session, predicted to the moment they are sent; 0: none. At least
    /// one in ten seconds.
    #[schemars(range(min = 0.0, max = 1_000.0))]
    pub rate_hz: f64,
    /// Milliseconds after each epoch for which the motion of the points of interest is predicted; at most 8, above 0,
    /// at most 10 s, one above the other; empty: none.
    pub point_horizons_ms: Vec<f64>,
    /// Points of a cloud that a client is sent at most; of more, evenly chosen ones.
    #[schemars(range(min = 1, max = 100_000))]
    pub max_cloud_points: u32,
}

impl Default for RawStream {
    fn default() -> Self {
        Self {
            tcp: "127.0.0.1:7117".to_owned(),
            unix: DEFAULT_STREAM_SOCKET.to_owned(),
            control: DEFAULT_CONTROL_SOCKET.to_owned(),
            http: DEFAULT_HTTP.to_string(),
            http_control: false,
            foxglove: "127.0.0.1:8765".to_owned(),
            telemetry: String::new(),
            telemetry_kind: TelemetryKinds::Epoch,
            rate_hz: 100.0,
            point_horizons_ms: vec![100.0, 500.0, 1_000.0],
            max_cloud_points: 2_000,
        }
    }
}

/// How recordings are written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawRecord {
    /// A recording ends when less than this is free on its disk, e.g. 1GiB; empty: when the disk is full.
    pub min_free: String,
    /// A new part begins when this one has so many bytes, e.g. 4GiB; empty: never by size.
    pub rotate: String,
    /// A new part begins when this one covers so much time, e.g. 10m; empty: never by time.
    pub rotate_after: String,
    /// How many of the newest parts are kept; 0 = all.
    #[schemars(range(max = 1_000_000))]
    pub keep: u32,
    /// How much of the past a running session keeps for `tumbled ctl snapshot`, e.g. 30s; empty: nothing.
    pub pretrigger: String,
    /// Memory for it, e.g. 256MiB: where the sensors send more, it reaches less far back. At most 4GiB.
    pub pretrigger_bytes: String,
}

impl Default for RawRecord {
    fn default() -> Self {
        Self {
            min_free: "1GiB".to_owned(),
            rotate: "4GiB".to_owned(),
            rotate_after: "10m".to_owned(),
            keep: 0,
            pretrigger: "30s".to_owned(),
            pretrigger_bytes: "256MiB".to_owned(),
        }
    }
}
