//! What a checked config says about a session: time, stream, record.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::time::Duration;

use tumbled_io::recording::RingBound;
use tumbled_model::Span;

use super::raw_session::{ClockMethod, TelemetryKinds};

/// The state stream's Unix socket unless the config names another.
pub const DEFAULT_STREAM_SOCKET: &str = "/run/tumbled/state.sock";

/// The control socket unless the config names another.
pub const DEFAULT_CONTROL_SOCKET: &str = "/run/tumbled/control.sock";

/// Where the operator's page is served unless the config names another address. That it is taken is a warning: another
/// `tumbled`, or any other program, may have it.
pub const DEFAULT_HTTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 8080));

/// How the sensors' data are brought to one time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeConfig {
    /// The longest an epoch waits for the other sensors, 0 to 10 s.
    pub hold: Span,
    /// A sensor silent for longer is no longer waited for; 0.5 s to an hour.
    pub silent_after: Span,
    /// How device stamps become times.
    pub clock: ClockMethod,
}

/// Where the state is told.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamConfig {
    /// Where the state stream listens; port 0 = any free port.
    pub tcp: Option<SocketAddr>,
    /// The state stream's Unix socket.
    pub unix: Option<UnixPath>,
    /// Where operators give orders.
    pub control: Option<UnixPath>,
    /// Where the operator's page and the metrics are served; port 0 = any free port.
    pub http: Option<SocketAddr>,
    /// Whether orders are taken there, from this machine.
    pub http_control: bool,
    /// Where viewers that speak the Foxglove protocol connect; port 0 = any free port.
    pub foxglove: Option<SocketAddr>,
    /// Where telemetry is sent.
    pub telemetry: Option<SocketAddr>,
    /// Which states are sent there.
    pub telemetry_kind: TelemetryKinds,
    /// Predicted states a second, 0.1 to 1000; `None`: none.
    pub rate_hz: Option<f64>,
    /// How far ahead points of interest are predicted: at most 8, above 0 to 10 s, ascending.
    pub point_horizons: Vec<Span>,
    /// Points of a cloud that a client is sent at most, 1 to 100 000.
    pub max_cloud_points: usize,
}

/// A Unix socket's path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnixPath {
    /// The path; short enough for a socket.
    pub path: PathBuf,
    /// Somebody chose it: that it cannot be made is an error. A default path wants a folder that only an
    /// installed service has, so there its absence is a warning, whoever wrote it down.
    pub configured: bool,
}

/// How recordings are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordConfig {
    /// The recording ends when fewer bytes are free on its disk.
    pub min_free: Option<u64>,
    /// A new part begins when this one has so many bytes; at least [`RecordConfig::LEAST_ROTATE`].
    pub rotate: Option<u64>,
    /// A new part begins when this one covers so much time; at least a second.
    pub rotate_after: Option<Duration>,
    /// How many of the newest parts are kept; `None`: all.
    pub keep: Option<NonZeroU32>,
    /// How much of the past is kept in memory while a session runs; nothing where either is 0.
    pub pretrigger: RingBound,
}

impl RecordConfig {
    /// The smallest part, bytes: below, the parts' heads and ends would outweigh the data.
    pub const LEAST_ROTATE: u64 = 1 << 20;
    /// The most of the past that is kept, bytes.
    pub const MOST_PRETRIGGER: u64 = 4 << 30;
}
