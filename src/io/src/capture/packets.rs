//! From the packets of a pcap or pcapng to records of the sensors.

use super::datagram::{Content, LinkType, dissect};
use super::pcap::PcapFraming;
use super::pcapng::PcapNgFraming;
use super::routing::{Destination, Routing};
use super::summary::{BrokenOff, CaptureSummary, Place};
use super::{CaptureError, CaptureRecord, RecordSource};
use bytes::Bytes;
use std::io::Read;
use std::path::{Path, PathBuf};
use tumbled_model::{Body, LossPoint, SensorId, UnixNs};

/// What a capture file says about a packet.
#[derive(Debug)]
pub(crate) struct PacketHead {
    /// `None`: the file has no (possible) time for it.
    pub(crate) host: Option<UnixNs>,
    /// The number of the link type when it is not one that is read.
    pub(crate) link: Result<LinkType, u16>,
    /// Fewer bytes are here than were on the wire.
    pub(crate) cut: bool,
    /// The file ends within this packet.
    pub(crate) ends_early: Option<(Place, String)>,
}

/// Why there is no next packet.
pub(crate) enum FramingError {
    /// The system could not read.
    Io(std::io::Error),
    /// The file is damaged here and the next record cannot be found.
    Broken { place: Place, detail: String },
}

impl From<std::io::Error> for FramingError {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

/// A file format that holds packets one after the other.
pub(crate) trait Framing: Send {
    /// Reads the next packet's bytes into `frame`; `None` at a clean end of the file.
    fn next_packet(&mut self, frame: &mut Vec<u8>) -> Result<Option<PacketHead>, FramingError>;
}

/// Reading of at most so many bytes, by what is there and not by what is claimed to be.
pub(crate) trait ReadUpTo: Read + Sized {
    /// Appends up to `count` bytes, fewer only at the end of the file; memory grows with what arrives.
    fn read_up_to(&mut self, count: usize, into: &mut Vec<u8>) -> std::io::Result<()> {
        self.by_ref().take(count as u64).read_to_end(into).map(|_| ())
    }
}

impl<R: Read> ReadUpTo for R {}

/// Records of a pcap or pcapng.
pub(crate) struct PacketSource {
    path: PathBuf,
    routing: Routing,
    framing: Box<dyn Framing>,
    frame: Vec<u8>,
}

impl PacketSource {
    pub(crate) fn pcap(path: &Path, routing: &Routing) -> Result<Self, CaptureError> {
        Ok(Self::new(path, routing, Box::new(PcapFraming::open(path)?)))
    }

    pub(crate) fn pcapng(path: &Path, routing: &Routing) -> Result<Self, CaptureError> {
        Ok(Self::new(path, routing, Box::new(PcapNgFraming::open(path)?)))
    }

    fn new(path: &Path, routing: &Routing, framing: Box<dyn Framing>) -> Self {
        Self { path: path.to_owned(), routing: routing.clone(), framing, frame: Vec::new() }
    }

    /// The record in one packet, if it is a sensor's; anything else is counted.
    fn route(&self, head: &PacketHead, summary: &mut CaptureSummary) -> Option<CaptureRecord> {
        let link = match head.link {
            Ok(link) => link,
            Err(number) => {
                *summary.unread_link_types.entry(number).or_default() += 1;
                return None;
            }
        };
        let (source, port, claimed, payload) = match dissect(link, &self.frame) {
            Content::Udp { source, destination_port, claimed, payload } => (source, destination_port, claimed, payload),
            Content::Fragment => {
                summary.fragments += 1;
                return None;
            }
            Content::NotUdp => {
                summary.not_udp += 1;
                return None;
            }
            Content::Malformed if head.cut => {
                summary.cut_short += 1;
                return None;
            }
            Content::Malformed => {
                summary.malformed_frames += 1;
                return None;
            }
        };
        let (sensor, is_data) = match self.routing.datagram(source, port) {
            Destination::Data(sensor) => (sensor, true),
            Destination::Position(sensor) => (sensor, false),
            Destination::OtherSource => {
                summary.count_other_source(source);
                return None;
            }
            Destination::OtherPort => {
                summary.count_other_port(port, claimed);
                return None;
            }
        };
        let Some(host) = head.host else {
            summary.untimed += 1;
            return None;
        };
        // A frame may be cut in its padding only: then the datagram is whole.
        if payload.len() < claimed {
            summary.cut_short += 1;
            return Some(CaptureRecord::foreign(host, gap(sensor, 1)));
        }
        let traffic = summary.sensor(sensor);
        if is_data {
            traffic.data_packets += 1;
            summary.count_data_source(sensor, source);
        } else {
            traffic.position_packets += 1;
        }
        let body = Body::LidarPacket { sensor: sensor.clone(), bytes: Bytes::copy_from_slice(payload) };
        Some(CaptureRecord::foreign(host, body))
    }

    fn note_break(&self, place: Place, detail: String, summary: &mut CaptureSummary) {
        summary.broken_off.push(BrokenOff { path: self.path.clone(), place, detail });
    }
}

/// Something of a sensor that the capture lost.
pub(crate) fn gap(sensor: &SensorId, lost: u32) -> Body {
    Body::Gap { sensor: sensor.clone(), lost, place: LossPoint::Capture }
}

impl RecordSource for PacketSource {
    fn next_record(&mut self, summary: &mut CaptureSummary) -> Option<Result<CaptureRecord, CaptureError>> {
        loop {
            let head = match self.framing.next_packet(&mut self.frame) {
                Ok(head) => head?,
                Err(FramingError::Io(source)) => {
                    return Some(Err(CaptureError::Io { path: self.path.clone(), source }));
                }
                Err(FramingError::Broken { place, detail }) => {
                    self.note_break(place, detail, summary);
                    return None;
                }
            };
            let record = self.route(&head, summary);
            if let Some((place, detail)) = head.ends_early {
                self.note_break(place, detail, summary);
            }
            if let Some(record) = record {
                return Some(Ok(record));
            }
        }
    }

    fn known_earliest(&self) -> Option<Option<UnixNs>> {
        None
    }
}
