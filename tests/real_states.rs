//! What the estimation says of real sensors: a still scene seen by a camera in somebody's hand, still things seen by LiDARs.
//! The captures lie beside the repository where people have them.

use std::fs;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion};
use tumbled::stream::StateLine;
use tumbled_core::estimate::Mode;
use tumbled_core::register::baseline::{IterationOptions, gicp};
use tumbled_core::register::{Cloud, Prior, SensorKind, View};
use tumbled_io::capture::{self, Routing};
use tumbled_kinect::{BackProjector, DepthImage, DepthTable, Intrinsics, NoiseModel, Points, ZeroPlane, decode_metres};
use tumbled_model::{Body, Event};

use crate::support::Workbench;
use crate::support::pcap::{Datagram, write_pcap};
use crate::support::real::{HAND_HELD, datagrams, real};
use crate::support::states::{apart, pose, replayed};

fn states(bench: &Workbench, arguments: &[&str]) -> Vec<StateLine> {
    replayed(bench, arguments, &[0, 3])
}

/// A camera's pose in the world, by the sequence's own tracking. Its rotations are rotations to 4e-4.
fn camera(folder: &Path, frame: usize) -> Isometry3<f64> {
    let text = fs::read_to_string(folder.join(format!("frame-{frame:06}.pose.txt"))).expect("a pose");
    let n: Vec<f64> = text.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    let rotation = Rotation3::from_matrix(&Matrix3::new(n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10]));
    Isometry3::from_parts(Translation3::new(n[3], n[7], n[11]), UnitQuaternion::from_rotation_matrix(&rotation))
}

/// Each sixth pixel of each sixth row of every frame as points: some 7 000, as many as a chain has to have time for.
fn frames(folder: &Path) -> Vec<Cloud> {
    let intrinsics = Intrinsics { fx: 585.0, fy: 585.0, cx: 320.0, cy: 240.0, ..Intrinsics::default() };
    let projector = BackProjector::new(&intrinsics, &NoiseModel::default()).expect("a camera");
    let table = DepthTable::from_law(&ZeroPlane::default());
    let (mut depth, mut points) = (DepthImage::new(), Points::new());
    let merged = capture::merge(capture::open_all(&[folder], &Routing::default()).expect("opens")).expect("merges");
    let mut cloud = |event: Event| {
        let Body::DepthFrame { encoding, lost_packets, bytes, .. } = event.body else { return None };
        decode_metres(encoding, &bytes, &lost_packets, &table, &mut depth).expect("a frame");
        projector.points(&depth, &mut points);
        let is_taken = |pixel: u32| (pixel % 640).is_multiple_of(6) && (pixel / 640).is_multiple_of(6);
        let taken = (0..points.len()).filter(|&n| is_taken(points.pixel()[n]));
        let points = taken.map(|n| Point3::new(points.x()[n], points.y()[n], points.z()[n])).collect();
        Some(Cloud { sensor: SensorKind::Kinect, points, viewpoint: Some(Point3::origin()), view: View::Bare })
    };
    merged.filter_map(|event| cloud(event.expect("reads"))).collect()
}

/// The motion from a frame to the last by registering each to the one before it.
fn chain(clouds: &[Cloud], from: usize) -> Isometry3<f64> {
    let t_reference_moving = Isometry3::identity();
    let still = Prior { t_reference_moving, sigma_rotation_rad: 0.05, sigma_translation_m: 0.05 };
    clouds.windows(2).skip(from).fold(Isometry3::identity(), |motion, pair| {
        let step = gicp(&pair[0], &pair[1], Some(&still), &IterationOptions::points()).expect("two clouds");
        step.t_reference_moving * motion
    })
}

#[test]
fn a_scene_that_a_camera_in_a_hand_goes_round_is_tracked_better_than_by_a_chain() {
    let Some(folder) = real("kinect/seq7") else { return };
    let bench = Workbench::new();
    bench.file("rig.toml", HAND_HELD);
    let imported = bench.run(&["import", folder.to_str().expect("a path"), "-o", "in.mcap", "--config", "rig.toml"]);
    assert_eq!(imported.code, 0, "{}", imported.stderr);
    let all = states(&bench, &["in.mcap", "--config", "rig.toml"]);
    assert_eq!(all.len(), 60);
    let first = all.iter().position(|state| state.mode == Mode::Tracking).expect("it is tracked");
    // 0.7 s of 30 frames a second make a motion.
    assert!(first <= 23, "tracked from frame {first} on");
    assert_eq!(all[59].mode, Mode::Tracking);
    let truth = camera(&folder, 59).inverse() * camera(&folder, first);
    let at = |frame: usize| pose(&all[frame]).expect("a pose");
    let (degrees, mm) = apart(&(at(59) * at(first).inverse()), &truth);
    let (chain_degrees, chain_mm) = apart(&chain(&frames(&folder), first), &truth);
    println!("{degrees:.2} degrees, {mm:.1} mm; a chain of GICP: {chain_degrees:.2} degrees, {chain_mm:.1} mm");
    assert!(degrees <= 1.0 && mm <= 25.0, "{degrees} degrees, {mm} mm");
    assert!(degrees < chain_degrees && mm < chain_mm, "a chain: {chain_degrees} degrees, {chain_mm} mm");
}

/// A still thing in a capture: the file, turns that are repeated, where it stands, how far a region reaches round it.
type Still = (&'static str, usize, [f64; 3], f64);

/// A board of 0.9 m × 1.1 m at 3.7 m; a low box of 0.9 m at 1.8 m; a corner of 1.6 m at 1.3 m.
const STILL: [Still; 3] = [
    ("velodyne/vlp32c_strongest_600rpm_fov180_a.pcap", 2, [3.3, -1.61, 0.49], 0.8),
    ("velodyne/vlp32c_strongest_600rpm_fov180_a.pcap", 2, [0.29, -1.73, 0.16], 0.6),
    ("velodyne/vlp16_strongest_gps_600rpm.pcap", 1, [0.57, 1.05, 0.33], 0.8),
];

/// The whole turns at a capture's beginning again and again, stamps and host times going on: as if it had gone on for 3 s.
fn repeated(capture: &Path, turns: i64) -> Vec<Datagram> {
    let any = std::net::SocketAddr::from(([127, 0, 0, 1], 2368));
    let elsewhere = std::net::SocketAddr::from(([127, 0, 0, 1], 8308));
    let packets: Vec<_> = datagrams(capture, any, elsewhere).into_iter().filter(|(_, to, _)| *to == any).collect();
    let azimuth = |n: usize| i64::from(u16::from_le_bytes([packets[n].2[2], packets[n].2[3]]));
    let stamp = |n: usize| i64::from(u32::from_le_bytes(packets[n].2[1200..1204].try_into().expect("four bytes")));
    // How far the head has turned from the first packet to each, 0.01 degrees.
    let mut turned = vec![0];
    for n in 1..packets.len() {
        turned.push(turned[n - 1] + (azimuth(n) - azimuth(n - 1)).rem_euclid(36_000));
    }
    let last = packets.len() - 1;
    // A packet begins 1.2 to 5 degrees behind the one before: the first is left out, so that the head never turns back.
    let end = turned.iter().position(|way| *way >= 36_000 * turns).expect("so many turns");
    let lasts_us = (stamp(last) - stamp(0)) * 36_000 * turns / turned[last];
    let again = |round: i64| {
        packets[1..end].iter().enumerate().map(move |(n, (at, _, bytes))| {
            let mut payload = bytes.to_vec();
            let later = (stamp(n + 1) + round * lasts_us).rem_euclid(3_600_000_000) as u32;
            payload[1200..1204].copy_from_slice(&later.to_le_bytes());
            Datagram { t_ns: at.0 + round * lasts_us * 1_000, port: 2368, payload }
        })
    };
    (0..30 / turns).flat_map(again).collect()
}

fn region(at: [f64; 3], radius: f64) -> [String; 2] {
    [format!("target.roi_center_m={at:?}"), format!("target.roi_radius_m={radius}")]
}

#[test]
fn still_things_in_real_lidar_captures_do_not_spin() {
    for (name, turns, at, radius) in STILL {
        let Some(capture) = real(name) else { return };
        let bench = Workbench::new();
        let [center, radius] = region(at, radius);
        let set = ["--set", "kinect=[]", "--set", &center, "--set", &radius];
        let short = states(&bench, &[&[capture.to_str().expect("a path")], &set[..]].concat());
        assert!(!short.is_empty() && short.iter().all(|state| state.spin.is_none()), "{name} as it is");
        bench.file("long.pcap", write_pcap(&repeated(&capture, turns as i64)));
        let all = states(&bench, &[&["long.pcap"], &set[..]].concat());
        assert!(all.iter().all(|state| state.spin.is_none()), "{name} at {at:?}: it spins");
        let tracked: Vec<&StateLine> = all.iter().filter(|state| state.mode == Mode::Tracking).collect();
        // 30 turns; the first eight make a motion, six more where the first sight was a part of what is there.
        assert!(tracked.len() >= 15, "{name} at {at:?}: {} of {} tracked", tracked.len(), all.len());
        let (first, last) = (pose(tracked[0]).expect("a pose"), pose(tracked[tracked.len() - 1]).expect("a pose"));
        let (degrees, mm) = apart(&last, &first);
        println!(
            "{name} at {at:?}: {} of {} tracked, moved by {degrees:.2} degrees, {mm:.1} mm",
            tracked.len(),
            all.len()
        );
        assert!(degrees < 0.5 && mm < 10.0, "{name} at {at:?} has moved by {degrees} degrees, {mm} mm");
    }
}
