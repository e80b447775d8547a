//! UDP payloads in a pcap file.

use etherparse::PacketBuilder;
use pcap_file::pcap::{PcapHeader, PcapWriter, RawPcapPacket};
use pcap_file::{DataLink, PcapError, TsResolution};
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use tumbled_model::UnixNs;

/// The address a Velodyne has when it leaves the factory; it sends to everybody.
const SENSOR: [u8; 4] = [192, 168, 1, 201];
/// Velodyne's own prefix of hardware addresses.
const SENSOR_MAC: [u8; 6] = [0x60, 0x76, 0x88, 0, 0, 1];
const TIME_TO_LIVE: u8 = 64;

/// A pcap file with nanosecond stamps: Ethernet frames of UDP datagrams from one sensor.
pub struct PcapFile {
    writer: PcapWriter<BufWriter<File>>,
    frame: Vec<u8>,
}

impl std::fmt::Debug for PcapFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PcapFile").finish_non_exhaustive()
    }
}

impl PcapFile {
    /// Begins a file; one of this name is replaced.
    ///
    /// # Errors
    /// What the system says.
    pub fn create(path: &Path) -> io::Result<Self> {
        let header = PcapHeader {
            ts_resolution: TsResolution::NanoSecond,
            datalink: DataLink::ETHERNET,
            endianness: pcap_file::Endianness::Little,
            ..PcapHeader::default()
        };
        let writer = PcapWriter::with_header(BufWriter::new(File::create(path)?), header).map_err(io_error)?;
        Ok(Self { writer, frame: Vec::new() })
    }

    /// Adds a datagram that the host had at `host` (from 1970 on), sent to `port` from the same.
    ///
    /// # Errors
    /// What the system says; a payload that no datagram holds (65 507 bytes).
    pub fn write(&mut self, host: UnixNs, port: u16, payload: &[u8]) -> io::Result<()> {
        self.frame.clear();
        let builder =
            PacketBuilder::ethernet2(SENSOR_MAC, [0xFF; 6]).ipv4(SENSOR, [255; 4], TIME_TO_LIVE).udp(port, port);
        builder.write(&mut self.frame, payload).map_err(io::Error::other)?;
        let since_1970 = std::time::Duration::from_nanos(u64::try_from(host.0).unwrap_or(0));
        let length = self.frame.len() as u32;
        let packet = RawPcapPacket {
            ts_sec: since_1970.as_secs() as u32,
            ts_frac: since_1970.subsec_nanos(),
            incl_len: length,
            orig_len: length,
            data: Cow::Borrowed(&self.frame),
        };
        self.writer.write_raw_packet(&packet).map_err(io_error).map(|_| ())
    }

    /// Ends the file.
    ///
    /// # Errors
    /// What the system says.
    pub fn finish(self) -> io::Result<()> {
        self.writer.into_writer().flush()
    }
}

fn io_error(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{self, LidarRoute, Routing};
    use tumbled_model::{Body, Event, RigNs, SensorId};

    #[test]
    fn what_is_written_is_read_as_a_capture_with_its_times() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("velodyne.pcap");
        let start = 1_795_341_600_000_000_000;
        let mut file = PcapFile::create(&path).expect("creates");
        file.write(UnixNs(start), 2368, &[7; 1_206]).expect("writes");
        file.write(UnixNs(start + 663_552), 8308, &[8; 512]).expect("writes");
        file.finish().expect("ends");
        let lidar = LidarRoute { id: "front".into(), port: 2368, position_port: 8308, source: None, topic: None };
        let routing = Routing { lidars: vec![lidar], kinects: Vec::new() };
        let merged = capture::merge(capture::open_all(&[&path], &routing).expect("opens")).expect("merges");
        assert_eq!(merged.epoch(), Some(UnixNs(start)));
        let events: Vec<Event> = merged.collect::<Result<_, _>>().expect("reads");
        let packet = |bytes: Vec<u8>| Body::LidarPacket { sensor: SensorId::from("front"), bytes: bytes.into() };
        assert_eq!(events[0].body, packet(vec![7; 1_206]));
        assert_eq!((events[1].arrived, &events[1].body), (RigNs(663_552), &packet(vec![8; 512])));
    }
}
