//! pcap and pcapng files.

use super::super::{CaptureKind, Hint, Place, StampOrigin};
use super::*;
use etherparse::PacketBuilder;
use pcap_file::pcap::{PcapHeader, PcapWriter, RawPcapPacket};
use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{InterfaceDescriptionBlock, InterfaceDescriptionOption};
use pcap_file::{DataLink, Endianness, TsResolution};
use proptest::prelude::*;
use std::net::IpAddr;
use std::time::Duration;

const ADDRESS: [u8; 4] = [192, 168, 1, 201];

fn frame(port: u16, payload: &[u8]) -> Vec<u8> {
    let mut frame = Vec::new();
    let builder = PacketBuilder::ethernet2([2; 6], [255; 6]).ipv4(ADDRESS, [255; 4], 64).udp(443, port);
    builder.write(&mut frame, payload).unwrap();
    frame
}

/// A record: seconds, fraction, wire length, bytes.
type Raw<'a> = (u32, u32, usize, &'a [u8]);

fn pcap(endianness: Endianness, ts_resolution: TsResolution, datalink: DataLink, records: &[Raw<'_>]) -> Vec<u8> {
    let header = PcapHeader { endianness, ts_resolution, datalink, ..PcapHeader::default() };
    let mut writer = PcapWriter::with_header(Vec::new(), header).unwrap();
    for &(ts_sec, ts_frac, on_wire, bytes) in records {
        let (incl_len, orig_len) = (bytes.len() as u32, on_wire as u32);
        writer.write_raw_packet(&RawPcapPacket { ts_sec, ts_frac, incl_len, orig_len, data: bytes.into() }).unwrap();
    }
    writer.into_writer()
}

fn usual_pcap(records: &[Raw<'_>]) -> Vec<u8> {
    pcap(Endianness::Little, TsResolution::MicroSecond, DataLink::ETHERNET, records)
}

fn read_bytes(content: &[u8]) -> (Vec<CaptureRecord>, CaptureSummary) {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), content).unwrap();
    read_all(file.path())
}

#[test]
fn both_byte_orders_and_both_resolutions_give_the_same_packets() {
    let (data, position) = (frame(2368, &[7; 1206]), frame(8308, &[8; 512]));
    for order in [Endianness::Little, Endianness::Big] {
        for (resolution, ns) in [(TsResolution::MicroSecond, 1_000), (TsResolution::NanoSecond, 1)] {
            let records = [(1_700_000_000, 250, data.len(), &data[..]), (1_700_000_001, 0, position.len(), &position)];
            let (records, summary) = read_bytes(&pcap(order, resolution, DataLink::ETHERNET, &records));
            let first = 1_700_000_000_000_000_000 + 250 * ns;
            let second = 1_700_000_001_000_000_000;
            assert_eq!(records, [lidar(first, "front", &[7; 1206]), lidar(second, "front", &[8; 512])]);
            let front = summary.sensors[&SensorId::from("front")];
            assert_eq!((front.data_packets, front.position_packets, front.lost), (1, 1, 0));
            assert_eq!((summary.kind, summary.stamp_origin), (CaptureKind::Pcap, StampOrigin::Capture));
            assert_eq!((summary.earliest, summary.latest), (Some(UnixNs(first)), Some(UnixNs(second))));
            assert!(!summary.data_lost());
        }
    }
}

#[test]
fn pcapng_stamps_have_their_interfaces_unit() {
    let bytes = frame(2368, &[7; 1206]);
    for order in [Endianness::Little, Endianness::Big] {
        let mut writer = PcapNgWriter::with_endianness(Vec::new(), order).unwrap();
        let units = [None, Some(9), Some(0x80 | 10)];
        for unit in units {
            let options = unit.map(InterfaceDescriptionOption::IfTsResol).into_iter().collect();
            let block = InterfaceDescriptionBlock { linktype: DataLink::ETHERNET, snaplen: 0, options };
            writer.write_pcapng_block(block).unwrap();
        }
        let usb = InterfaceDescriptionBlock { linktype: DataLink::USB_LINUX, snaplen: 0, options: vec![] };
        writer.write_pcapng_block(usb).unwrap();
        // The writer puts the stamp's bare number, whatever the unit: 3 s in µs, ns and 1/1024 s.
        for (interface_id, stamp) in [(0, 3_000_000), (1, 3_000_000_000), (2, 3 * 1024), (3, 1)] {
            let block = EnhancedPacketBlock {
                interface_id,
                timestamp: Duration::from_nanos(stamp),
                original_len: bytes.len() as u32,
                data: bytes.as_slice().into(),
                options: vec![],
            };
            writer.write_pcapng_block(block).unwrap();
        }
        let content = writer.into_inner();
        let (records, summary) = read_bytes(&content);
        let expected = lidar(3_000_000_000, "front", &[7; 1206]);
        assert_eq!(records, [expected.clone(), expected.clone(), expected]);
        assert_eq!(summary.unread_link_types, [(189, 1)].into());
        assert!(summary.data_lost(), "the USB packet may have been a sensor's");
        assert_eq!(summary.kind, CaptureKind::PcapNg);
        // Without its last 100 bytes the file breaks off within the USB packet.
        let (records, summary) = read_bytes(&content[..content.len() - 100]);
        assert_eq!(records.len(), 3);
        // A block of 1 248 frame bytes: 12 + 20 + 1 248.
        assert_eq!(bytes.len(), 1248);
        assert_eq!(summary.broken_off[0].place, Place::Byte(content.len() as u64 - 1280));
    }
}

#[test]
fn a_file_cut_anywhere_gives_its_whole_packets_and_says_where_it_ends() {
    let bytes = frame(2368, &[7; 20]);
    let whole = usual_pcap(&[(1, 0, bytes.len(), &bytes), (2, 0, bytes.len(), &bytes)]);
    let record = 16 + bytes.len(); // 16 + 62
    assert_eq!(whole.len(), 24 + 2 * record);
    for length in 24..whole.len() {
        let (records, summary) = read_bytes(&whole[..length]);
        let (packets, rest) = ((length - 24) / record, (length - 24) % record);
        let front = summary.sensors.get(&SensorId::from("front")).copied().unwrap_or_default();
        assert_eq!(front.data_packets as usize, packets, "length {length}");
        // 16 bytes of record header and 42 of Ethernet, IP and UDP tell whose the broken one was.
        assert_eq!(front.lost, u64::from(rest >= 16 + 42), "length {length}");
        assert_eq!(records.len() as u64, front.data_packets + front.lost);
        let places: Vec<Place> = summary.broken_off.iter().map(|broken| broken.place).collect();
        let expected = if rest == 0 { vec![] } else { vec![Place::Byte((24 + packets * record) as u64)] };
        assert_eq!(places, expected, "length {length}");
    }
    for length in 1..24 {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &whole[..length]).unwrap();
        assert!(open_default(file.path()).is_err(), "length {length}");
    }
}

#[test]
fn a_pcapng_cut_within_its_header_says_how_long_it_is() {
    // Type, length, mark, version, section length, length again: 28 bytes, the lowest of each field first.
    let header = PcapNgWriter::with_endianness(Vec::new(), Endianness::Little).unwrap().into_inner();
    assert_eq!(header.len(), 28);
    let refusal = |content: &[u8]| {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), content).unwrap();
        open_default(file.path()).err().map(|error| error.to_string())
    };
    for length in 4..28 {
        let message = refusal(&header[..length]).unwrap();
        assert!(message.contains(&format!("ends after {length} bytes, within its header")), "{message}");
    }
    assert_eq!(refusal(&header), None);
    for (at, value, complaint) in [
        (4, 26, "byte 4: 26 where the length of a section header"),
        (8, 0x77, "byte 8: "),
        (12, 9, "byte 12: 9 where version 1"),
        (24, 32, "byte 4: 28 where the length that the section header is closed with"),
    ] {
        let mut wrong = header.clone();
        wrong[at] = value;
        let message = refusal(&wrong).unwrap();
        assert!(message.contains(complaint), "{message}");
    }
}

#[test]
fn a_cause_is_told_once() {
    let error = open_default(Path::new("/nowhere/drive.pcap")).err().unwrap();
    let mut told = error.to_string();
    let mut cause = std::error::Error::source(&error);
    while let Some(next) = cause {
        told.push_str(&format!(": {next}"));
        cause = next.source();
    }
    assert_eq!(told.matches("No such file or directory").count(), 1, "{told}");
}

#[test]
fn senders_to_a_data_port_are_told_apart() {
    let first = frame(2368, &[7; 1206]);
    let mut second = first.clone();
    second[14 + 15] = 202; // last byte of the source address behind 14 bytes of Ethernet and 12 of IP
    let position = frame(8308, &[8; 512]);
    let records = [&first, &second, &first, &position].map(|frame| (1, 0, frame.len(), &frame[..]));
    let (_, summary) = read_bytes(&usual_pcap(&records));
    let expected = [(IpAddr::from(ADDRESS), 2), (IpAddr::from([192, 168, 1, 202]), 1)];
    assert_eq!(summary.data_sources[&SensorId::from("front")], expected.into());
}

#[test]
fn cut_packets_become_gaps_and_padding_may_be_cut() {
    let long = frame(2368, &[7; 1206]);
    // 3 bytes of payload: 45 on the wire, padded to 60; the capture has 50 of them, the datagram whole.
    let mut short = frame(2368, &[1, 2, 3]);
    short.resize(50, 0);
    let records = [(1, 0, long.len(), &long[..96]), (2, 0, 60, &short), (3, 0, long.len(), &long[..30])];
    let (records, summary) = read_bytes(&usual_pcap(&records));
    assert_eq!(records, [lost(1_000_000_000, "front"), lidar(2_000_000_000, "front", &[1, 2, 3])]);
    assert_eq!(summary.cut_short, 2, "one known to be the LiDAR's, one cut before its port");
    assert!(summary.data_lost());
}

#[test]
fn a_claim_beyond_any_packet_ends_the_file_there() {
    let bytes = frame(2368, &[7; 20]);
    let mut content = usual_pcap(&[(1, 0, bytes.len(), &bytes)]);
    let place = content.len() as u64;
    content.extend([0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3]);
    let (records, summary) = read_bytes(&content);
    assert_eq!(records.len(), 1);
    assert_eq!(summary.broken_off[0].place, Place::Byte(place));
    assert!(summary.broken_off[0].to_string().contains("claims 4294967295 bytes"), "{}", summary.broken_off[0]);
}

#[test]
fn a_capture_of_another_port_or_address_says_what_to_set() {
    let (other, dns) = (frame(2369, &[7; 1206]), frame(53, &[1; 40]));
    let content = usual_pcap(&[(1, 0, other.len(), &other), (1, 0, dns.len(), &dns)]);
    let (records, summary) = read_bytes(&content);
    assert_eq!(records, []);
    assert_eq!(summary.other_ports[&53].payload_bytes, 40);
    assert_eq!(summary.hint(), Some(Hint::OtherPort { port: 2369, datagrams: 1 }));

    let file = tempfile::NamedTempFile::new().unwrap();
    let data = frame(2368, &[7; 1206]);
    std::fs::write(file.path(), usual_pcap(&[(1, 0, data.len(), &data)])).unwrap();
    let mut routing = Routing::default();
    routing.lidars[0].source = Some(IpAddr::from([10, 0, 0, 1]));
    let (records, summary) = read_routed(file.path(), &routing);
    assert_eq!(records, []);
    assert_eq!(summary.hint(), Some(Hint::OtherSource { address: IpAddr::from(ADDRESS), datagrams: 1 }));
    routing.lidars[0].source = Some(IpAddr::from(ADDRESS));
    assert_eq!(read_routed(file.path(), &routing).0.len(), 1);
}

#[test]
fn link_types_that_hold_no_ip_are_refused_by_number() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let content = pcap(Endianness::Little, TsResolution::MicroSecond, DataLink::USB_LINUX, &[]);
    std::fs::write(file.path(), content).unwrap();
    let message = open_default(file.path()).err().unwrap().to_string();
    assert!(message.contains("link type 189 is not read"), "{message}");
}

#[test]
fn payloads_of_any_length_on_the_data_port_are_delivered() {
    let frames: Vec<Vec<u8>> = [0usize, 1, 512, 1205, 1248].iter().map(|&len| frame(2368, &vec![9; len])).collect();
    let records: Vec<Raw<'_>> = frames.iter().map(|frame| (1, 0, frame.len(), &frame[..])).collect();
    let (records, _) = read_bytes(&usual_pcap(&records));
    let lengths: Vec<usize> = records
        .iter()
        .map(|record| match &record.body {
            Body::LidarPacket { bytes, .. } => bytes.len(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(lengths, [0, 1, 512, 1205, 1248]);
}

/// All that `content` yields, when it opens at all; the check that nothing is delivered twice.
fn deliver(content: &[u8]) -> usize {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), content).unwrap();
    let Ok(capture) = open_default(file.path()) else { return 0 };
    let bytes = capture.map(|record| match record.unwrap().body {
        Body::LidarPacket { bytes, .. } => bytes.len(),
        _ => 0,
    });
    bytes.sum()
}

proptest! {
    #[test]
    fn any_bytes_behind_a_pcap_header_end_without_panic(
        tail in prop::collection::vec(any::<u8>(), 0..400), big in any::<bool>(), ns in any::<bool>(),
        link in prop::sample::select(vec![0, 1, 101, 113, 276, 7]),
    ) {
        let order = if big { Endianness::Big } else { Endianness::Little };
        let resolution = if ns { TsResolution::NanoSecond } else { TsResolution::MicroSecond };
        let mut content = pcap(order, resolution, DataLink::from(link), &[]);
        content.extend(&tail);
        prop_assert!(deliver(&content) <= tail.len());
    }

    #[test]
    fn flipped_bytes_in_a_pcap_or_pcapng_end_without_panic(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), ng in any::<bool>(),
    ) {
        let bytes = frame(2368, &[7; 64]);
        let mut content = if ng {
            let mut writer = PcapNgWriter::new(Vec::new()).unwrap();
            let options = vec![InterfaceDescriptionOption::IfTsResol(9), InterfaceDescriptionOption::IfTsOffset(5)];
            let interface = InterfaceDescriptionBlock { linktype: DataLink::ETHERNET, snaplen: 0, options };
            writer.write_pcapng_block(interface).unwrap();
            for _ in 0..3 {
                let block = EnhancedPacketBlock { interface_id: 0, timestamp: Duration::from_secs(1),
                    original_len: bytes.len() as u32, data: bytes.as_slice().into(), options: vec![] };
                writer.write_pcapng_block(block).unwrap();
            }
            writer.into_inner()
        } else {
            usual_pcap(&[(1, 0, bytes.len(), &bytes), (2, 0, bytes.len(), &bytes), (3, 0, bytes.len(), &bytes)])
        };
        for (at, value) in flips {
            let at = at.index(content.len());
            content[at] ^= value;
        }
        prop_assert!(deliver(&content) <= content.len());
    }

    #[test]
    fn any_bytes_behind_a_pcapng_section_end_without_panic(tail in prop::collection::vec(any::<u32>(), 0..60)) {
        let mut content = PcapNgWriter::new(Vec::new()).unwrap().into_inner();
        let before = content.len();
        // Small words are likely to be block types and lengths that fit.
        content.extend(tail.iter().flat_map(|word| if word % 3 == 0 { word % 64 } else { *word }.to_le_bytes()));
        prop_assert!(deliver(&content) <= content.len() - before);
    }
}
