//! How an event lies in a message: channels, the 16-byte head, and each kind's body.
//!
//! Every message begins with the head (all numbers little-endian):
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 8 | `seq` u64: position in the ledger |
//! | 8 | 8 | `arrived` i64: ns on the session's timeline |
//!
//! What follows depends on the channel:
//!
//! | channel | body |
//! |---|---|
//! | `/lidar/<id>/packets` | the UDP payload |
//! | `/kinect/<id>/depth_raw` | encoding u8 (0 packed 11-bit, 1 raw 16-bit, 2 mm 16-bit), ticks present u8, 0 u16, ticks u32, lost USB packets as 256 bits (bit k = byte k/8, bit k%8), the frame |
//! | `/kinect/<id>/tables` | the device's replies |
//! | `/serial/<id>/bytes` | the bytes |
//! | `/ledger` | tag u8 and by tag: 1 tick: nothing · 2 anchor: unix ns i64 · 3 sensor state: state u8, id · 4 skip: scans u16, id · 5 gap: place u8, lost u32, id · 6 command: order u8, text · 7 config: TOML |
//!
//! An id, a text and a config are the rest of the message, UTF-8. States: 0 opened, 1 lost, 2 closed. Places: 0 kernel,
//! 1 queue, 2 USB, 3 recorder, 4 capture. Orders: 0 marker.

use bytes::Bytes;
use core::fmt;
use std::collections::BTreeMap;
use std::sync::Arc;
use tumbled_model::{
    Body, Command, DepthEncoding, Event, KinectTicks, LossPoint, PacketMask, RigNs, SensorId, SourceState, UnixNs,
};

use crate::capture::Fields;

/// Bytes of the head of every message.
pub const HEAD_BYTES: usize = 16;

/// Encoding, ticks and mask in front of a depth frame.
const DEPTH_HEAD_BYTES: usize = 40;
const MASK_BYTES: usize = 32;

/// The largest message that is recorded or read. A depth frame has 0.6 MB; nothing a sensor gives comes near.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;

/// The longest config that is recorded, read or attached, bytes: a rig of ten sensors has 10 kB.
pub const MAX_CONFIG_BYTES: usize = 1 << 20;

/// What a channel carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ChannelKind {
    /// UDP payloads of a LiDAR.
    LidarPackets,
    /// Depth frames of a Kinect.
    DepthRaw,
    /// What a Kinect says of its own calibration.
    DeviceTables,
    /// Bytes of a serial port.
    SerialBytes,
    /// What happened beside the data: ticks, anchors, sensor states, skips, gaps, an operator's orders, changed configs.
    Ledger,
}

impl ChannelKind {
    /// All kinds.
    pub const ALL: [Self; 5] =
        [Self::LidarPackets, Self::DepthRaw, Self::DeviceTables, Self::SerialBytes, Self::Ledger];

    /// The name in the channel's metadata, key `kind`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LidarPackets => "lidar_packets",
            Self::DepthRaw => "depth_raw",
            Self::DeviceTables => "device_tables",
            Self::SerialBytes => "serial_bytes",
            Self::Ledger => "ledger",
        }
    }

    /// The body's layout in one line, for the channel's metadata.
    const fn layout(self) -> &'static str {
        match self {
            Self::LidarPackets => "little-endian: seq u64, arrived_ns i64, UDP payload",
            Self::DepthRaw => {
                "little-endian: seq u64, arrived_ns i64, encoding u8 (0 packed 11-bit, 1 raw 16-bit, 2 mm 16-bit), \
                 ticks_present u8, zero u16, ticks u32 (60 MHz), lost USB packets 256 bits, frame 640x480"
            }
            Self::DeviceTables | Self::SerialBytes => "little-endian: seq u64, arrived_ns i64, bytes",
            Self::Ledger => {
                "little-endian: seq u64, arrived_ns i64, tag u8; 1 tick; 2 anchor: unix_ns i64; \
                 3 state: u8 (0 opened, 1 lost, 2 closed), id; 4 skip: scans u16, id; \
                 5 gap: place u8 (0 kernel, 1 queue, 2 usb, 3 recorder, 4 capture), lost u32, id; \
                 6 command: u8 (0 marker, 1 learn background, 2 forget it, 3 reset filter), text or u32 ms; 7 config: TOML"
            }
        }
    }
}

/// A channel: what it carries, and whose data; the ledger's own has no sensor.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelKey {
    /// What it carries.
    pub kind: ChannelKind,
    /// Whose.
    pub sensor: Option<SensorId>,
}

impl fmt::Display for ChannelKey {
    /// The topic.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let id = self.sensor.as_ref().map_or("", SensorId::as_str);
        match self.kind {
            ChannelKind::LidarPackets => write!(f, "/lidar/{id}/packets"),
            ChannelKind::DepthRaw => write!(f, "/kinect/{id}/depth_raw"),
            ChannelKind::DeviceTables => write!(f, "/kinect/{id}/tables"),
            ChannelKind::SerialBytes => write!(f, "/serial/{id}/bytes"),
            ChannelKind::Ledger => f.write_str("/ledger"),
        }
    }
}

impl ChannelKey {
    /// The channel an event is recorded on; `None` for a kind of event this format has no place for.
    pub fn of(body: &Body) -> Option<Self> {
        let (kind, sensor) = match body {
            Body::LidarPacket { sensor, .. } => (ChannelKind::LidarPackets, Some(sensor)),
            Body::DepthFrame { sensor, .. } => (ChannelKind::DepthRaw, Some(sensor)),
            Body::DeviceTables { sensor, .. } => (ChannelKind::DeviceTables, Some(sensor)),
            Body::SerialChunk { sensor, .. } => (ChannelKind::SerialBytes, Some(sensor)),
            Body::SensorState { .. }
            | Body::Skip { .. }
            | Body::Gap { .. }
            | Body::Anchor { .. }
            | Body::Tick
            | Body::Command(_)
            | Body::Config { .. } => (ChannelKind::Ledger, None),
            _ => return None,
        };
        Some(Self { kind, sensor: sensor.cloned() })
    }

    /// The channel's metadata in the file; what it is told by when read.
    pub(crate) fn metadata(&self) -> BTreeMap<String, String> {
        let mut metadata = BTreeMap::from([
            ("kind".to_owned(), self.kind.name().to_owned()),
            ("layout".to_owned(), self.kind.layout().to_owned()),
        ]);
        if let Some(sensor) = &self.sensor {
            metadata.insert("sensor".to_owned(), sensor.to_string());
        }
        metadata
    }

    pub(crate) fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let name = metadata.get("kind")?;
        let kind = ChannelKind::ALL.into_iter().find(|kind| kind.name() == name)?;
        let sensor = metadata.get("sensor").map(|id| SensorId::from(id.as_str()));
        // The ledger's channel alone is nobody's.
        (sensor.is_none() == (kind == ChannelKind::Ledger)).then_some(Self { kind, sensor })
    }
}

/// Appends an event as a message, the same bytes whoever records it. `false`, and nothing appended, for a kind of event
/// this format has no place for.
pub fn encode(event: &Event, into: &mut Vec<u8>) -> bool {
    let start = into.len();
    into.extend(event.seq.to_le_bytes());
    into.extend(event.arrived.0.to_le_bytes());
    match &event.body {
        Body::LidarPacket { bytes, .. } | Body::SerialChunk { bytes, .. } | Body::DeviceTables { bytes, .. } => {
            into.extend_from_slice(bytes);
        }
        Body::DepthFrame { ticks, encoding, lost_packets, bytes, .. } => {
            let encoding = match encoding {
                DepthEncoding::Packed11 => 0,
                DepthEncoding::Raw11 => 1,
                DepthEncoding::Mm16 => 2,
            };
            into.extend([encoding, u8::from(ticks.is_some()), 0, 0]);
            into.extend(ticks.unwrap_or_default().0.to_le_bytes());
            into.extend(mask_bytes(lost_packets));
            into.extend_from_slice(bytes);
        }
        Body::Tick => into.push(1),
        Body::Anchor { unix } => {
            into.push(2);
            into.extend(unix.0.to_le_bytes());
        }
        Body::SensorState { sensor, state } => {
            let state = match state {
                SourceState::Opened => 0,
                SourceState::Lost => 1,
                SourceState::Closed => 2,
            };
            into.extend([3, state]);
            into.extend_from_slice(sensor.as_str().as_bytes());
        }
        Body::Skip { sensor, scans } => {
            into.push(4);
            into.extend(scans.to_le_bytes());
            into.extend_from_slice(sensor.as_str().as_bytes());
        }
        Body::Gap { sensor, lost, place } => {
            let Some(place) = place_code(*place) else {
                into.truncate(start);
                return false;
            };
            into.extend([5, place]);
            into.extend(lost.to_le_bytes());
            into.extend_from_slice(sensor.as_str().as_bytes());
        }
        Body::Command(Command::Marker { text }) => {
            into.extend([6, 0]);
            into.extend_from_slice(text.as_bytes());
        }
        Body::Command(Command::LearnBackground { lasts_ms }) => {
            into.extend([6, 1]);
            into.extend(lasts_ms.to_le_bytes());
        }
        Body::Command(Command::ForgetBackground) => into.extend([6, 2]),
        Body::Command(Command::ResetFilter) => into.extend([6, 3]),
        Body::Config { toml } => {
            into.push(7);
            into.extend_from_slice(toml.as_bytes());
        }
        _ => {
            into.truncate(start);
            return false;
        }
    }
    true
}

/// Reads a message back; payloads share the message's memory. `None` when it is not what its channel says.
pub(crate) fn decode(channel: &ChannelKey, message: &Bytes) -> Option<Event> {
    let mut fields = Fields(message);
    let seq = fields.u64()?;
    let arrived = RigNs(fields.i64()?);
    let sensor = || channel.sensor.clone();
    let rest = |fields: &Fields<'_>| message.slice_ref(fields.0);
    let body = match channel.kind {
        ChannelKind::LidarPackets => Body::LidarPacket { sensor: sensor()?, bytes: rest(&fields) },
        ChannelKind::SerialBytes => Body::SerialChunk { sensor: sensor()?, bytes: rest(&fields) },
        ChannelKind::DeviceTables => Body::DeviceTables { sensor: sensor()?, bytes: rest(&fields) },
        ChannelKind::DepthRaw => {
            let encoding = match fields.u8()? {
                0 => DepthEncoding::Packed11,
                1 => DepthEncoding::Raw11,
                2 => DepthEncoding::Mm16,
                _ => return None,
            };
            let ticks_present = fields.u8()?;
            let _zero = fields.u16()?;
            let ticks = fields.u32()?;
            let ticks = (ticks_present != 0).then_some(KinectTicks(ticks));
            let lost_packets = mask(&fields.array()?);
            Body::DepthFrame { sensor: sensor()?, ticks, encoding, lost_packets, bytes: rest(&fields) }
        }
        ChannelKind::Ledger => ledger_body(&mut fields)?,
    };
    Some(Event { seq, arrived, body })
}

fn ledger_body(fields: &mut Fields<'_>) -> Option<Body> {
    let id = |fields: &Fields<'_>| std::str::from_utf8(fields.0).ok().map(SensorId::from);
    Some(match fields.u8()? {
        1 => Body::Tick,
        2 => Body::Anchor { unix: UnixNs(fields.i64()?) },
        3 => {
            let state = match fields.u8()? {
                0 => SourceState::Opened,
                1 => SourceState::Lost,
                2 => SourceState::Closed,
                _ => return None,
            };
            Body::SensorState { sensor: id(fields)?, state }
        }
        4 => {
            let scans = fields.u16()?;
            Body::Skip { sensor: id(fields)?, scans }
        }
        5 => {
            let place = fields.u8()?;
            let place = PLACES.iter().find(|(_, code, _)| *code == place).map(|(place, ..)| *place)?;
            let lost = fields.u32()?;
            Body::Gap { sensor: id(fields)?, lost, place }
        }
        6 => match fields.u8()? {
            0 => Body::Command(Command::Marker { text: text(fields, Command::TEXT_BYTES)? }),
            1 => Body::Command(Command::LearnBackground { lasts_ms: fields.u32()? }),
            2 => Body::Command(Command::ForgetBackground),
            3 => Body::Command(Command::ResetFilter),
            _ => return None,
        },
        7 => Body::Config { toml: text(fields, MAX_CONFIG_BYTES)? },
        _ => return None,
    })
}

/// The rest of a message as a text of at most so many bytes.
fn text(fields: &Fields<'_>, most: usize) -> Option<Arc<str>> {
    (fields.0.len() <= most).then(|| std::str::from_utf8(fields.0).ok().map(Arc::from))?
}

/// Places of loss: code in a gap, name in counters.
const PLACES: [(LossPoint, u8, &str); 5] = [
    (LossPoint::Kernel, 0, "kernel"),
    (LossPoint::Queue, 1, "queue"),
    (LossPoint::Usb, 2, "usb"),
    (LossPoint::Recorder, 3, "recorder"),
    (LossPoint::Capture, 4, "capture"),
];

fn place_code(place: LossPoint) -> Option<u8> {
    PLACES.iter().find(|(known, ..)| *known == place).map(|(_, code, _)| *code)
}

/// A place of loss as counters name it.
pub fn place_name(place: LossPoint) -> &'static str {
    PLACES.iter().find(|(known, ..)| *known == place).map_or("elsewhere", |(_, _, name)| name)
}

fn mask_bytes(mask: &PacketMask) -> [u8; MASK_BYTES] {
    let mut bytes = [0; MASK_BYTES];
    for packet in mask.iter() {
        if let Some(byte) = bytes.get_mut(packet / 8) {
            *byte |= 1 << (packet % 8);
        }
    }
    bytes
}

fn mask(bytes: &[u8; MASK_BYTES]) -> PacketMask {
    let mut mask = PacketMask::NONE;
    for (n, byte) in bytes.iter().enumerate().filter(|(_, byte)| **byte != 0) {
        (0..8).filter(|bit| byte >> bit & 1 == 1).for_each(|bit| mask.mark_lost(n * 8 + bit));
    }
    mask
}

/// The length of an event's payload, bytes: what the sensor gave, without heads.
pub fn payload_bytes(body: &Body) -> usize {
    match body {
        Body::LidarPacket { bytes, .. }
        | Body::DepthFrame { bytes, .. }
        | Body::SerialChunk { bytes, .. }
        | Body::DeviceTables { bytes, .. } => bytes.len(),
        _ => 0,
    }
}

/// Whether [`encode`] makes a message that may be recorded and is read back.
pub(crate) fn fits(body: &Body) -> bool {
    match body {
        Body::Command(Command::Marker { text }) => return text.len() <= Command::TEXT_BYTES,
        Body::Config { toml } => return toml.len() <= MAX_CONFIG_BYTES,
        _ => {}
    }
    let id = body.sensor().map_or(0, |sensor| sensor.as_str().len());
    payload_bytes(body).saturating_add(id) <= MAX_MESSAGE_BYTES - HEAD_BYTES - DEPTH_HEAD_BYTES
}
