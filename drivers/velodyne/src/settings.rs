//! How one sensor's packets are to be read.

use crate::hdl64;
use crate::models::Model;

/// Which firing a packet's stamp belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StampReference {
    /// The first of the packet: every model's later manuals.
    #[default]
    FirstFiring,
    /// The last of the packet: the HDL-32E manual's other reading (appendix E), 542.6 µs apart.
    LastFiring,
}

/// How one sensor's packets are to be read.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The model; `None` believes the packets.
    pub model: Option<Model>,
    /// Whether z includes the beams' vertical offsets; `None` takes the model's default.
    pub vertical_offsets: Option<bool>,
    /// HDL-32E only.
    pub hdl32e_stamp: StampReference,
    /// HDL-64E only: the factory calibration; S2 and S3 send their own when it is `None`.
    pub hdl64e_calibration: Option<hdl64::Calibration>,
    /// Points nearer or farther than this (metres) are left out and counted; `None` keeps all that have a distance.
    pub range_limits_m: Option<(f32, f32)>,
}
