//! The bridge to viewers that speak Foxglove's WebSocket protocol: Foxglove, and Lichtblick from 2026 on.
//!
//! ```text
//!   CloudView ──▶ /cloud/<id>   foxglove.PointCloud, at most 10 a second and sensor, at most 20 000 points
//!   DepthView ──▶ /depth/<id>   foxglove.RawImage in mm, at most 5 a second and Kinect
//!   SensorPose ─▶ /tf           foxglove.FrameTransforms, rig to sensors, once a second
//!   STATE ──────▶ /tf, /pose    rig to target; foxglove.PoseInFrame, at most 20 a second
//!             └─▶ /state        JSON, with the covariance
//!   ModelView ──▶ /model        foxglove.PointCloud in the target's frame, when it changed
//!   CONTOUR ────▶ /contour      foxglove.SceneUpdate
//!   HEALTH ─────▶ /health       JSON
//!   EVENT ──────▶ /log          foxglove.Log
//! ```
//!
//! It is a view, never the data: what is thinned out or dropped here is whole in the recording. Without the feature
//! `foxglove` the bridge is there by name and cannot be started.

use std::error::Error;
use std::net::{Ipv4Addr, SocketAddr};

use thiserror::Error as ThisError;
use tumbled_core::{Epoch, Scan};
use tumbled_model::{SensorId, UnixNs};

use crate::stream::reach::NonLive;

#[cfg(not(feature = "foxglove"))]
mod absent;
#[cfg(feature = "foxglove")]
mod bridge;
#[cfg(feature = "foxglove")]
mod messages;
#[cfg(feature = "foxglove")]
mod target;

#[cfg(not(feature = "foxglove"))]
pub use absent::FoxgloveBridge;
#[cfg(feature = "foxglove")]
pub use bridge::FoxgloveBridge;

/// Where viewers look by themselves.
pub const DEFAULT_ADDRESS: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 8765);

/// The most points of a cloud: 320 kB a message.
pub const VIEW_POINTS: usize = 20_000;

/// Where viewers connect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoxgloveConfig {
    /// TCP address; port 0 takes a free one.
    pub address: SocketAddr,
    /// Whether data that are not live may be seen beyond this machine.
    pub allow_nonlive: bool,
}

impl Default for FoxgloveConfig {
    fn default() -> Self {
        Self { address: DEFAULT_ADDRESS, allow_nonlive: false }
    }
}

/// How a sensor is mounted: its coordinates into rig coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorPose {
    /// The sensor; its id names its frame.
    pub sensor: SensorId,
    /// Translation, m.
    pub translation_m: [f64; 3],
    /// Rotation, a unit quaternion in the order x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

/// A Kinect's depth image, borrowed as the points that are in it. Both columns are equally long.
#[derive(Clone, Copy, Debug)]
pub struct DepthView<'a> {
    /// The Kinect; its id names its frame.
    pub sensor: &'a SensorId,
    /// Wall time of the frame.
    pub unix: UnixNs,
    /// Which pixel each point is, row by row, 640 a row.
    pub pixel: &'a [u32],
    /// Depth along the optical axis, m.
    pub z: &'a [f32],
}

impl<'a> DepthView<'a> {
    /// Of an epoch; `None`: it is no Kinect's.
    pub fn of_epoch(epoch: &'a Epoch, unix: UnixNs) -> Option<Self> {
        let Scan::Kinect(scan) = &epoch.scan else { return None };
        Some(Self { sensor: &epoch.sensor, unix, pixel: scan.points.pixel(), z: scan.points.z() })
    }
}

/// What went to viewers since the start. What a viewer that is behind loses (the oldest of 64 messages) is known to the
/// library alone, which logs it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewTotals {
    /// Viewers connected now.
    pub viewers: usize,
    /// Clouds sent.
    pub clouds: u64,
    /// Clouds left out because the sensor's one before was less than a tenth of a second ago.
    pub thinned_out: u64,
}

/// Why the bridge could not start.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum FoxgloveError {
    /// The address cannot be had.
    #[error(
        "cannot listen on {address} for Foxglove: {source}; is another tumbled or viewer bridge running? [stream] foxglove names another address, port 0 takes a free one, an empty text turns it off"
    )]
    Address {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// An address that others reach, for data that are no measurement.
    #[error(transparent)]
    NonLive(#[from] NonLive),
    /// This program has no bridge.
    #[error("this program was built without the feature `foxglove`: build it with it, or set [stream] foxglove = \"\"")]
    NotBuilt,
    /// The library refused.
    #[error("cannot start the Foxglove bridge: {0}")]
    Start(Box<dyn Error + Send + Sync>),
}
