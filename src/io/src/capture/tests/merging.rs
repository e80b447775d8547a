//! Several inputs as one ledger.

use super::super::merge;
use super::*;
use proptest::prelude::*;
use std::fs;
use std::path::PathBuf;
use tumbled_model::{Event, RigNs};

/// A one-sensor pcap with a packet at each of these seconds; its payload is its number in the file.
fn pcap(folder: &Path, name: &str, port: u16, seconds: &[u32]) -> PathBuf {
    let mut content = vec![0xd4, 0xc3, 0xb2, 0xa1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 101, 0, 0, 0];
    for (n, second) in seconds.iter().enumerate() {
        let mut packet = Vec::new();
        let builder = etherparse::PacketBuilder::ipv4([10, 0, 0, 1], [255; 4], 64).udp(443, port);
        builder.write(&mut packet, &[n as u8]).unwrap();
        for field in [*second, 0, packet.len() as u32, packet.len() as u32] {
            content.extend(field.to_le_bytes());
        }
        content.extend(packet);
    }
    let path = folder.join(name);
    fs::write(&path, content).unwrap();
    path
}

/// Of an event: seq, arrived in seconds, sensor, number in its file.
type Brief = (u64, i64, String, u8);

fn merged(paths: &[PathBuf]) -> (Option<UnixNs>, Vec<Brief>) {
    let mut routing = Routing::default();
    let second = super::super::LidarRoute { id: SensorId::from("rear"), port: 2369, ..routing.lidars[0].clone() };
    routing.lidars.push(second);
    let merged = merge(paths.iter().map(|path| open(path, &routing).unwrap()).collect()).unwrap();
    let epoch = merged.epoch();
    let describe = |event: Event| match event.body {
        Body::LidarPacket { sensor, bytes } => {
            (event.seq, event.arrived.0 / 1_000_000_000, sensor.to_string(), bytes[0])
        }
        other => panic!("{other:?}"),
    };
    (epoch, merged.map(|event| describe(event.unwrap())).collect())
}

#[test]
fn inputs_are_merged_by_host_time_and_ties_go_to_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let a = pcap(folder.path(), "a", 2368, &[10, 12, 14]);
    let b = pcap(folder.path(), "b", 2369, &[11, 12, 20]);
    let (epoch, events) = merged(&[a.clone(), b.clone()]);
    assert_eq!(epoch, Some(UnixNs(10_000_000_000)));
    let expected = [(0, "front", 0), (1, "rear", 0), (2, "front", 1), (2, "rear", 1), (4, "front", 2), (10, "rear", 2)];
    let expected: Vec<_> = expected
        .iter()
        .enumerate()
        .map(|(seq, &(second, sensor, n))| (seq as u64, second, sensor.to_owned(), n))
        .collect();
    assert_eq!(events, expected);
    // The other way round only the tie changes.
    let (_, events) = merged(&[b, a]);
    assert_eq!((&events[2].2[..], &events[3].2[..]), ("rear", "front"));
}

#[test]
fn time_zero_is_the_earliest_stamp_even_where_a_file_steps_back() {
    let folder = tempfile::tempdir().unwrap();
    let a = pcap(folder.path(), "a", 2368, &[10, 5, 11]);
    let (epoch, events) = merged(&[a]);
    assert_eq!(epoch, Some(UnixNs(5_000_000_000)));
    let arrived: Vec<i64> = events.iter().map(|event| event.1).collect();
    assert_eq!(arrived, [5, 0, 6], "file order is kept, no time is negative");
}

#[test]
fn captures_and_merged_inputs_can_move_to_another_thread() {
    fn assert_send<T: Send>() {}
    assert_send::<Capture>();
    assert_send::<super::super::Merged>();
}

#[test]
fn nothing_has_no_epoch_and_no_events() {
    let folder = tempfile::tempdir().unwrap();
    let empty = pcap(folder.path(), "a", 2368, &[]);
    assert_eq!(merged(&[empty]), (None, vec![]));
    assert_eq!(merge(vec![]).unwrap().epoch(), None);
}

#[test]
fn frames_without_times_are_not_mixed_with_packets_that_have_them() {
    let folder = tempfile::tempdir().unwrap();
    let packets = pcap(folder.path(), "a", 2368, &[10]);
    let frame = folder.path().join("frame.png");
    let image = super::super::depth_png::tests::ramp(640, 480, png::BitDepth::Sixteen, png::ColorType::Grayscale, 0);
    fs::write(&frame, image).unwrap();
    let captures = vec![open_default(&packets).unwrap(), open_default(&frame).unwrap()];
    let message = merge(captures).err().unwrap().to_string();
    assert!(message.contains("frame.png has no times of its own"), "{message}");
    let alone = merge(vec![open_default(&frame).unwrap()]).unwrap();
    assert_eq!(alone.epoch(), Some(UnixNs(0)));
    assert_eq!(alone.map(|event| event.unwrap().arrived).collect::<Vec<_>>(), [RigNs(0)]);
}

#[test]
fn summaries_are_complete_after_the_last_event() {
    let folder = tempfile::tempdir().unwrap();
    let path = pcap(folder.path(), "a", 2368, &[10, 11]);
    let mut events = merge(vec![open_default(&path).unwrap()]).unwrap();
    assert_eq!(events.by_ref().count(), 2);
    let packets: Vec<u64> = events.summaries().map(|s| s.sensors[&SensorId::from("front")].data_packets).collect();
    assert_eq!(packets, [2]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 4, ..ProptestConfig::default() })]
    #[test]
    fn file_order_is_kept_and_sorted_inputs_come_out_sorted(
        a in prop::collection::vec(0u32..50, 0..12), mut b in prop::collection::vec(0u32..50, 0..12), sort in any::<bool>(),
    ) {
        let mut a = a;
        if sort {
            a.sort_unstable();
            b.sort_unstable();
        }
        let folder = tempfile::tempdir().unwrap();
        let paths = [pcap(folder.path(), "a", 2368, &a), pcap(folder.path(), "b", 2369, &b)];
        let (epoch, events) = merged(&paths);
        let first = a.iter().chain(&b).min().copied();
        prop_assert_eq!(epoch.map(|epoch| epoch.0 / 1_000_000_000), first.map(i64::from));
        prop_assert!(events.iter().enumerate().all(|(n, event)| event.0 == n as u64));
        for (sensor, seconds) in [("front", &a), ("rear", &b)] {
            let own: Vec<(i64, u8)> = events.iter().filter(|e| e.2 == sensor).map(|e| (e.1, e.3)).collect();
            let expected: Vec<(i64, u8)> = seconds.iter().zip(0..)
                .map(|(second, n)| (i64::from(second - first.unwrap_or(0)), n)).collect();
            prop_assert_eq!(own, expected);
        }
        if sort {
            prop_assert!(events.is_sorted_by_key(|event| event.1));
        }
        prop_assert_eq!(merged(&paths).1, events, "the same inputs give the same ledger");
    }
}
