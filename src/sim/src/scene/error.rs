//! Why a scene cannot be built.

use crate::faults::FaultError;
use crate::kinect::ModelError;
use crate::lidar::LidarError;
use crate::motion::tumble::TumbleError;
use thiserror::Error;
use tumbled_velodyne::hdl64::calibration::CalibrationError;

/// Why a scene cannot be built.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A word that names nothing.
    #[error("{key} is {found:?}: expected one of {expected}")]
    Word {
        /// The key.
        key: String,
        /// What it says.
        found: String,
        /// What it may say.
        expected: &'static str,
    },
    /// A number out of range.
    #[error("{key} is {found}: expected {expected}")]
    Number {
        /// The key.
        key: &'static str,
        /// What it says.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// Neither `shape` nor `mesh`, or both.
    #[error("target: `shape` or `mesh` expected, one of the two")]
    OneSurface,
    /// A file's mesh that nobody has read.
    #[error("target.mesh is {0:?}: the file has not been read")]
    NoMesh(String),
    /// Two sizes, or a unit where there is no file.
    #[error("target.scale is for a `mesh` without `size_m`: leave one of them out")]
    OneScale,
    /// A target of a size that none has.
    #[error(
        "the target is {size_m} m long and reaches {far_m} m from its origin, expected 0.01 to 20 m and at most 40 m: \
        give it scale = 0.001 if its file is in millimetres, or size_m; center = true if its origin lies far away"
    )]
    Size {
        /// Its longest side.
        size_m: f64,
        /// Its farthest corner.
        far_m: f64,
    },
    /// A fault with a number that means nothing.
    #[error(transparent)]
    Fault(#[from] FaultError),
    /// A tumble that cannot be.
    #[error("motion: {0}")]
    Tumble(#[from] TumbleError),
    /// Faults of a stage where there is none.
    #[error("[stage] is there and motion.kind is not \"turntable\": put the target on one, or leave [stage] out")]
    NoTurntable,
    /// A made calibration that is none.
    #[error("lidar {id}: {error}")]
    Calibration {
        /// Whose.
        id: String,
        /// Why.
        error: CalibrationError,
    },
    /// A LiDAR that cannot be.
    #[error("lidar {id}: {error}")]
    Lidar {
        /// Which.
        id: String,
        /// Why.
        error: LidarError,
    },
    /// A Kinect that cannot be.
    #[error("kinect {id}: {error}")]
    Kinect {
        /// Which.
        id: String,
        /// Why.
        error: ModelError,
    },
}
