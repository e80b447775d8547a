//! One input of `tumbled info`'s report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::recording::RecordingReport;
use super::WallTime;

/// One input: a file or a folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputReport {
    /// The path as given; what of it is no UTF-8 is replaced by U+FFFD.
    pub path: String,
    /// What it is.
    pub kind: InputKind,
    /// Size of the file; null for a folder.
    pub size_bytes: Option<u64>,
    /// Where its host stamps come from.
    pub stamp_origin: HostStamps,
    /// Earliest host stamp; null when nothing was delivered or the stamps are synthetic.
    pub first: Option<WallTime>,
    /// Latest host stamp; null as `first`.
    pub last: Option<WallTime>,
    /// From the first to the last host stamp, seconds; null as `first`.
    pub duration_s: Option<f64>,
    /// Records whose host stamp lies before that of the record in front of them.
    pub backward_steps: u64,
    /// What went to the sensors of the config.
    pub sensors: Vec<Delivered>,
    /// What was left out, by reason.
    pub left_out: Vec<LeftOut>,
    /// Files whose rest cannot be read.
    pub broken_off: Vec<BrokenFile>,
    /// Everything that belongs, or may belong, to a sensor was delivered.
    pub whole: bool,
    /// What a recording says of itself, and what it holds; null for foreign captures.
    pub recording: Option<RecordingReport>,
    /// What to change in the config when no LiDAR got anything and LiDAR packets are there.
    pub hint: Option<String>,
}

/// Kinds of inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputKind {
    /// Classic libpcap.
    Pcap,
    /// pcapng.
    Pcapng,
    /// ROS 2 bag, MCAP or SQLite.
    Rosbag,
    /// fakenect dump folder, or one file of it.
    Fakenect,
    /// Depth PNGs, a folder or one.
    DepthPngs,
    /// Recording of this program.
    Recording,
    /// A kind this report has no name for yet.
    Other,
}

/// Where host stamps come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HostStamps {
    /// The capturing program stamped each record as it received it.
    Capture,
    /// The sensor's ROS driver stamped packets and images.
    Message,
    /// `times.txt` beside the frames.
    TimesFile,
    /// Recorded with the ledger.
    Ledger,
    /// None: frames are numbered at 30 Hz, so no rate can be told.
    Synthetic,
    /// An origin this report has no name for yet.
    Other,
}

/// What one sensor got out of an input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Delivered {
    /// The sensor's id.
    pub sensor: String,
    /// Payloads from the data port.
    pub data_packets: u64,
    /// Payloads from the position port.
    pub position_packets: u64,
    /// Depth frames.
    pub depth_frames: u64,
    /// Packets or frames that the input itself shows to be missing or damaged.
    pub lost: u64,
}

/// Something in an input that was left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LeftOut {
    /// What and why.
    pub what: String,
    /// How many.
    pub count: u64,
    /// It belonged, or may have belonged, to a sensor: this makes the input not whole.
    pub lost: bool,
}

/// A file whose rest cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BrokenFile {
    /// The file.
    pub path: String,
    /// Offset of the first byte that cannot be used; null for databases.
    pub byte: Option<u64>,
    /// The last row that could be read; null for files that are no database.
    pub after_row: Option<i64>,
    /// What is wrong there.
    pub detail: String,
}
