//! `tumbled export`: files as other programs read them, and what is refused.

use std::fs;
use std::path::Path;

use tumbled_kinect::{RawDisparity, RawImage, ZeroPlane, encode_raw};
use tumbled_model::DepthEncoding;
use tumbled_velodyne::{Model, ReturnMode};

use crate::support::pcap::{Datagram, write_pcap};
use crate::support::real::real;
use crate::support::{Done, Workbench};
use crate::synth::Sensor;

/// Bytes of a record of the pts format.
pub(crate) const PTS_RECORD: usize = 24;
/// Where in it the time (i32) and the flags (u16) stand.
const PTS_TIME: std::ops::Range<usize> = 12..16;
const PTS_FLAGS: std::ops::Range<usize> = 22..24;
/// x, y, z, intensity, ring, return, laser, column, packet, stamp, time, range, azimuth, flags:
/// 3 × 4 + 5 × 1 + 3 × 4 + 2 × 4 + 2 bytes.
const LIDAR_ROW: usize = 39;
/// x, y, z, sigma, u, v: 4 × 4 + 2 × 2 bytes.
const KINECT_ROW: usize = 20;

/// A bench with `drive.pcap`: a VLP-16 at 600 rpm for `n` packets of 4.78°, in each 384 points at 2 m.
pub(crate) fn drive(n: usize) -> (Workbench, usize) {
    let packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(n, |_, _| (1_000, 1_000));
    let bench = Workbench::new();
    bench.file("drive.pcap", write_pcap(&datagrams(&packets)));
    (bench, n * 384)
}

pub(crate) fn datagrams(packets: &[crate::synth::Packet]) -> Vec<Datagram> {
    let one = |packet: &crate::synth::Packet| Datagram {
        t_ns: packet.group_t_ns.last().expect("firings") + 80_000,
        port: 2368,
        payload: packet.bytes.to_vec(),
    };
    packets.iter().map(one).collect()
}

/// A bench with the fakenect folder `dump` of so many frames, all of one wall at 2 m.
pub(crate) fn dump(n: u32) -> Workbench {
    let bench = Workbench::new();
    let RawDisparity(code) = ZeroPlane::default().code_at(2.0).expect("in range");
    let mut index = String::new();
    for k in 0..n {
        let name = format!("d-1000.{:06}-{}.pgm", k * 33_333, k * 2_000_000);
        // One code more each frame, so that none repeats another.
        let image = RawImage::filled(RawDisparity(code + k as u16));
        let payload = encode_raw(&image, DepthEncoding::Raw11).expect("eleven bits");
        bench.file(&format!("dump/{name}"), [b"P5 640 480 65535\n".as_slice(), &payload].concat());
        index.push_str(&format!("{name}\n"));
    }
    bench.file("dump/INDEX.txt", index);
    bench
}

pub(crate) fn export(bench: &Workbench, input: &str, what: &str, format: &str, output: &str, more: &[&str]) -> Done {
    bench.run(&[&["export", input, "--what", what, "--format", format, "-o", output], more].concat())
}

pub(crate) fn fine(done: &Done) {
    assert_eq!(done.code, 0, "{}", done.stderr);
}

/// Refused as bad usage or input: nothing on stdout, no file, the reason named.
pub(crate) fn refused(bench: &Workbench, done: &Done, output: &str, reason: &str) {
    assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{}", done.stderr);
    assert!(done.stderr.contains(reason), "{}", done.stderr);
    assert!(!bench.path(output).exists(), "{output} is there");
    assert_eq!(partials(bench), 0, "a .partial file stayed");
}

pub(crate) fn partials(bench: &Workbench) -> usize {
    let entries = fs::read_dir(bench.path(".")).expect("the bench");
    let names = entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned());
    names.filter(|name| name.ends_with(".partial")).count()
}

/// The text header of a PLY or PCD file and its binary body.
fn split<'a>(bytes: &'a [u8], header_end: &str) -> (&'a str, &'a [u8]) {
    let end = bytes.windows(header_end.len()).position(|window| window == header_end.as_bytes()).expect("a header");
    let (header, body) = bytes.split_at(end + header_end.len());
    (std::str::from_utf8(header).expect("text"), body)
}

fn header_number(header: &str, key: &str) -> usize {
    let line = header.lines().find_map(|line| line.strip_prefix(key)).expect("the key");
    line.trim().parse().expect("a number")
}

#[test]
fn every_lidar_format_holds_every_point() {
    let (bench, points) = drive(5);
    let bytes = |format: &str| {
        let name = format!("cloud.{format}");
        fine(&export(&bench, "drive.pcap", "lidar-points", format, &name, &[]));
        fs::read(bench.path(&name)).expect("the file")
    };
    assert_eq!(bytes("pts").len(), points * PTS_RECORD);

    let ply = bytes("ply");
    let (header, body) = split(&ply, "end_header\n");
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
    assert_eq!((header_number(header, "element vertex "), body.len()), (points, points * LIDAR_ROW));

    let pcd = bytes("pcd");
    let (header, body) = split(&pcd, "DATA binary\n");
    let counts = (header_number(header, "WIDTH "), header_number(header, "POINTS "));
    assert_eq!((counts, body.len()), ((points, points), points * LIDAR_ROW));
    let sizes = header.lines().find_map(|line| line.strip_prefix("SIZE ")).expect("sizes");
    assert_eq!(sizes.split(' ').map(|size| size.parse::<usize>().expect("a number")).sum::<usize>(), LIDAR_ROW);

    let csv = String::from_utf8(bytes("csv")).expect("text");
    let columns = csv.lines().next().expect("a heading").split(',').count();
    assert_eq!(csv.lines().count(), 1 + points);
    assert!(csv.lines().all(|line| line.split(',').count() == columns));
    // The same point in each: x of the first.
    let x = |bytes: &[u8]| f32::from_le_bytes(bytes[..4].try_into().expect("four bytes"));
    let first: f32 = csv.lines().nth(1).and_then(|row| row.split(',').next()).expect("x").parse().expect("a number");
    assert_eq!((x(split(&ply, "end_header\n").1), x(body), x(&bytes("pts"))), (first, first, first));
}

#[test]
fn frames_of_a_lidar_are_turns_of_its_head() {
    // 4.7776° a packet: turn 0 has packets 0 to 75, since 75 × 4.7776° = 358.3° and 76 × 4.7776° = 363.1°.
    let (bench, _) = drive(200);
    let packets = |frames: &str| {
        let done = export(&bench, "drive.pcap", "lidar-points", "pts", "turn.pts", &["--frames", frames, "--json"]);
        fine(&done);
        let report: serde_json::Value = serde_json::from_str(&done.stdout).expect("JSON");
        report["records"].as_u64().expect("a number")
    };
    // 150 × 4.7776° = 716.6° and 151 × 4.7776° = 721.4°: turn 1 ends with packet 150.
    assert_eq!([packets("0..1"), packets("1"), packets("2.."), packets("..")], [76, 75, 49, 200]);
    let done = export(&bench, "drive.pcap", "lidar-points", "pts", "none.pts", &["--frames", "3..9"]);
    refused(&bench, &done, "none.pts", "3 turns");
}

#[test]
fn one_of_several_sensors_has_to_be_named() {
    let (bench, points) = drive(3);
    bench.file("rig.toml", "[[lidar]]\nid = 'a'\n[[lidar]]\nid = 'b'\nport = 2369\nposition_port = 8309\n");
    let run = |more: &[&str]| {
        let more = [&["--config", "rig.toml"], more].concat();
        export(&bench, "drive.pcap", "lidar-points", "pts", "cloud.pts", &more)
    };
    refused(&bench, &run(&[]), "cloud.pts", "several LiDARs: a, b");
    refused(&bench, &run(&["--sensor", "c"]), "cloud.pts", "no LiDAR `c`");
    refused(&bench, &run(&["--sensor", "b"]), "cloud.pts", "no LiDAR packets");
    fine(&run(&["--sensor", "a"]));
    assert_eq!(fs::metadata(bench.path("cloud.pts")).expect("the file").len() as usize, points * PTS_RECORD);
}

#[test]
fn combinations_that_make_no_sense_are_refused_with_those_that_do() {
    let (bench, _) = drive(3);
    let refuse = |what: &str, format: &str, remedy: &str| {
        refused(&bench, &export(&bench, "drive.pcap", what, format, "out", &[]), "out", remedy);
    };
    refuse("lidar-points", "png", "pts, csv, ply or pcd");
    refuse("kinect-points", "pts", "csv, ply or pcd");
    refuse("kinect-depth", "ply", "png or csv");
    refuse("kinect-depth", "png", "no depth frames");
    refuse("state", "ply", "tum or csv");
    refuse("model", "png", "csv, ply or pcd");
    refuse("fused", "tum", "csv, ply or pcd");
    refuse("model", "ply", "no frame of the session shows a tracked target");
}

#[test]
fn a_product_that_is_not_supported_is_named() {
    let mut packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(3, |_, _| (1_000, 1_000));
    for packet in &mut packets {
        packet.bytes[1205] = 0xA1; // VLS-128
    }
    let bench = Workbench::new();
    bench.file("drive.pcap", write_pcap(&datagrams(&packets)));
    let done = export(&bench, "drive.pcap", "lidar-points", "ply", "cloud.ply", &[]);
    refused(&bench, &done, "cloud.ply", "VLS-128 packets are not supported");
}

#[test]
fn a_broken_capture_gives_what_it_has_and_exit_code_3() {
    let (bench, points) = drive(5);
    let whole = fs::read(bench.path("drive.pcap")).expect("the capture");
    bench.file("drive.pcap", &whole[..whole.len() - 1]);
    let done = export(&bench, "drive.pcap", "lidar-points", "pts", "cloud.pts", &[]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    let written = fs::metadata(bench.path("cloud.pts")).expect("the file").len() as usize;
    assert_eq!(written, (points - 384) * PTS_RECORD);
    assert!(done.stderr.contains("readable only up to byte"), "{}", done.stderr);
}

#[test]
fn one_depth_frame_takes_the_name_and_several_take_the_folder() {
    let bench = dump(3);
    fine(&export(&bench, "dump", "kinect-depth", "png", "one.png", &["--frames", "1"]));
    fine(&export(&bench, "dump", "kinect-depth", "png", "all", &[]));
    for k in 0..3 {
        assert!(bench.path(&format!("all/frame-{k:06}.png")).is_file(), "frame {k}");
    }
    assert!(!bench.path("times.txt").exists(), "one frame has no list of times");
    assert!(bench.read_bytes("one.png") == bench.read_bytes("all/frame-000001.png"));
    // What was written is read again, as millimetres.
    let done = bench.run(&["info", "all", "--json"]);
    let report: tumbled::cli::info::report::InfoReport = done.json();
    assert_eq!((done.code, report.kinects[0].frames), (0, 3));
    // Codes are z² × 2.894e-6 /mm = 11.6 mm apart at 2 m: the first wall is half of it off at most, the third is two
    // codes behind it. Each is rounded to a millimetre.
    let depth = report.kinects[0].depth_m.expect("depths");
    assert!((depth.min - 2.0).abs() < 0.007 && (depth.max - depth.min - 0.0233).abs() < 0.0015, "{depth:?}");
}

#[test]
fn several_frames_into_one_file_are_refused_and_leave_nothing() {
    let bench = dump(2);
    let done = export(&bench, "dump", "kinect-points", "ply", "cloud.ply", &[]);
    refused(&bench, &done, "cloud.ply", "--frames 0..1");
    // Nor is a file that was there touched.
    bench.file("cloud.ply", "mine");
    assert_eq!(export(&bench, "dump", "kinect-points", "ply", "cloud.ply", &[]).code, 2);
    assert_eq!((bench.read("cloud.ply").as_str(), partials(&bench)), ("mine", 0));
    let done = export(&bench, "dump", "kinect-depth", "png", "none.png", &["--frames", "5.."]);
    refused(&bench, &done, "none.png", "2 frames, none in --frames");
}

#[test]
fn kinect_points_are_rows_of_their_format() {
    let bench = dump(1);
    let columns_with_data = 640; // the made frame has a wall in every pixel
    let points = columns_with_data * 480;
    fine(&export(&bench, "dump", "kinect-points", "ply", "cloud.ply", &[]));
    let ply = bench.read_bytes("cloud.ply");
    let (header, body) = split(&ply, "end_header\n");
    assert_eq!((header_number(header, "element vertex "), body.len()), (points, points * KINECT_ROW));
    fine(&export(&bench, "dump", "kinect-depth", "csv", "depth.csv", &[]));
    let csv = bench.read("depth.csv");
    assert_eq!(csv.lines().count(), 480);
    assert!(csv.lines().all(|line| line.split(',').count() == 640));
}

#[test]
fn an_output_that_cannot_be_written_is_exit_code_1() {
    let (bench, _) = drive(3);
    bench.file("taken", "a file where a folder should be");
    let done = export(&bench, "drive.pcap", "lidar-points", "pts", "taken/cloud.pts", &[]);
    assert_eq!(done.code, 1, "{}", done.stderr);
    assert!(done.stderr.contains("cannot write"), "{}", done.stderr);
}

/// The packet's jump flag decides which reference time holds: with it the nominal one, which is not the true one.
fn same_but_for_times_in_jump_packets(ours: &Path, reference: &Path) {
    let (ours, reference) = (fs::read(ours).expect("ours"), fs::read(reference).expect("the reference"));
    assert_eq!(ours.len(), reference.len());
    let mut flagged = 0;
    for (k, (a, b)) in ours.chunks(PTS_RECORD).zip(reference.chunks(PTS_RECORD)).enumerate() {
        let jump = a[PTS_FLAGS] == [1, 0];
        flagged += u64::from(jump);
        let same_time = a[PTS_TIME] == b[PTS_TIME];
        assert!(a[..PTS_TIME.start] == b[..PTS_TIME.start] && a[PTS_TIME.end..] == b[PTS_TIME.end..], "record {k}");
        assert!(same_time || jump, "record {k}: another time in a packet without a jump");
    }
    assert!(flagged > 0, "the capture has packets with a jump");
}

#[test]
fn real_vlp32c_points_are_those_of_the_reference() {
    let Some(capture) = real("velodyne/vlp32c_strongest_600rpm_fov180_a.pcap") else { return };
    let Some(reference) = real("velodyne/vlp32c_strongest_600rpm_fov180_a.ref.pts") else { return };
    let bench = Workbench::new();
    let capture = capture.to_str().expect("UTF-8");
    fine(&export(&bench, capture, "lidar-points", "pts", "cloud.pts", &["--set", "lidar.vertical_offsets=off"]));
    same_but_for_times_in_jump_packets(&bench.path("cloud.pts"), &reference);
}

#[test]
fn real_depth_frames_keep_their_millimetres() {
    let Some(folder) = real("kinect/seq7") else { return };
    let bench = Workbench::new();
    let folder = folder.to_str().expect("UTF-8");
    fine(&export(&bench, folder, "kinect-depth", "csv", "first.csv", &["--frames", "0"]));
    let valid = bench.read("first.csv").lines().flat_map(|l| l.split(',')).filter(|mm| *mm != "0").count();
    // 7.6 to 11.5 % of the pixels are invalid in every frame.
    assert!((271_872..=283_853).contains(&valid), "{valid}");
}

#[test]
fn a_calibration_that_is_a_folder_is_said_to_be_one() {
    let (bench, _) = drive(3);
    fs::create_dir(bench.path("db")).expect("a folder");
    for settings in
        [&["--set", "lidar.calibration=db"][..], &["--set", "lidar.calibration=db", "--set", "lidar.model=hdl-64e"]]
    {
        let done = export(&bench, "drive.pcap", "lidar-points", "pts", "cloud.pts", settings);
        refused(&bench, &done, "cloud.pts", "db is a folder");
    }
}
