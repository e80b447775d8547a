//! What a capture held, and what of it was left out.

use super::CaptureRecord;
use super::cdr::MessageFault;
use crate::recording::RecordingInfo;
use core::fmt;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use tumbled_model::{Body, SensorId, UnixNs};

/// Payload of a Velodyne data packet: 12 blocks of 100 bytes and 6 bytes of time and product.
const LIDAR_DATA_BYTES: usize = 1206;

/// At most so many addresses and damaged files are listed by name.
const LISTED: usize = 64;

/// The kind of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum CaptureKind {
    /// Classic libpcap.
    Pcap,
    /// pcapng.
    PcapNg,
    /// ROS 2 bag, MCAP or SQLite, one file or several.
    Rosbag,
    /// fakenect dump folder, or one file of it.
    Fakenect,
    /// Depth PNGs, a folder or one.
    DepthPngs,
    /// Recording of this program.
    Recording,
}

impl fmt::Display for CaptureKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pcap => "pcap",
            Self::PcapNg => "pcapng",
            Self::Rosbag => "ROS 2 bag",
            Self::Fakenect => "fakenect dump",
            Self::DepthPngs => "depth PNGs",
            Self::Recording => "recording",
        })
    }
}

/// Where the host stamps of a capture come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum StampOrigin {
    /// The capturing program stamped each record as it received it (pcap, fakenect).
    Capture,
    /// The sensor's ROS driver stamped packets and images; see also [`CaptureSummary::receive_stamps_used`].
    Message,
    /// `times.txt` beside the frames.
    TimesFile,
    /// The recorder's ledger, to the nanosecond.
    Ledger,
    /// None: frame k is at k × 33 333 333 ns after 1970-01-01.
    Synthetic,
}

impl fmt::Display for StampOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Capture => "receive stamps of the capture",
            Self::Message => "driver stamps inside the messages",
            Self::TimesFile => "times.txt",
            Self::Ledger => "recorded with the ledger",
            Self::Synthetic => "synthetic (no times in the input: 30 Hz assumed)",
        })
    }
}

/// What one sensor had.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SensorTraffic {
    /// Datagrams on the data port, or packets of scans, delivered.
    pub data_packets: u64,
    /// Datagrams on the position port, delivered.
    pub position_packets: u64,
    /// Depth frames delivered.
    pub depth_frames: u64,
    /// Packets or frames posted as lost.
    pub lost: u64,
}

/// Datagrams to a UDP port that no sensor has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortTraffic {
    /// All of them.
    pub datagrams: u64,
    /// Payload length of the first, bytes.
    pub payload_bytes: usize,
    /// Those with 1 206 bytes, as a Velodyne data packet.
    pub lidar_sized: u64,
}

/// Messages of a topic that were not used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicTraffic {
    /// The topic's type.
    pub type_name: String,
    /// How many messages.
    pub messages: u64,
    /// Why the first was not usable; `None`: no sensor of the config has this topic.
    pub first_fault: Option<MessageFault>,
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Offset in bytes of the record that cannot be read.
    Byte(u64),
    /// The last row (table `messages`) that could be read.
    AfterRow(i64),
}

/// A file whose rest cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokenOff {
    /// The file.
    pub path: PathBuf,
    /// Where.
    pub place: Place,
    /// What is wrong there.
    pub detail: String,
}

impl fmt::Display for BrokenOff {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is readable only up to ", self.path.display())?;
        match self.place {
            Place::Byte(offset) => write!(f, "byte {offset}")?,
            Place::AfterRow(row) => write!(f, "row {row}")?,
        }
        write!(f, ": {}", self.detail)
    }
}

/// A frame's file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedFile {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub detail: String,
}

/// What to change in the config when a capture gave a LiDAR nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hint {
    /// Data packets go to another port.
    OtherPort {
        /// That port.
        port: u16,
        /// Datagrams of 1 206 bytes to it.
        datagrams: u64,
    },
    /// Datagrams on the right port come from an address that `source` excludes.
    OtherSource {
        /// That address.
        address: IpAddr,
        /// Datagrams from it.
        datagrams: u64,
    },
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OtherPort { port, .. } => write!(f, "1206-byte datagrams go to port {port}: set lidar.port={port}"),
            Self::OtherSource { address, .. } => {
                write!(f, "datagrams on the LiDAR's port come from {address}: set lidar.source={address}")
            }
        }
    }
}

/// What a capture held, and what of it was left out. Complete once the capture is at its end.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct CaptureSummary {
    /// What it is.
    pub kind: CaptureKind,
    /// What the host stamps are worth.
    pub stamp_origin: StampOrigin,
    /// Delivered and lost, by sensor.
    pub sensors: BTreeMap<SensorId, SensorTraffic>,
    /// Addresses that datagrams on each LiDAR's data port came from, and how many; the first 64 addresses of each.
    pub data_sources: BTreeMap<SensorId, BTreeMap<IpAddr, u64>>,
    /// Earliest host stamp delivered.
    pub earliest: Option<UnixNs>,
    /// Latest host stamp delivered.
    pub latest: Option<UnixNs>,
    /// Records whose host stamp is before that of the record in front of them.
    pub backward_steps: u64,
    /// Frames of the network that are not UDP over IP.
    pub not_udp: u64,
    /// Datagrams to ports that no sensor has.
    pub other_ports: BTreeMap<u16, PortTraffic>,
    /// Datagrams on a LiDAR's port from addresses that its `source` excludes; the first 64 addresses.
    pub other_sources: BTreeMap<IpAddr, u64>,
    /// IP fragments: not put together, so what they carried is not delivered.
    pub fragments: u64,
    /// Frames whose IP or UDP headers contradict themselves.
    pub malformed_frames: u64,
    /// Frames cut by the capture's snap length: posted as a gap where the sensor is known.
    pub cut_short: u64,
    /// Frames of pcapng interfaces whose link type is not read, by link type.
    pub unread_link_types: BTreeMap<u16, u64>,
    /// Packets that the capture file holds without a time (pcapng simple packets), or with one before 1970 or after 2262.
    pub untimed: u64,
    /// Messages that were not used, by topic.
    pub unused_topics: BTreeMap<String, TopicTraffic>,
    /// Messages whose own stamp is zero or impossible: the bag's receive time stands in for it.
    pub receive_stamps_used: u64,
    /// Files of a dump that are no depth frames (colour, accelerometer).
    pub ignored_files: u64,
    /// Frames' files that cannot be read: posted as gaps.
    pub damaged_frames: u64,
    /// The first 64 of these.
    pub damaged_files: Vec<DamagedFile>,
    /// Files whose rest cannot be read; what they had before that is delivered.
    pub broken_off: Vec<BrokenOff>,
    /// What the recording holds, at its end; `None` for foreign captures.
    pub recording: Option<Box<RecordingInfo>>,
    newest: Option<UnixNs>,
}

impl CaptureSummary {
    pub(crate) fn new(kind: CaptureKind, stamp_origin: StampOrigin) -> Self {
        Self {
            kind,
            stamp_origin,
            sensors: BTreeMap::new(),
            data_sources: BTreeMap::new(),
            earliest: None,
            latest: None,
            backward_steps: 0,
            not_udp: 0,
            other_ports: BTreeMap::new(),
            other_sources: BTreeMap::new(),
            fragments: 0,
            malformed_frames: 0,
            cut_short: 0,
            unread_link_types: BTreeMap::new(),
            untimed: 0,
            unused_topics: BTreeMap::new(),
            receive_stamps_used: 0,
            ignored_files: 0,
            damaged_frames: 0,
            damaged_files: Vec::new(),
            broken_off: Vec::new(),
            recording: None,
            newest: None,
        }
    }

    /// Whether anything that belonged, or may have belonged, to a sensor is missing.
    pub fn data_lost(&self) -> bool {
        !self.broken_off.is_empty()
            || self.recording.as_ref().is_some_and(|recording| !recording.whole())
            || self.cut_short > 0
            || self.fragments > 0
            || self.malformed_frames > 0
            || !self.unread_link_types.is_empty()
            || self.untimed > 0
            || self.damaged_frames > 0
            || self.sensors.values().any(|traffic| traffic.lost > 0)
            || self.unused_topics.values().any(|topic| topic.first_fault.is_some())
    }

    /// What to change in the config, when no LiDAR got any data packet but something that looks like one is there.
    pub fn hint(&self) -> Option<Hint> {
        if self.sensors.values().any(|traffic| traffic.data_packets > 0) {
            return None;
        }
        // The busiest; of equals the lowest.
        let port = self.other_ports.iter().rev().max_by_key(|(_, traffic)| traffic.lidar_sized);
        if let Some((&port, traffic)) = port
            && traffic.lidar_sized > 0
        {
            return Some(Hint::OtherPort { port, datagrams: traffic.lidar_sized });
        }
        let (&address, &datagrams) = self.other_sources.iter().rev().max_by_key(|(_, count)| **count)?;
        Some(Hint::OtherSource { address, datagrams })
    }

    pub(crate) fn sensor(&mut self, id: &SensorId) -> &mut SensorTraffic {
        // Not the entry API: it would clone the id for every packet.
        if !self.sensors.contains_key(id) {
            self.sensors.insert(id.clone(), SensorTraffic::default());
        }
        self.sensors.get_mut(id).expect("inserted above")
    }

    /// Counts what only the record itself tells; data and position packets are counted where they are told apart.
    pub(crate) fn count_record(&mut self, record: &CaptureRecord) {
        match &record.body {
            Body::DepthFrame { sensor, .. } => self.sensor(sensor).depth_frames += 1,
            Body::Gap { sensor, lost, .. } => self.sensor(sensor).lost += u64::from(*lost),
            _ => {}
        }
        self.earliest = Some(self.earliest.map_or(record.host, |earliest| earliest.min(record.host)));
        self.latest = Some(self.latest.map_or(record.host, |latest| latest.max(record.host)));
        if self.newest.is_some_and(|before| record.host < before) {
            self.backward_steps += 1;
        }
        self.newest = Some(record.host);
    }

    pub(crate) fn count_other_port(&mut self, port: u16, payload_bytes: usize) {
        let traffic = self.other_ports.entry(port).or_insert(PortTraffic { payload_bytes, ..PortTraffic::default() });
        traffic.datagrams += 1;
        traffic.lidar_sized += u64::from(payload_bytes == LIDAR_DATA_BYTES);
    }

    pub(crate) fn count_other_source(&mut self, address: IpAddr) {
        count_address(&mut self.other_sources, address);
    }

    pub(crate) fn count_data_source(&mut self, id: &SensorId, address: IpAddr) {
        match self.data_sources.get_mut(id) {
            Some(addresses) => count_address(addresses, address),
            None => {
                self.data_sources.insert(id.clone(), BTreeMap::from([(address, 1)]));
            }
        }
    }

    pub(crate) fn count_unused(&mut self, topic: &str, type_name: &str, fault: Option<MessageFault>) {
        if !self.unused_topics.contains_key(topic) {
            let traffic = TopicTraffic { type_name: type_name.to_owned(), ..TopicTraffic::default() };
            self.unused_topics.insert(topic.to_owned(), traffic);
        }
        let traffic = self.unused_topics.get_mut(topic).expect("inserted above");
        traffic.messages += 1;
        if traffic.first_fault.is_none() {
            traffic.first_fault = fault;
        }
    }

    pub(crate) fn count_damaged(&mut self, path: &Path, detail: impl fmt::Display) {
        self.damaged_frames += 1;
        if self.damaged_files.len() < LISTED {
            self.damaged_files.push(DamagedFile { path: path.to_owned(), detail: detail.to_string() });
        }
    }
}

/// One more from an address; beyond the bound only addresses that are listed already are counted.
fn count_address(addresses: &mut BTreeMap<IpAddr, u64>, address: IpAddr) {
    if addresses.len() < LISTED || addresses.contains_key(&address) {
        *addresses.entry(address).or_default() += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hint_names_the_port_that_gets_most_data_packets() {
        let mut summary = CaptureSummary::new(CaptureKind::Pcap, StampOrigin::Capture);
        assert_eq!(summary.hint(), None);
        summary.count_other_port(53, 80);
        assert_eq!(summary.hint(), None, "80 bytes are no LiDAR packet");
        for port in [2370, 2369, 2369] {
            summary.count_other_port(port, 1206);
        }
        let hint = summary.hint().expect("three packets of 1206 bytes");
        assert_eq!(hint, Hint::OtherPort { port: 2369, datagrams: 2 });
        assert_eq!(hint.to_string(), "1206-byte datagrams go to port 2369: set lidar.port=2369");
        summary.sensor(&SensorId::from("front")).data_packets = 1;
        assert_eq!(summary.hint(), None, "a LiDAR has data: no advice is asked for");
    }

    #[test]
    fn addresses_are_listed_up_to_a_bound() {
        let mut summary = CaptureSummary::new(CaptureKind::Pcap, StampOrigin::Capture);
        for n in 0..1000u32 {
            summary.count_other_source(IpAddr::from(n.to_be_bytes()));
            summary.count_data_source(&SensorId::from("front"), IpAddr::from(n.to_be_bytes()));
        }
        assert_eq!(summary.other_sources.len(), LISTED);
        assert_eq!(summary.data_sources[&SensorId::from("front")].len(), LISTED);
    }

    #[test]
    fn whatever_may_have_been_a_sensors_is_data_lost() {
        let whole = || CaptureSummary::new(CaptureKind::PcapNg, StampOrigin::Capture);
        assert!(!whole().data_lost());
        assert!(CaptureSummary { malformed_frames: 1, ..whole() }.data_lost());
        assert!(CaptureSummary { fragments: 1, ..whole() }.data_lost());
        assert!(CaptureSummary { unread_link_types: [(189, 1)].into(), ..whole() }.data_lost());
        assert!(!CaptureSummary { not_udp: 1, ..whole() }.data_lost(), "ARP is nobody's");
    }
}
