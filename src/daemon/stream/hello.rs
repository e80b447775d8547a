//! HELLO: what the server says first. ERROR: what it says about a connection.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::UnixNs;

use super::class::Class;
use super::cloud::CloudKind;
use super::request::{FORMATS, RequestError};
use crate::cli::VERSION;
use crate::session::run_info::RunInfo;

/// The protocol's number; it changes when a key is renamed or its meaning changes.
pub const PROTOCOL: u32 = 1;

/// Where the data come from. A guidance computer must never take a rehearsal for a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StreamOrigin {
    /// Sensors, now.
    Live,
    /// A recording or a capture.
    Replay,
    /// Simulated sensors.
    Simulated,
}

impl StreamOrigin {
    /// The word on the wire.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Live => "live",
            Self::Replay => "replay",
            Self::Simulated => "simulated",
        }
    }
}

/// The first line of every connection: what the numbers that follow mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: HELLO")]
pub struct Hello {
    /// HELLO.
    pub class: Class,
    /// The protocol's number, 1. Keys may be added without a new number: ignore those you do not know.
    pub protocol: u32,
    /// Version of the program, with the commit where it is known.
    pub version: String,
    /// The session's id: it changes when the daemon starts anew, and with it every `t_ns`.
    pub session: String,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The rig's name.
    pub rig: String,
    /// Wall time at `t_ns` 0, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// The frames that keys name, and how their axes lie.
    pub frames: Frames,
    /// The units of keys that do not name one.
    pub units: Units,
    /// How the sensors stand and what they look at; empty: nobody says.
    #[serde(default)]
    pub sensors: Vec<SensorPlace>,
    /// The classes this server sends.
    pub classes: Vec<Class>,
    /// The formats it sends them in.
    pub formats: Vec<String>,
    /// What people said of the run as it began; left out: nothing. HEALTH tells what they say now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<RunInfo>,
    /// What comes even when nothing happens, to those who subscribed to it.
    pub heartbeat: Heartbeat,
}

/// How a sensor stands in the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SensorPlace {
    /// Its id.
    pub id: String,
    /// What it is.
    pub kind: CloudKind,
    /// Of its frame's origin, m, rig frame.
    pub translation_m: [f64; 3],
    /// Its axes in the rig, a unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
    /// A depth camera's view: where the image's corners are at 1 m depth, its own frame, without distortion; null: a LiDAR,
    /// which looks all around.
    pub corners_m: Option<[[f64; 3]; 4]>,
}

/// The frames and how their axes lie.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Frames {
    /// The rig's.
    pub rig: String,
    /// A LiDAR's.
    pub lidar: String,
    /// A Kinect's depth camera.
    pub kinect: String,
    /// The turntable's.
    pub stage: String,
    /// The target's.
    pub target: String,
}

/// Units of keys that do not end in one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Units {
    /// Of lengths.
    pub length: String,
    /// Of angles.
    pub angle: String,
    /// Of `t_ns` and `unix_ns`.
    pub time: String,
    /// Of quaternions.
    pub quaternion: String,
}

/// A class that comes at a fixed beat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Heartbeat {
    /// The class.
    pub class: Class,
    /// Seconds between two of them. Three missed: the daemon or the link is gone.
    pub period_s: f64,
}

impl Hello {
    /// Of a session. `unix_at_zero` is the wall time at `t_ns` 0.
    pub fn new(session: &str, rig: &str, origin: StreamOrigin, unix_at_zero: UnixNs) -> Self {
        Self {
            class: Class::Hello,
            protocol: PROTOCOL,
            version: VERSION.to_owned(),
            session: session.to_owned(),
            origin,
            rig: rig.to_owned(),
            unix_ns: unix_at_zero.0.to_string(),
            frames: Frames {
                rig: "the rig's own; by default the LiDAR's".to_owned(),
                lidar: "x forward at azimuth 0, y left, z up".to_owned(),
                kinect: "depth camera: x right, y down, z forward".to_owned(),
                stage: "turntable, z along its axis".to_owned(),
                target: "fixed to the target when it is acquired, axes those of the rig at that time".to_owned(),
            },
            units: Units {
                length: "m".to_owned(),
                angle: "rad".to_owned(),
                time: "ns".to_owned(),
                quaternion: "xyzw".to_owned(),
            },
            sensors: Vec::new(),
            classes: Class::ALL.to_vec(),
            formats: FORMATS.map(str::to_owned).to_vec(),
            run: None,
            heartbeat: Heartbeat { class: Class::Health, period_s: 1.0 },
        }
    }

    /// With what people say of the run.
    pub fn of_run(self, info: &RunInfo) -> Self {
        Self { run: (!info.is_empty()).then(|| info.clone()), ..self }
    }

    /// With the sensors of a rig.
    pub fn of_sensors(self, sensors: Vec<SensorPlace>) -> Self {
        Self { sensors, ..self }
    }
}

/// What the server says about a client's connection. Nobody subscribes to it, everybody gets their own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: ERROR")]
pub struct ErrorLine {
    /// ERROR.
    pub class: Class,
    /// A word for programs: `malformed`, `too_deep`, `too_long`, `too_many_requests`, `no_object`, `bad_value`,
    /// `unknown_class`, `unknown_format`, `too_many_clients`, `stopping`.
    pub code: String,
    /// A sentence for people, with the remedy.
    pub message: String,
    /// What would have been understood, where there is a list of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub supported: Vec<String>,
    /// Whether this is the last line of the connection.
    pub closing: bool,
}

impl ErrorLine {
    /// The answer to a request that was not carried out.
    pub fn of_request(error: &RequestError) -> Self {
        Self {
            class: Class::Error,
            code: error.code().to_owned(),
            message: error.to_string(),
            supported: error.supported().into_iter().map(str::to_owned).collect(),
            closing: error.closes(),
        }
    }

    /// The last line of a connection that the server ends for a reason of its own.
    pub fn closing(code: &str, message: String) -> Self {
        Self { class: Class::Error, code: code.to_owned(), message, supported: Vec::new(), closing: true }
    }
}
