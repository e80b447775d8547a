//! The config: one TOML file, checked whole, then typed.
//!
//! * [`raw`], [`raw_session`]: the keys as they stand in the file, and [`calibration`]: those of the calibration file;
//! * [`origin`], [`problem`]: where a value was written, and what is wrong with it;
//! * [`tree`], [`shape`], [`names`]: the file as a tree, the schema it is held against, and the walk that does so;
//! * [`files`]: the files it names, with what is in them;
//! * [`set`], [`layers`]: `--set`, and the layers put together by [`load`];
//! * [`check`]: the rules beyond names and types, which make a [`Config`] and its [`session`];
//! * [`show`]: the effective config with its origins.
//!
//! Only [`Config`] travels on.

use std::net::IpAddr;
use std::path::PathBuf;

use tumbled_model::{Iso, Kinect, Lidar, Point, Rig, SensorId, Span, Target};

pub mod calibration;
pub mod check;
mod check_sensors;
mod check_session;
pub mod files;
pub mod layers;
pub mod names;
pub mod origin;
pub mod problem;
pub mod raw;
pub mod raw_session;
pub mod session;
pub mod set;
pub mod shape;
pub mod show;
pub mod suggest;
pub mod tree;

pub use files::{Recorded, RigFile};
pub use layers::{ConfigError, load, load_recorded};
pub use origin::Layer;
pub use problem::{Gravity, Problem, ProblemReport};
pub use raw::{
    BackgroundName, Hdl32eStamp, Intrinsics, LidarModel, RawDepthWarp, RawKinectSigma, RawLidarSigma, Switch,
    TargetSearch, TurntableProtocol,
};
pub use raw_session::{ClockMethod, FilterMethodName, MotionName, RawFilter, TelemetryKinds};
pub use session::{
    DEFAULT_CONTROL_SOCKET, DEFAULT_HTTP, DEFAULT_STREAM_SOCKET, RecordConfig, StreamConfig, TimeConfig, UnixPath,
};

use crate::limits::Limits;
use crate::target::SavedTarget;

/// The commented default, as `tumbled config init` writes it.
pub const COMMENTED_DEFAULT: &str = include_str!("../../../config/rig.toml");

/// A config that may be used.
#[derive(Debug)]
pub struct Loaded {
    /// The config.
    pub config: Config,
    /// The same as a tree with origins, for [`show`].
    pub tree: tree::Node,
    /// What its author may want to know; no errors among them.
    pub warnings: Vec<Problem>,
    /// Where it comes from.
    pub source: ConfigSource,
    /// Every path on this machine that it names, used or not: nothing is to be written over them.
    pub paths: Vec<PathBuf>,
}

/// Where a config comes from; `--set` goes on top of each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConfigSource {
    /// Built in.
    Default,
    /// A file.
    File(PathBuf),
    /// The recording that is read: the config it was recorded with.
    Recorded(PathBuf),
}

/// A rig, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The rig's name, for people; not empty.
    pub name: String,
    /// The calibration file that was laid over it; what it says stands in the sensors already.
    pub calibration: Option<RigFile>,
    /// The LiDARs; ids unique over all sensors.
    pub lidars: Vec<LidarConfig>,
    /// The Kinects; ids unique over all sensors.
    pub kinects: Vec<KinectConfig>,
    /// The turntable, if there is one.
    pub turntable: Option<TurntableConfig>,
    /// Where the target is looked for.
    pub target: TargetConfig,
    /// Points of the target whose motion is reported; names unique.
    pub points_of_interest: Vec<PointOfInterest>,
    /// How the sensors' data are brought to one time.
    pub time: TimeConfig,
    /// How the target's motion is estimated.
    pub filter: RawFilter,
    /// Where the state is told.
    pub stream: StreamConfig,
    /// How recordings are written.
    pub record: RecordConfig,
    /// What a run has to keep.
    pub limits: Limits,
}

/// One Velodyne LiDAR.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarConfig {
    /// Its name in the rig.
    pub id: SensorId,
    /// The model, or `Auto`.
    pub model: LidarModel,
    /// UDP port of the data packets; 0 = any free port.
    pub port: u16,
    /// UDP port of the position packets; 0 = any free port.
    pub position_port: u16,
    /// Only packets from this address; `None`: from any.
    pub source: Option<IpAddr>,
    /// Whether the heights at which the beams leave the sensor are applied.
    pub vertical_offsets: Switch,
    /// HDL-64E: the per-laser calibration. `None` where the model is another one, or `Auto` and the file was not there.
    pub calibration: Option<RigFile>,
    /// Mounting.
    pub t_rig_lidar: Iso<Rig, Lidar>,
    /// How late the stamps are: measurement time = mapped stamp - offset. Within an hour.
    pub time_offset: Span,
    /// How well mounting and offset are known; `None`: nobody says.
    pub sigma: Option<RawLidarSigma>,
    /// Nearest range used, m, at least 0; `None`: the model's.
    pub range_min_m: Option<f64>,
    /// Farthest range used, m, above the nearest; `None`: the model's.
    pub range_max_m: Option<f64>,
    /// HDL-32E: which firing the packet's stamp belongs to.
    pub hdl32e_stamp: Hdl32eStamp,
}

/// One Kinect v1.
#[derive(Clone, Debug, PartialEq)]
pub struct KinectConfig {
    /// Its name in the rig.
    pub id: SensorId,
    /// The camera's serial number; `None`: the only one there is.
    pub serial: Option<String>,
    /// Pinhole model and distortion; focal lengths above 0.
    pub intrinsics: Intrinsics,
    /// Mounting.
    pub t_rig_kinect: Iso<Rig, Kinect>,
    /// How late the stamps are: measurement time = mapped stamp - offset. Within an hour.
    pub time_offset: Span,
    /// How well mounting, offset and scale are known; `None`: nobody says.
    pub sigma: Option<RawKinectSigma>,
    /// The camera's own depth law; `None`: the factory law.
    pub depth_table: Option<RigFile>,
    /// True depth over the depth law's, 0.5 to 2.
    pub depth_scale: f64,
    /// What is added to the scaled depths over the image; `None`: nothing.
    pub depth_warp: Option<RawDepthWarp>,
}

/// The turntable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TurntableConfig {
    /// The serial device, or `usb:` and its adapter's USB serial number; not empty.
    pub port: String,
    /// What is spoken on it.
    pub protocol: TurntableProtocol,
    /// The line's rate, bits a second; 1200 to 4 000 000.
    pub baud: u32,
    /// Counts of a full turn; `None`: the device says.
    pub counts_per_turn: Option<u32>,
}

/// Where the target is looked for.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetConfig {
    /// Centre of the region of interest.
    pub roi_center: Point<Rig>,
    /// Its radius, m, above 0.
    pub roi_radius_m: f64,
    /// What is taken for the target.
    pub search: TargetSearch,
    /// What is learned of the empty room without an order.
    pub background: BackgroundName,
    /// For how long the empty room is learned, s; 0.1 to 600.
    pub background_s: f64,
    /// The saved target that is looked for; `None`: the target is unknown.
    pub saved: Option<SavedFile>,
}

/// A saved target, and the file that it was read from.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedFile {
    /// The file.
    pub file: RigFile,
    /// What is in it.
    pub target: SavedTarget,
}

/// A named point of the target.
#[derive(Clone, Debug, PartialEq)]
pub struct PointOfInterest {
    /// Its name; not empty.
    pub name: String,
    /// Where it is.
    pub position: Point<Target>,
}
