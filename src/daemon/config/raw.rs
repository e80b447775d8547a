//! The config as it stands in a file: the raw types serde reads, schemars describes and `config/rig.toml` shows.
//!
//! These types are the one list of keys. The JSON Schema, the check of names and types, the built-in defaults and
//! `config show` all follow from them; the doc comment of a field is its description in the schema and in messages.
//! They hold what was written, not what it means: [`super::Config`] is what travels on.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::raw_session::{RawFilter, RawRecord, RawStream, RawTime};
use crate::limits::Limits;

/// A rig: its sensors, where they are mounted, and what is measured. SI units unless a key's name says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(title = "tumbled rig config")]
pub struct RawConfig {
    /// The rig as a whole.
    pub rig: RawRig,
    /// The LiDARs, one `[[lidar]]` each. Left out: one with the defaults. None: `lidar = []`.
    pub lidar: Vec<RawLidar>,
    /// The Kinects, one `[[kinect]]` each. Left out: one with the defaults. None: `kinect = []`.
    pub kinect: Vec<RawKinect>,
    /// The turntable the target stands on. Left out: no turntable.
    pub turntable: Option<RawTurntable>,
    /// Where the target is looked for.
    pub target: RawTarget,
    /// Named points of the target whose motion is reported, one `[[points_of_interest]]` each.
    pub points_of_interest: Vec<RawPointOfInterest>,
    /// How the sensors' data are brought to one time.
    pub time: RawTime,
    /// Fusion of the two sensors. Has no keys in this version.
    pub fusion: RawNoKeys,
    /// Reconstruction of the target. Has no keys in this version.
    pub reconstruction: RawNoKeys,
    /// The motion filter.
    pub filter: RawFilter,
    /// Where the state is told: the state stream and the viewers' bridge.
    pub stream: RawStream,
    /// How recordings are written.
    pub record: RawRecord,
    /// What a run has to keep: applied by `evaluate` and `run`, exit code 3 where it is not kept.
    pub limits: Limits,
}

impl Default for RawConfig {
    fn default() -> Self {
        Self {
            rig: RawRig::default(),
            lidar: vec![RawLidar::default()],
            kinect: vec![RawKinect::default()],
            turntable: None,
            target: RawTarget::default(),
            points_of_interest: Vec::new(),
            time: RawTime::default(),
            fusion: RawNoKeys {},
            reconstruction: RawNoKeys {},
            filter: RawFilter::default(),
            stream: RawStream::default(),
            record: RawRecord::default(),
            limits: Limits::default(),
        }
    }
}

/// A section without keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawNoKeys {}

/// The rig as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawRig {
    /// The rig's name, for people: it stands in recordings and reports.
    pub name: String,
    /// A calibration file. What it holds overrides the inline transforms, time offsets and intrinsics, per sensor id.
    pub calibration: Option<String>,
}

impl Default for RawRig {
    fn default() -> Self {
        Self { name: "rig".to_owned(), calibration: None }
    }
}

/// One Velodyne LiDAR.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawLidar {
    /// The sensor's name in this rig: a-z, 0-9, `-`, `_`; unique over all sensors.
    #[schemars(regex(pattern = r"^[a-z0-9_-]+$"))]
    pub id: String,
    /// The sensor model; `auto` reads it from the packets and checks it against their rate.
    pub model: LidarModel,
    /// UDP port of the data packets; 0 = any free port.
    pub port: u16,
    /// UDP port of the position packets; 0 = any free port.
    pub position_port: u16,
    /// Only packets from this IP address; left out or empty: from any.
    pub source: Option<String>,
    /// Whether the heights at which the beams leave the sensor are applied; `auto` follows the model.
    pub vertical_offsets: Switch,
    /// HDL-64E: per-laser calibration (db.xml, velodyne_decoder or ROS YAML, or CSV).
    pub calibration: Option<String>,
    /// Mounting: lidar coordinates into rig coordinates.
    pub t_rig_lidar: RawTransform,
    /// Milliseconds by which the stamps are late: measurement time = mapped stamp - offset.
    #[schemars(range(min = -3_600_000.0, max = 3_600_000.0))]
    pub time_offset_ms: f64,
    /// How far the mounting and the offset may be off: one standard deviation; left out: not known.
    pub sigma: Option<RawLidarSigma>,
    /// Nearest range used, m; left out: the model's. Exports of packets keep every range.
    #[schemars(range(min = 0.0))]
    pub range_min_m: Option<f64>,
    /// Farthest range used, m; left out: the model's. Exports of packets keep every range.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub range_max_m: Option<f64>,
    /// HDL-32E: which firing of a packet its time stamp belongs to; the documents disagree by 0.54 ms.
    pub hdl32e_stamp: Hdl32eStamp,
}

impl Default for RawLidar {
    fn default() -> Self {
        Self {
            id: "front".to_owned(),
            model: LidarModel::Auto,
            port: 2368,
            position_port: 8308,
            source: None,
            vertical_offsets: Switch::Auto,
            calibration: None,
            t_rig_lidar: RawTransform::default(),
            time_offset_ms: 0.0,
            sigma: None,
            range_min_m: None,
            range_max_m: None,
            hdl32e_stamp: Hdl32eStamp::First,
        }
    }
}

/// A Velodyne model, or `auto`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum LidarModel {
    /// Read from the packets.
    #[serde(rename = "auto")]
    Auto,
    /// VLP-32C.
    #[serde(rename = "vlp-32c")]
    Vlp32c,
    /// VLP-16 or Puck LITE.
    #[serde(rename = "vlp-16")]
    Vlp16,
    /// Puck Hi-Res.
    #[serde(rename = "vlp-16-hi-res")]
    Vlp16HiRes,
    /// HDL-32E.
    #[serde(rename = "hdl-32e")]
    Hdl32e,
    /// HDL-64E.
    #[serde(rename = "hdl-64e")]
    Hdl64e,
}

/// On, off, or as the sensor's model wants it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    /// As the model wants it.
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

/// Which firing of an HDL-32E packet its time stamp belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Hdl32eStamp {
    /// The first firing of the packet (later documents, and what other decoders take).
    First,
    /// The last firing of the packet (the older manual's timing table).
    Last,
}

/// One Kinect v1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawKinect {
    /// The sensor's name in this rig: a-z, 0-9, `-`, `_`; unique over all sensors.
    #[schemars(regex(pattern = r"^[a-z0-9_-]+$"))]
    pub id: String,
    /// The camera's serial number; empty: the only one there is.
    pub serial: String,
    /// Pinhole model and distortion of the depth camera.
    pub intrinsics: Intrinsics,
    /// Mounting: depth-camera coordinates into rig coordinates.
    pub t_rig_kinect: RawTransform,
    /// Milliseconds by which the stamps are late: measurement time = mapped stamp - offset.
    #[schemars(range(min = -3_600_000.0, max = 3_600_000.0))]
    pub time_offset_ms: f64,
    /// How far mounting, offset and scale may be off: one standard deviation; left out: not known.
    pub sigma: Option<RawKinectSigma>,
    /// This camera's own depth law: CSV `raw11,depth_mm`; left out: the factory law.
    pub depth_table: Option<String>,
    /// True depth over the depth law's: every depth is multiplied by it.
    #[schemars(range(min = 0.5, max = 2.0))]
    pub depth_scale: f64,
    /// The camera's own error of depth over its image, added to the scaled depth of every point; left out: none.
    pub depth_warp: Option<RawDepthWarp>,
}

/// A surface over a depth image: `z + z^power * (f0 + f1 x + f2 x² + f3 x³ + f4 y + f5 xy + f6 x²y + f7 y² + f8 xy² + f9 y³)`,
/// x and y from -1 to 1 across the picture. At 2 m it may change a depth by 0.2 m at most.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawDepthWarp {
    /// 0: an error in metres, the same at every depth; 2: an error of the disparity.
    #[schemars(range(min = 0, max = 2))]
    pub power: u8,
    /// f0 to f9, m^(1 - power).
    pub factors: [f64; 10],
}

impl From<&RawDepthWarp> for tumbled_kinect::DepthWarp {
    fn from(raw: &RawDepthWarp) -> Self {
        Self { power: raw.power, factors: raw.factors }
    }
}

/// How well a LiDAR's place and time are known: one standard deviation each, as a calibration states them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawLidarSigma {
    /// Of the mounting's rotation, the whole angle, degrees.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub rotation_deg: f64,
    /// Of its translation, the whole length, m.
    #[schemars(range(min = 0.0))]
    pub translation_m: f64,
    /// Of the time offset, ms.
    #[schemars(range(min = 0.0, max = 3_600_000.0))]
    pub time_offset_ms: f64,
}

/// How well a Kinect's place, time and depth scale are known: one standard deviation each, as a calibration states them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawKinectSigma {
    /// Of the mounting's rotation, the whole angle, degrees.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub rotation_deg: f64,
    /// Of its translation, the whole length, m.
    #[schemars(range(min = 0.0))]
    pub translation_m: f64,
    /// Of the time offset, ms.
    #[schemars(range(min = 0.0, max = 3_600_000.0))]
    pub time_offset_ms: f64,
    /// Of the depth scale, a share of it.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub depth_scale: f64,
}

impl Default for RawKinect {
    fn default() -> Self {
        Self {
            id: "near".to_owned(),
            serial: String::new(),
            intrinsics: Intrinsics::default(),
            t_rig_kinect: RawTransform::default(),
            time_offset_ms: 0.0,
            sigma: None,
            depth_table: None,
            depth_scale: 1.0,
            depth_warp: None,
        }
    }
}

/// A rigid transform, written as the pose of the sensor in the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawTransform {
    /// Translation x, y, z, m.
    pub translation_m: [f64; 3],
    /// Rotation, a unit quaternion in the order x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

impl Default for RawTransform {
    fn default() -> Self {
        Self { translation_m: [0.0; 3], rotation_xyzw: [0.0, 0.0, 0.0, 1.0] }
    }
}

/// Pinhole model with Brown-Conrady distortion; pixel centres at integer coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Intrinsics {
    /// Focal length along u, pixels.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub fx: f64,
    /// Focal length along v, pixels.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub fy: f64,
    /// Principal point, u, pixels.
    pub cx: f64,
    /// Principal point, v, pixels.
    pub cy: f64,
    /// Radial distortion, second order.
    pub k1: f64,
    /// Radial distortion, fourth order.
    pub k2: f64,
    /// Tangential distortion, first coefficient.
    pub p1: f64,
    /// Tangential distortion, second coefficient.
    pub p2: f64,
    /// Radial distortion, sixth order.
    pub k3: f64,
}

impl Default for Intrinsics {
    fn default() -> Self {
        Self { fx: 575.8, fy: 575.8, cx: 320.0, cy: 240.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 }
    }
}

/// The turntable the target stands on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawTurntable {
    /// The serial device, best by a name that stays (`/dev/serial/by-id/…`); or `usb:` and its adapter's USB serial number.
    pub port: String,
    /// What is spoken on it.
    #[serde(default)]
    pub protocol: TurntableProtocol,
    /// The line's rate, bits a second; 8 bits, no parity, one stop bit.
    #[serde(default = "usual_baud")]
    #[schemars(range(min = 1_200, max = 4_000_000))]
    pub baud: u32,
    /// Counts of a full turn of the table, where the device's own number is not that (a gear) or it tells none. 0: the device's.
    #[serde(default)]
    pub counts_per_turn: u32,
}

/// What Zaber devices come with.
fn usual_baud() -> u32 {
    115_200
}

/// What a turntable's serial port speaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TurntableProtocol {
    /// Zaber ASCII.
    #[default]
    Zaber,
    /// One line of text per reading.
    Line,
}

/// What is taken for the target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TargetSearch {
    /// The cluster in the region of interest.
    #[default]
    Region,
    /// The nearest isolated cluster.
    Nearest,
    /// All that is seen.
    Everything,
}

/// Where the target is looked for: a sphere in the rig's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawTarget {
    /// Centre of the region of interest, rig frame, m.
    pub roi_center_m: [f64; 3],
    /// Radius of the region of interest, m.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub roi_radius_m: f64,
    /// What is taken for the target: `region`: the cluster in the region; `nearest`: the nearest isolated cluster, wherever
    /// it stands; `everything`: all that is seen, for a rig that moves before a scene that stands still.
    pub search: TargetSearch,
    /// What of the room is left out: `none`: nothing but planes that go on beyond the target; `start`: all that is seen at
    /// the session's start, when the room is empty.
    pub background: BackgroundName,
    /// Seconds for which the empty room is learned: at the start, and on an operator's order.
    #[schemars(range(min = 0.1, max = 600.0))]
    pub background_s: f64,
    /// A target that `tumbled target save` wrote: it is recognised, and states are told in its frame. Empty: the target is
    /// unknown, and its frame is fixed when it is acquired.
    pub saved: String,
}

/// What is learned of the empty room without an order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum BackgroundName {
    /// Nothing.
    #[default]
    None,
    /// What is seen at the session's start.
    Start,
}

impl Default for RawTarget {
    fn default() -> Self {
        Self {
            roi_center_m: [2.0, 0.0, 0.0],
            roi_radius_m: 1.2,
            search: TargetSearch::Region,
            background: BackgroundName::None,
            background_s: 3.0,
            saved: String::new(),
        }
    }
}

/// A named point of the target whose motion is reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawPointOfInterest {
    /// The point's name; unique.
    pub name: String,
    /// Where it is, target frame, m.
    pub position_m: [f64; 3],
}
