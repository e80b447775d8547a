//! Scenes as inputs: simulated sensors through everything that real ones pass.

use tumbled::cli::replay::ReplayReport;
use tumbled::stream::StreamOrigin;
use tumbled_core::ClockState;

use crate::support::{Workbench, repository};

/// The accuracy scene, six seconds of it.
fn short_scene(bench: &Workbench) {
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    bench.file("short.toml", scene.replace("duration_s = 60.0", "duration_s = 6.0"));
}

fn replayed(bench: &Workbench, arguments: &[&str]) -> ReplayReport {
    let done = bench.run(&[&["replay"], arguments, &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

#[test]
fn a_scene_is_a_healthy_rig_whose_clocks_lock_and_whose_points_all_count() {
    let bench = Workbench::new();
    short_scene(&bench);
    let report = replayed(&bench, &["sim:short.toml"]);
    assert_eq!((report.origin, report.complete), (StreamOrigin::Simulated, true));
    let [near, front] = report.sensors.as_slice() else { panic!("a Kinect and a LiDAR: {report:?}") };
    // 30 frames a second; 6 s / 663.552 µs = 9042.3 packets, and a position packet each tenth of a second.
    assert_eq!(near.received, 180);
    assert!((9_102..=9_104).contains(&front.received), "{}", front.received);
    for sensor in &report.sensors {
        let clock = sensor.clock.expect("a clock");
        assert_eq!((clock.state, sensor.lost.total), (ClockState::Locked, 0), "{}", sensor.id);
        assert!(sensor.points.decoded > 50_000 && sensor.points.in_epochs == sensor.points.decoded);
    }
    // The LiDAR's counter runs 18 ppm slow: so much slower than the host.
    let skew = front.clock.expect("a clock").skew_ppm;
    assert!((skew - 18.0).abs() < 2.0, "{skew}");
}

#[test]
fn a_recording_of_a_scene_is_simulated_for_ever_and_replays_to_the_same_bit() {
    let bench = Workbench::new();
    short_scene(&bench);
    let imported = bench.run(&["import", "sim:short.toml", "-o", "run.mcap"]);
    assert_eq!(imported.code, 0, "{}", imported.stderr);
    let (scene, recording) = (replayed(&bench, &["sim:short.toml"]), replayed(&bench, &["run.mcap", "--threads", "2"]));
    assert_eq!(recording.origin, StreamOrigin::Simulated);
    assert_eq!((recording.checkpoint, recording.digest), (scene.checkpoint, scene.digest));
}

#[test]
fn a_scene_that_is_none_is_refused_with_those_there_are() {
    let bench = Workbench::new();
    let done = bench.run(&["replay", "sim:demos"]);
    assert_eq!(done.code, 2);
    assert!(done.stderr.contains("demo, tumble, turntable-20dps"), "{}", done.stderr);
    let done = bench.run(&["replay", "sim:demo", "sim:tumble"]);
    assert_eq!(done.code, 2);
    bench.file("wrong.toml", "name = \"x\"\ncolour = 1\n");
    let done = bench.run(&["replay", "sim:wrong.toml"]);
    assert!(done.code == 2 && done.stderr.contains("wrong.toml"), "{}", done.stderr);
}

#[test]
fn simulated_files_are_the_same_session_in_every_format_and_the_same_bytes_for_the_same_seed() {
    let bench = Workbench::new();
    short_scene(&bench);
    for (folder, threads) in [("a", "1"), ("b", "2")] {
        let arguments = ["simulate", "short.toml", "-o", folder, "--duration", "1500ms", "--threads", threads];
        let done = bench.run(&arguments);
        assert_eq!(done.code, 0, "{}", done.stderr);
    }
    let names =
        ["capture.mcap", "velodyne.pcap", "kinect/INDEX.txt", "truth.csv", "mesh.ply", "rig.toml", "rig-true.toml"];
    for name in names.into_iter().chain(["serial.log"]) {
        let (a, b) = (bench.read_bytes(&format!("a/{name}")), bench.read_bytes(&format!("b/{name}")));
        assert!(!a.is_empty() && a == b, "{name}");
    }
    // The pcap and the recording hold the same packets: the same points.
    let points = |input: &str| bench.points(input, "a/rig.toml");
    let from_recording = points("a/capture.mcap");
    assert!(from_recording.len() > 10_000 * 24 && from_recording == points("a/velodyne.pcap"));
    // Truth: 0 to 1.5 s a hundred times a second, and a turn of 20 degrees a second about z.
    let truth = bench.read("a/truth.csv");
    let rows: Vec<Vec<f64>> = truth
        .lines()
        .skip(1)
        .map(|row| row.split(',').map(|value| value.parse().expect("a number")).collect())
        .collect();
    assert_eq!(rows.len(), 151);
    let rate = 20f64.to_radians();
    assert!(rows.iter().all(|row| (row[11] - rate).abs() < 1e-12 && (row[2] - 2.2).abs() < 1e-12));
    // The rotation about z after 1.5 s: half of 30 degrees in the quaternion.
    assert!((rows[150][7] - 15f64.to_radians().sin()).abs() < 1e-12, "{:?}", rows[150]);
    assert_eq!(bench.run(&["simulate", "short.toml", "-o", "a"]).code, 2, "a folder that is not empty");
}
