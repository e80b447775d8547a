//! The ledger's events: everything the core ever learns, in one order.

use crate::time::{KinectTicks, RigNs, UnixNs};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A sensor's name from the config, e.g. `front`. Cheap to clone.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct SensorId(Arc<str>);

impl SensorId {
    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<String> for SensorId {
    fn from(name: String) -> Self {
        Self(name.into())
    }
}

impl From<&str> for SensorId {
    fn from(name: &str) -> Self {
        Self(name.into())
    }
}

impl From<SensorId> for String {
    fn from(id: SensorId) -> Self {
        id.0.as_ref().to_owned()
    }
}

impl core::fmt::Display for SensorId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(&self.0)
    }
}

/// One thing that happened, in the order the daemon accepted it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Position in the ledger: 0, 1, 2, … without gaps. A total order; ties cannot exist.
    pub seq: u64,
    /// When the host first had it, on the session's timeline.
    pub arrived: RigNs,
    /// What happened.
    pub body: Body,
}

/// What an event carries: raw bytes exactly as the device gave them, or what is known to be missing.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Body {
    /// A UDP payload from a LiDAR's data or position port.
    LidarPacket {
        /// Which LiDAR.
        sensor: SensorId,
        /// The payload as received.
        bytes: Bytes,
    },
    /// One Kinect depth frame, 640 × 480.
    DepthFrame {
        /// Which Kinect.
        sensor: SensorId,
        /// The device's stamp of the frame; captures without one have `None`.
        ticks: Option<KinectTicks>,
        /// How `bytes` is to be read.
        encoding: DepthEncoding,
        /// USB packets of this frame that never arrived.
        lost_packets: PacketMask,
        /// The frame's payload as received.
        bytes: Bytes,
    },
    /// Bytes on a serial line, as many as one read gave or one write took. Both directions are recorded: without the
    /// requests a reply cannot be given its time. Whose bytes they are, the protocol tells.
    SerialChunk {
        /// Which device on the port.
        sensor: SensorId,
        /// The bytes as received, or as sent.
        bytes: Bytes,
    },
    /// What a device says of its own calibration, once per opening: a Kinect's zero plane and registration tables.
    DeviceTables {
        /// Whose.
        sensor: SensorId,
        /// The device's replies as received.
        bytes: Bytes,
    },
    /// A source was opened, lost, opened again or closed.
    SensorState {
        /// Whose.
        sensor: SensorId,
        /// What it is now.
        state: SourceState,
    },
    /// Live load-shedding, written before the packets of the scans it sheds: the core leaves them out, live and on replay.
    Skip {
        /// Whose scans.
        sensor: SensorId,
        /// How many.
        scans: u16,
    },
    /// The wall clock at this instant, once a second.
    Anchor {
        /// Wall time at [`Event::arrived`].
        unix: UnixNs,
    },
    /// A tenth of a second has passed: the only passage of time without data.
    Tick,
    /// An operator's order to the core.
    Command(Command),
    /// The rig as it is from here on: a config that was changed while the session ran.
    Config {
        /// The effective config, TOML, calibration applied: what the recording's header holds for the start.
        toml: Arc<str>,
    },
    /// Something that a sensor sent and that was lost on the way.
    Gap {
        /// Whose data.
        sensor: SensorId,
        /// How many packets, frames or chunks.
        lost: u32,
        /// Where.
        place: LossPoint,
    },
}

impl Body {
    /// The sensor it came from or concerns; `None` for what concerns the session.
    pub fn sensor(&self) -> Option<&SensorId> {
        match self {
            Self::LidarPacket { sensor, .. }
            | Self::DepthFrame { sensor, .. }
            | Self::SerialChunk { sensor, .. }
            | Self::DeviceTables { sensor, .. }
            | Self::SensorState { sensor, .. }
            | Self::Skip { sensor, .. }
            | Self::Gap { sensor, .. } => Some(sensor),
            Self::Anchor { .. } | Self::Tick | Self::Command(_) | Self::Config { .. } => None,
        }
    }
}

/// What an operator may order the core to do. Texts are at most [`Command::TEXT_BYTES`] long: whoever takes the order cuts
/// or refuses.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Command {
    /// Remember this instant under a name; nothing else changes.
    Marker {
        /// What the operator wrote.
        text: Arc<str>,
    },
    /// The room is empty: what is seen in the next so many milliseconds is background from then on. A target that was
    /// tracked is forgotten.
    LearnBackground {
        /// For how long, ms; above 0.
        lasts_ms: u32,
    },
    /// Nothing is background any more.
    ForgetBackground,
    /// The target is forgotten and acquired anew, in a frame of its own.
    ResetFilter,
}

impl Command {
    /// The longest text an order carries, bytes of UTF-8.
    pub const TEXT_BYTES: usize = 1_024;
}

/// What a source is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceState {
    /// The device or socket is open; data may come.
    Opened,
    /// It failed or went away; the source tries again.
    Lost,
    /// It was closed on purpose; nothing more comes.
    Closed,
}

/// Where data were lost before the ledger had them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LossPoint {
    /// The kernel's socket buffer was full.
    Kernel,
    /// The queue between the receiver and the ledger was full.
    Queue,
    /// USB packets or frames never arrived.
    Usb,
    /// The recorder could not keep up: missing in the recording, not in the run.
    Recorder,
    /// The capture file holds less of the packet than was on the wire, or breaks off.
    Capture,
}

/// How a depth frame's bytes are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthEncoding {
    /// 11 bits a pixel, big-endian bit stream without padding: 422 400 bytes, as on the wire.
    Packed11,
    /// 16-bit little-endian, raw disparity 0..=2047: 614 400 bytes.
    Raw11,
    /// 16-bit little-endian, millimetres, 0 = no data: 614 400 bytes.
    Mm16,
}

/// One bit per USB packet of a depth frame (242 of 1 748 bytes): set = lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketMask([u64; 4]);

impl PacketMask {
    /// USB packets of a packed 11-bit frame: 241 × 1 748 + 1 132 bytes = 422 400.
    pub const PACKETS: usize = 242;

    /// Nothing lost.
    pub const NONE: Self = Self([0; 4]);

    /// Marks packet `index` as lost; indices past the last packet are ignored.
    pub fn mark_lost(&mut self, index: usize) {
        if index < Self::PACKETS
            && let Some(word) = self.0.get_mut(index / 64)
        {
            *word |= 1 << (index % 64);
        }
    }

    /// Whether packet `index` was lost.
    pub fn is_lost(&self, index: usize) -> bool {
        self.0.get(index / 64).is_some_and(|word| word >> (index % 64) & 1 == 1)
    }

    /// How many were lost, 0..=242.
    pub fn count(&self) -> u32 {
        self.0.iter().map(|word| word.count_ones()).sum()
    }

    /// The lost packets' indices, ascending.
    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        (0..Self::PACKETS).filter(|&index| self.is_lost(index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mask_counts_each_packet_once_and_ignores_what_is_not_one() {
        let mut mask = PacketMask::NONE;
        for index in [0, 63, 64, 241, 241, 242, 9_999] {
            mask.mark_lost(index);
        }
        assert_eq!(mask.count(), 4);
        assert_eq!(mask.iter().collect::<Vec<_>>(), [0, 63, 64, 241]);
    }
}
