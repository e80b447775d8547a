//! The real captures, when they are beside the repository.

use super::super::{StampOrigin, merge};
use super::*;
use std::path::PathBuf;
use tumbled_model::DepthEncoding;

fn data(name: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(name);
    if !path.exists() {
        println!("skipped: ../shared/data/{name} is not there");
        return None;
    }
    Some(path)
}

#[test]
fn velodyne_captures_hold_the_packets_their_table_says() {
    for (name, data_packets, position_packets) in [
        ("vlp32c_strongest_600rpm_fov180_a", 228, 0),
        ("vlp16_strongest_600rpm", 160, 30),
        ("vlp16_dual_600rpm_a", 151, 0),
        ("vlp16_strongest_gps_600rpm", 150, 30),
        ("hdl32e_strongest_gps_700rpm", 170, 20),
        ("hdl64e_s1_600rpm_a", 153, 0),
    ] {
        let Some(path) = data(&format!("velodyne/{name}.pcap")) else { continue };
        let (records, summary) = read_all(&path);
        let front = summary.sensors[&SensorId::from("front")];
        assert_eq!(
            (front.data_packets, front.position_packets, front.lost),
            (data_packets, position_packets, 0),
            "{name}"
        );
        assert!(!summary.data_lost(), "{name}: {summary:?}");
        assert_eq!(records.len() as u64, data_packets + position_packets);
        let lengths_fit = records.iter().all(|record| match &record.body {
            Body::LidarPacket { bytes, .. } => bytes.len() == 1206 || bytes.len() == 512,
            _ => false,
        });
        assert!(lengths_fit, "{name}");
    }
}

#[test]
fn two_real_captures_merge_into_one_ledger_with_time_zero_at_the_earlier() {
    let (Some(a), Some(b)) =
        (data("velodyne/vlp16_strongest_600rpm.pcap"), data("velodyne/hdl32e_strongest_gps_700rpm.pcap"))
    else {
        return;
    };
    let captures = vec![open_default(&a).unwrap(), open_default(&b).unwrap()];
    let merged = merge(captures).unwrap();
    assert!(merged.epoch().is_some());
    let arrived: Vec<i64> = merged.map(|event| event.unwrap().arrived.0).collect();
    assert_eq!(arrived.len(), 190 + 190);
    assert_eq!(arrived.iter().min(), Some(&0));
}

#[test]
fn kinect_frames_are_the_files_samples() {
    let Some(folder) = data("kinect/seq7") else { return };
    let (records, summary) = read_all(&folder);
    assert_eq!(records.len(), 60);
    assert_eq!(summary.stamp_origin, StampOrigin::Synthetic);
    assert_eq!(depth(&records[59]).0, 59 * 33_333_333);
    assert!(records.iter().all(|record| depth(record).1 == DepthEncoding::Mm16));
    let Some(folder) = data("kinect/seq7_raw11") else { return };
    let (records, _) = read_all(&folder);
    assert_eq!(records.len(), 10);
    let in_range = |record: &CaptureRecord| {
        let Body::DepthFrame { bytes, encoding: DepthEncoding::Raw11, .. } = &record.body else { return false };
        // README: disparities 658..=1002, 2047 where there is none.
        bytes.chunks_exact(2).map(|s| u16::from_le_bytes([s[0], s[1]])).all(|d| d == 2047 || (658..=1002).contains(&d))
    };
    assert!(records.iter().all(in_range));
}

#[test]
fn the_real_dump_frame_and_its_png_hold_the_same_disparities() {
    let (Some(pgm), Some(png)) = (data("kinect/raw11/nyu_raw11_le.pgm"), data("kinect/raw11/nyu_raw11.png")) else {
        return;
    };
    let (dump, image) = (read_all(&pgm).0, read_all(&png).0);
    assert_eq!(depth(&dump[0]).1, DepthEncoding::Raw11);
    assert!(dump == image, "same stamp, encoding and bytes");
}
