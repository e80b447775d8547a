//! What payloads turn into, and what becomes of those that do not.

use crate::heads::Heads;
use crate::models::{Model, ReturnMode};
use crate::points::Points;
use crate::position::PositionPacket;
use crate::track::Order;
use crate::wire::WireError;
use core::ops::Range;
use std::collections::BTreeMap;
use tumbled_model::{LidarTime, RigNs};

/// Why a payload could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
#[non_exhaustive]
pub enum Rejection {
    /// Not a packet by its length or its blocks.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// A Velodyne product this crate does not decode.
    #[error("{0} packets are not supported (supported: VLP-32C, VLP-16, Puck LITE, Puck Hi-Res, HDL-32E, HDL-64E)")]
    UnsupportedProduct(&'static str),
    /// A product byte nobody here knows.
    #[error("product byte {0:#04x} is unknown: set lidar.model if you know what it is")]
    UnknownProduct(u8),
    /// Not the model that the stream began with or that the settings name.
    #[error(
        "packets of a {found} on the port of a {expected}: set lidar.source to tell two sensors apart, or lidar.model"
    )]
    OtherModel {
        /// The model of this stream.
        expected: Model,
        /// What the packet says it is.
        found: Model,
    },
    /// Byte 1204 names no return mode of these models.
    #[error("return mode byte {0:#04x} is none of strongest 0x37, last 0x38, dual 0x39")]
    ReturnMode(u8),
    /// HDL-64E packets before any calibration is known.
    #[error(
        "HDL-64E packets without a calibration: give lidar.calibration (S2 and S3 also send it within 4160 packets)"
    )]
    Uncalibrated,
}

impl Rejection {
    /// What is wrong, without the values found.
    pub const fn kind(&self) -> RejectionKind {
        match self {
            Self::Wire(WireError::Length { .. }) => RejectionKind::Length,
            Self::Wire(WireError::Flag { .. }) => RejectionKind::BlockFlag,
            Self::Wire(WireError::Azimuth { .. }) => RejectionKind::Azimuth,
            Self::Wire(WireError::Sentence { .. }) => RejectionKind::Sentence,
            Self::UnsupportedProduct(_) => RejectionKind::UnsupportedProduct,
            Self::UnknownProduct(_) => RejectionKind::UnknownProduct,
            Self::OtherModel { .. } => RejectionKind::OtherModel,
            Self::ReturnMode(_) => RejectionKind::ReturnMode,
            Self::Uncalibrated => RejectionKind::Uncalibrated,
        }
    }
}

/// What is wrong with payloads that gave no points: few words, whatever comes, so that counts by them stay small.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum RejectionKind {
    /// Neither a data nor a position packet by its length.
    Length,
    /// A block that starts with no block flag.
    BlockFlag,
    /// An azimuth beyond one turn.
    Azimuth,
    /// A position packet whose sentence is no text.
    Sentence,
    /// A Velodyne product that is not decoded.
    UnsupportedProduct,
    /// A product byte nobody here knows.
    UnknownProduct,
    /// Another model than this stream's.
    OtherModel,
    /// A byte that names no return mode.
    ReturnMode,
    /// HDL-64E packets before any calibration is known.
    Uncalibrated,
}

impl RejectionKind {
    /// The word in health and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::BlockFlag => "block_flag",
            Self::Azimuth => "azimuth",
            Self::Sentence => "sentence",
            Self::UnsupportedProduct => "unsupported_product",
            Self::UnknownProduct => "unknown_product",
            Self::OtherModel => "other_model",
            Self::ReturnMode => "return_mode",
            Self::Uncalibrated => "uncalibrated",
        }
    }
}

impl core::fmt::Display for RejectionKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

/// Payloads refused for one kind of reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// How many.
    pub count: u64,
    /// Why the first of them was, with the values found in it.
    pub first: Rejection,
}

/// One decoded data packet.
#[derive(Clone, Debug, PartialEq)]
pub struct PacketInfo {
    /// Position among the sensor's payloads of a data packet's length, decoded or not, from 0.
    pub index: u64,
    /// When the host had it.
    pub arrived: RigNs,
    /// Its own stamp; `None` for an HDL-64E S1, which has no clock.
    pub stamp: Option<LidarTime>,
    /// Its points in [`Decoded::points`].
    pub points: Range<usize>,
    /// Return mode.
    pub mode: ReturnMode,
    /// Azimuth of its first and last firing group, 0.01°.
    pub azimuth_cdeg: (u16, u16),
    /// It holds an azimuth jump: the limited field of view ends and begins within it.
    pub azimuth_jump: bool,
    /// How long the sensor was silent at the jump, ns; included in the later points' times.
    pub pause_ns: i64,
    /// Where the head stood at each firing group, and when: groups without a return included.
    pub heads: Heads,
    /// Its place in the stream, with what is missing before it.
    pub order: Order,
}

/// What payloads turned into. Cleared and refilled by the caller.
#[derive(Clone, Debug, Default)]
pub struct Decoded {
    /// All points, packet after packet.
    pub points: Points,
    /// The packets they came from.
    pub packets: Vec<PacketInfo>,
    /// Position packets.
    pub positions: Vec<PositionPacket>,
}

impl Decoded {
    /// Forgets what is there, keeps the memory.
    pub fn clear(&mut self) {
        self.points.clear();
        self.packets.clear();
        self.positions.clear();
    }
}

/// Counts of one sensor's payloads, by what became of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamCounts {
    /// Data packets decoded.
    pub data_packets: u64,
    /// Position packets read.
    pub position_packets: u64,
    /// Payloads that gave nothing, by what was wrong.
    pub rejected: BTreeMap<RejectionKind, Refused>,
    /// Points decoded.
    pub points: u64,
    /// Points left out by the range limits.
    pub out_of_range: u64,
    /// Packets by return mode.
    pub modes: BTreeMap<ReturnMode, u64>,
}

impl StreamCounts {
    /// Payloads that gave nothing, for whatever reason.
    pub fn refused(&self) -> u64 {
        self.rejected.values().map(|refused| refused.count).sum()
    }

    pub(crate) fn reject(&mut self, rejection: Rejection) {
        let fresh = Refused { count: 0, first: rejection };
        self.rejected.entry(rejection.kind()).or_insert(fresh).count += 1;
    }
}
