//! One Kinect of `tumbled info`'s report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::DepthEncoding;

use super::{RateClock, Refusal, Spread};

/// One Kinect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KinectReport {
    /// Its id in the config.
    pub id: String,
    /// Depth frames in the inputs, refused ones included.
    pub frames: u64,
    /// Frames by encoding.
    pub encodings: Vec<EncodingCount>,
    /// Frames per second; null when fewer than two, or when the inputs have no times of their own.
    pub rate_hz: Option<f64>,
    /// The clock of the rate.
    pub rate_clock: Option<RateClock>,
    /// Device stamp of the first frame, ticks of 1/60 µs; null without one.
    pub first_ticks: Option<u32>,
    /// Device stamp of the last frame.
    pub last_ticks: Option<u32>,
    /// Frames that the device's stamps say were made at 30 Hz and that the inputs do not hold; null without stamps.
    pub frames_missing: Option<u64>,
    /// Frames with USB packets missing.
    pub frames_with_usb_loss: u64,
    /// USB packets missing in them.
    pub usb_packets_lost: u64,
    /// Pixels that became no data for it.
    pub pixels_lost: u64,
    /// Frames that could not be decoded, by reason.
    pub refused: Vec<Refusal>,
    /// Frames that repeat the one before them.
    pub repeated: u64,
    /// Share of the 307 200 pixels that have a depth; null without decoded frames.
    pub valid_share: Option<ValidShare>,
    /// Depths along the optical axis, metres.
    pub depth_m: Option<Spread>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Frames of one encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EncodingCount {
    /// The encoding.
    pub encoding: Encoding,
    /// Frames.
    pub frames: u64,
}

/// How the pixels lie in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Encoding {
    /// 11 bits a pixel as on the wire, raw disparity.
    Packed11,
    /// 16 bits a pixel, raw disparity.
    Raw11,
    /// 16 bits a pixel, millimetres.
    Mm16,
}

impl From<DepthEncoding> for Encoding {
    fn from(encoding: DepthEncoding) -> Self {
        match encoding {
            DepthEncoding::Packed11 => Self::Packed11,
            DepthEncoding::Raw11 => Self::Raw11,
            DepthEncoding::Mm16 => Self::Mm16,
        }
    }
}

/// Share of pixels that have a depth, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ValidShare {
    /// Mean over the decoded frames.
    pub mean: f64,
    /// Of the worst frame.
    pub min: f64,
}
