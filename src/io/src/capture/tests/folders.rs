//! fakenect dumps and depth PNGs.

use super::super::depth_png::tests::ramp;
use super::super::{CaptureKind, KinectRoute, StampOrigin};
use super::*;
use png::{BitDepth, ColorType};
use std::fs;
use tumbled_model::DepthEncoding;

/// A dump file whose samples are all `sample`.
fn dump_frame(sample: u16) -> Vec<u8> {
    let mut file = b"P5 640 480 65535\n".to_vec();
    file.extend(sample.to_le_bytes().repeat(640 * 480));
    file
}

fn depth_png(first: u16) -> Vec<u8> {
    ramp(640, 480, BitDepth::Sixteen, ColorType::Grayscale, first)
}

#[test]
fn fakenect_frames_come_in_index_order_with_host_time_and_ticks() {
    let folder = tempfile::tempdir().unwrap();
    let names = [
        "d-1332333.250000-60000.pgm",
        "r-1332333.260000-60100.ppm",
        "a-1332333.261000-0.dump",
        "d-1332333.283333-2060000.pgm",
    ];
    fs::write(folder.path().join("INDEX.txt"), names.join("\n") + "\n").unwrap();
    fs::write(folder.path().join(names[0]), dump_frame(839)).unwrap();
    fs::write(folder.path().join(names[3]), dump_frame(1040)).unwrap();
    let (records, summary) = read_all(folder.path());
    let frames: Vec<_> = records.iter().map(depth).collect();
    let (first, second) = (1_332_333_250_000_000, 1_332_333_283_333_000);
    let raw = DepthEncoding::Raw11;
    assert_eq!(frames, [(first, raw, Some(60_000), 839), (second, raw, Some(2_060_000), 1040)]);
    assert_eq!((summary.kind, summary.stamp_origin), (CaptureKind::Fakenect, StampOrigin::Capture));
    assert_eq!((summary.ignored_files, summary.damaged_frames), (2, 0));
}

#[test]
fn a_dump_copied_in_part_has_gaps_where_frames_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("INDEX.txt"), "d-1.0-1.pgm\r\nd-2.0-2.pgm\r\n\r\nd-3.0-3.pgm").unwrap();
    fs::write(folder.path().join("d-2.0-2.pgm"), dump_frame(900)).unwrap();
    fs::write(folder.path().join("d-3.0-3.pgm"), &dump_frame(901)[..100_000]).unwrap();
    let (records, summary) = read_all(folder.path());
    assert_eq!(records[0], lost(1_000_000_000, "near"));
    assert_eq!(depth(&records[1]).3, 900);
    assert_eq!(records[2], lost(3_000_000_000, "near"));
    assert_eq!(summary.damaged_frames, 2);
    assert!(summary.damaged_files[0].path.ends_with("d-1.0-1.pgm"));
    assert!(summary.damaged_files[1].detail.starts_with("99983 bytes"), "100 000 less the 17 of the header line");
    assert!(summary.data_lost());
}

#[test]
fn index_lines_that_are_no_names_are_pointed_at() {
    let folder = tempfile::tempdir().unwrap();
    for line in ["d-1.0.pgm", "../d-1.0-1.pgm", "d-1.0-1.pgm/../../etc/passwd"] {
        fs::write(folder.path().join("INDEX.txt"), format!("d-1.0-1.pgm\n\n{line}\n")).unwrap();
        let message = open_default(folder.path()).err().unwrap().to_string();
        assert!(message.contains("INDEX.txt, line 3") && message.contains(line), "{message}");
    }
}

#[test]
fn a_single_pgm_is_a_frame_whose_name_may_tell_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let (named, bare, standard) =
        (folder.path().join("d-5.5-7.pgm"), folder.path().join("x.pgm"), folder.path().join("s.pgm"));
    fs::write(&named, dump_frame(839)).unwrap();
    fs::write(&bare, dump_frame(839)).unwrap();
    fs::write(&standard, dump_frame(839u16.swap_bytes())).unwrap();
    let (records, summary) = read_all(&named);
    assert_eq!(depth(&records[0]), (5_500_000_000, DepthEncoding::Raw11, Some(7), 839));
    assert_eq!(summary.stamp_origin, StampOrigin::Capture);
    let (records, summary) = read_all(&bare);
    assert_eq!(depth(&records[0]), (0, DepthEncoding::Raw11, None, 839));
    assert_eq!(summary.stamp_origin, StampOrigin::Synthetic);
    assert!(open_default(&standard).err().unwrap().to_string().contains("big-endian samples"));
}

#[test]
fn pngs_without_times_are_a_thirtieth_apart_and_say_that_it_is_synthetic() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("f10.png"), depth_png(30)).unwrap();
    fs::write(folder.path().join("f2.png"), depth_png(20)).unwrap();
    fs::write(folder.path().join("f1.raw11.png"), depth_png(10)).unwrap();
    fs::write(folder.path().join("f1.pose.txt"), "1 0 0 0").unwrap();
    let (records, summary) = read_all(folder.path());
    let frames: Vec<_> = records.iter().map(depth).collect();
    let expected = [
        (0, DepthEncoding::Raw11, None, 10),
        (33_333_333, DepthEncoding::Mm16, None, 20),
        (66_666_666, DepthEncoding::Mm16, None, 30),
    ];
    assert_eq!(frames, expected);
    assert_eq!((summary.kind, summary.stamp_origin), (CaptureKind::DepthPngs, StampOrigin::Synthetic));
}

#[test]
fn times_txt_gives_each_png_its_second() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.png"), depth_png(1)).unwrap();
    fs::write(folder.path().join("b.png"), depth_png(2)).unwrap();
    let times = folder.path().join("times.txt");
    fs::write(&times, "1332333.25\n1332333.283333333\n").unwrap();
    let (records, summary) = read_all(folder.path());
    let hosts: Vec<i64> = records.iter().map(|record| record.host.0).collect();
    assert_eq!(hosts, [1_332_333_250_000_000, 1_332_333_283_333_333]);
    assert_eq!(summary.stamp_origin, StampOrigin::TimesFile);
    fs::write(&times, "1332333.25\n").unwrap();
    let message = open_default(folder.path()).err().unwrap().to_string();
    assert!(message.contains("1 lines for 2 frames"), "{message}");
    fs::write(&times, "1332333.25\nsoon\n").unwrap();
    let message = open_default(folder.path()).err().unwrap().to_string();
    assert!(message.contains("times.txt, line 2: `soon`"), "{message}");
}

#[test]
fn pngs_that_are_no_depth_frames_are_refused_by_name_before_anything_is_read() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.png"), depth_png(1)).unwrap();
    let b = folder.path().join("b.png");
    for (content, found) in [
        (ramp(640, 480, BitDepth::Eight, ColorType::Rgb, 0), "640x480, 8-bit RGB"),
        (ramp(640, 480, BitDepth::Eight, ColorType::Grayscale, 0), "640x480, 8-bit greyscale"),
        (ramp(320, 240, BitDepth::Sixteen, ColorType::Grayscale, 0), "320x240, 16-bit greyscale"),
        (b"no png at all, but long enough".to_vec(), "has no PNG header"),
        (vec![], "has no PNG header"),
    ] {
        fs::write(&b, content).unwrap();
        let message = open_default(folder.path()).err().unwrap().to_string();
        assert!(message.contains("b.png") && message.contains(found), "{message}");
    }
}

#[test]
fn a_png_broken_off_is_a_gap_and_the_others_are_delivered() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("1.png"), &depth_png(1)[..1000]).unwrap();
    fs::write(folder.path().join("2.png"), depth_png(2)).unwrap();
    let (records, summary) = read_all(folder.path());
    assert_eq!(records[0], lost(0, "near"));
    assert_eq!(depth(&records[1]).3, 2);
    assert_eq!(summary.damaged_frames, 1);
}

#[test]
fn a_single_png_belongs_to_the_kinect_of_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("far.png");
    fs::write(&path, depth_png(1)).unwrap();
    let mut routing = Routing::default();
    routing.kinects.push(KinectRoute { id: SensorId::from("far"), topic: None });
    let (records, _) = read_routed(&path, &routing);
    assert_eq!(records[0].body.sensor(), Some(&SensorId::from("far")));
    routing.kinects.clear();
    assert!(matches!(open(&path, &routing), Err(CaptureError::NoKinect { .. })));
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("INDEX.txt");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if !made.is_ok_and(|status| status.success()) {
        println!("skipped: mkfifo is not there");
        return;
    }
    assert!(matches!(open_default(folder.path()), Err(CaptureError::NotAFile { .. })));
    assert!(matches!(open_default(&pipe), Err(CaptureError::NotAFile { .. })));
}
