//! ROS 2 bags: which topics are the sensors', and records from their messages.
//!
//! A bag is read once when it is opened, to learn its topics, what kind of images they hold and the earliest
//! stamp; rosbag2 writes no such list that could be relied on in an interrupted recording.

use super::cdr::{self, MessageFault};
use super::files::{PartKind, part_kind};
use super::packets::gap;
use super::rosbag_db3::Db3Messages;
use super::rosbag_mcap::McapMessages;
use super::routing::Routing;
use super::summary::{BrokenOff, CaptureSummary};
use super::{CaptureError, CaptureRecord, MAX_RECORD_BYTES, RecordSource, TopicFound};
use bytes::Bytes;
use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tumbled_model::{Body, DepthEncoding, PacketMask, SensorId, UnixNs};

/// What a bag says about a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Topic {
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) serialisation: String,
}

/// The messages that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MessageKind {
    Scan,
    Image,
    Other,
}

impl Topic {
    /// Stands for the topic of messages whose topic the bag does not declare: they are counted under this name.
    pub(crate) fn undeclared() -> Self {
        Self { name: "(undeclared)".to_owned(), type_name: String::new(), serialisation: String::new() }
    }

    fn kind(&self) -> MessageKind {
        match (self.serialisation.as_str(), self.type_name.as_str()) {
            ("cdr", "velodyne_msgs/msg/VelodyneScan" | "velodyne_msgs/VelodyneScan") => MessageKind::Scan,
            ("cdr", "sensor_msgs/msg/Image" | "sensor_msgs/Image") => MessageKind::Image,
            _ => MessageKind::Other,
        }
    }
}

/// One message as the bag holds it.
#[derive(Debug)]
pub(crate) struct Message {
    pub(crate) topic: Arc<Topic>,
    /// When the recorder had it; never negative.
    pub(crate) received: UnixNs,
    pub(crate) data: Bytes,
}

/// Why there is no next message.
pub(crate) enum StreamError {
    Fatal(CaptureError),
    Broken(BrokenOff),
}

/// A bag file's messages in file order.
pub(crate) trait Messages: Send {
    fn next_message(&mut self) -> Result<Option<Message>, StreamError>;
    /// The topics declared so far, with or without messages.
    fn topics(&self) -> Vec<Arc<Topic>>;
}

fn open_part(path: &Path) -> Result<Box<dyn Messages>, CaptureError> {
    Ok(match part_kind(path)? {
        PartKind::Mcap => Box::new(McapMessages::open(path)?),
        PartKind::Sqlite => Box::new(Db3Messages::open(path)?),
    })
}

/// What a message holds.
enum Content<'a> {
    /// Packets with the driver's stamps.
    Scan(Vec<(Option<UnixNs>, Bytes)>),
    Depth(cdr::DepthImage<'a>),
    Other,
}

fn content(kind: MessageKind, data: &Bytes) -> Result<Content<'_>, MessageFault> {
    match kind {
        MessageKind::Scan => {
            let packets = cdr::velodyne_scan(data)?;
            Ok(Content::Scan(packets.into_iter().map(|packet| (packet.stamp, data.slice(packet.data))).collect()))
        }
        MessageKind::Image => cdr::depth_image(data).map(Content::Depth),
        MessageKind::Other => Ok(Content::Other),
    }
}

/// rosbag2 in compression mode "message" leaves each message as a zstd frame; CDR never begins like one.
fn unpacked(data: &Bytes) -> Result<Bytes, MessageFault> {
    if !data.starts_with(b"\x28\xb5\x2f\xfd") {
        return Ok(data.clone());
    }
    let fault = || MessageFault::Zstd { limit: MAX_RECORD_BYTES };
    let Ok(decoder) = zstd::stream::read::Decoder::new(data.as_ref()) else {
        return Err(fault());
    };
    let mut message = Vec::new();
    let limit = MAX_RECORD_BYTES as u64 + 1;
    match decoder.take(limit).read_to_end(&mut message) {
        Ok(length) if length <= MAX_RECORD_BYTES => Ok(Bytes::from(message)),
        Ok(_) | Err(_) => Err(fault()),
    }
}

/// What the first reading learned about a topic.
struct Surveyed {
    topic: Arc<Topic>,
    image: Option<String>,
    is_depth: bool,
    earliest: Option<UnixNs>,
}

#[derive(Default)]
struct Survey {
    topics: BTreeMap<String, Surveyed>,
    broken: Option<Box<BrokenOff>>,
}

impl Survey {
    fn of(parts: &[PathBuf]) -> Result<Self, CaptureError> {
        let mut survey = Self::default();
        for path in parts {
            let mut part = open_part(path)?;
            loop {
                match part.next_message() {
                    Ok(Some(message)) => survey.add_message(&message),
                    Ok(None) => break,
                    Err(StreamError::Fatal(error)) => return Err(error),
                    Err(StreamError::Broken(broken)) => {
                        survey.broken.get_or_insert(Box::new(broken));
                        break;
                    }
                }
            }
            for topic in part.topics() {
                survey.topic(&topic);
            }
        }
        Ok(survey)
    }

    fn topic(&mut self, topic: &Arc<Topic>) -> &mut Surveyed {
        let new = || Surveyed { topic: topic.clone(), image: None, is_depth: false, earliest: None };
        self.topics.entry(topic.name.clone()).or_insert_with(new)
    }

    fn add_message(&mut self, message: &Message) {
        let kind = message.topic.kind();
        let surveyed = self.topic(&message.topic);
        if kind == MessageKind::Other {
            return;
        }
        let data = unpacked(&message.data);
        let content = data.as_ref().map_or(Ok(Content::Other), |data| content(kind, data));
        if kind == MessageKind::Image
            && surveyed.image.is_none()
            && let Ok(data) = &data
        {
            surveyed.image = cdr::image_form(data);
        }
        surveyed.is_depth |= matches!(content, Ok(Content::Depth(_)));
        let earliest = match &content {
            Ok(Content::Scan(packets)) => packets.iter().map(|(stamp, _)| stamp.unwrap_or(message.received)).min(),
            Ok(Content::Depth(image)) => Some(image.stamp.unwrap_or(message.received)),
            // It will be a gap at the time it was received.
            Ok(Content::Other) | Err(_) => Some(message.received),
        };
        surveyed.earliest = [surveyed.earliest, earliest].into_iter().flatten().min();
    }

    /// Which sensor has which topic: routes that name one first, the others in order of names.
    fn assign(&self, routing: &Routing) -> BTreeMap<String, SensorId> {
        let scans = self.topics.values().filter(|found| found.topic.kind() == MessageKind::Scan);
        let lidars = routing.lidars.iter().map(|lidar| (&lidar.id, lidar.topic.as_deref()));
        let mut assigned = assign_in_order(scans, lidars);
        let depth = self.topics.values().filter(|found| found.is_depth);
        let kinects = routing.kinects.iter().map(|kinect| (&kinect.id, kinect.topic.as_deref()));
        assigned.append(&mut assign_in_order(depth, kinects));
        assigned
    }

    fn found(&self) -> Vec<TopicFound> {
        let found = |surveyed: &Surveyed| TopicFound {
            name: surveyed.topic.name.clone(),
            type_name: surveyed.topic.type_name.clone(),
            serialisation: surveyed.topic.serialisation.clone(),
            image: surveyed.image.clone(),
        };
        self.topics.values().map(found).collect()
    }
}

fn assign_in_order<'a>(
    topics: impl Iterator<Item = &'a Surveyed>,
    routes: impl Iterator<Item = (&'a SensorId, Option<&'a str>)> + Clone,
) -> BTreeMap<String, SensorId> {
    let named = |topic: &str| routes.clone().find(|(_, wanted)| *wanted == Some(topic));
    let mut unnamed = routes.clone().filter(|(_, wanted)| wanted.is_none());
    let mut assigned = BTreeMap::new();
    for found in topics {
        let name = &found.topic.name;
        if let Some((id, _)) = named(name).or_else(|| unnamed.next()) {
            assigned.insert(name.clone(), id.clone());
        }
    }
    assigned
}

/// Records of a bag, part after part.
pub(crate) struct BagSource {
    parts: std::vec::IntoIter<PathBuf>,
    part: Option<Box<dyn Messages>>,
    sensors: BTreeMap<String, SensorId>,
    /// Packets of the scan that was read last: a scan holds about a tenth of a second.
    pending: VecDeque<CaptureRecord>,
    earliest: Option<UnixNs>,
}

impl BagSource {
    pub(crate) fn open(path: &Path, parts: Vec<PathBuf>, routing: &Routing) -> Result<Self, CaptureError> {
        let survey = Survey::of(&parts)?;
        let sensors = survey.assign(routing);
        if sensors.is_empty() {
            let topics = survey.found();
            return Err(CaptureError::NoUsableTopic { path: path.to_owned(), topics, broken: survey.broken });
        }
        let used = survey.topics.iter().filter(|(name, _)| sensors.contains_key(*name));
        let earliest = used.filter_map(|(_, surveyed)| surveyed.earliest).min();
        Ok(Self { parts: parts.into_iter(), part: None, sensors, pending: VecDeque::new(), earliest })
    }

    /// Queues a message's records.
    fn accept(&mut self, message: &Message, summary: &mut CaptureSummary) {
        let topic = &message.topic;
        let Some(sensor) = self.sensors.get(&topic.name) else {
            summary.count_unused(&topic.name, &topic.type_name, None);
            return;
        };
        let data = unpacked(&message.data);
        let content = match &data {
            Ok(data) => content(topic.kind(), data),
            Err(fault) => Err(fault.clone()),
        };
        match content {
            Ok(Content::Scan(packets)) => {
                for (stamp, bytes) in packets {
                    let host = stamp_or_received(stamp, message, summary);
                    summary.sensor(sensor).data_packets += 1;
                    let body = Body::LidarPacket { sensor: sensor.clone(), bytes };
                    self.pending.push_back(CaptureRecord::foreign(host, body));
                }
            }
            Ok(Content::Depth(image)) => {
                let host = stamp_or_received(image.stamp, message, summary);
                let body = Body::DepthFrame {
                    sensor: sensor.clone(),
                    ticks: None,
                    encoding: DepthEncoding::Mm16,
                    lost_packets: PacketMask::NONE,
                    bytes: image.samples(),
                };
                self.pending.push_back(CaptureRecord::foreign(host, body));
            }
            Ok(Content::Other) => summary.count_unused(&topic.name, &topic.type_name, None),
            Err(fault) => {
                // How many packets a broken scan held is not known: the gap says at least one.
                summary.count_unused(&topic.name, &topic.type_name, Some(fault));
                self.pending.push_back(CaptureRecord::foreign(message.received, gap(sensor, 1)));
            }
        }
    }
}

fn stamp_or_received(stamp: Option<UnixNs>, message: &Message, summary: &mut CaptureSummary) -> UnixNs {
    stamp.unwrap_or_else(|| {
        summary.receive_stamps_used += 1;
        message.received
    })
}

impl RecordSource for BagSource {
    fn next_record(&mut self, summary: &mut CaptureSummary) -> Option<Result<CaptureRecord, CaptureError>> {
        loop {
            if let Some(record) = self.pending.pop_front() {
                return Some(Ok(record));
            }
            let Some(part) = &mut self.part else {
                match open_part(&self.parts.next()?) {
                    Ok(part) => self.part = Some(part),
                    Err(error) => return Some(Err(error)),
                }
                continue;
            };
            match part.next_message() {
                Ok(Some(message)) => self.accept(&message, summary),
                Ok(None) => self.part = None,
                Err(StreamError::Fatal(error)) => return Some(Err(error)),
                Err(StreamError::Broken(broken)) => {
                    summary.broken_off.push(broken);
                    self.part = None;
                }
            }
        }
    }

    fn known_earliest(&self) -> Option<Option<UnixNs>> {
        Some(self.earliest)
    }
}
