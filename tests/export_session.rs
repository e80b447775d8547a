//! `tumbled export` of what a session computes: states, fused points, the model.

use std::fs;

use serde_json::Value;
use tumbled::reconstruction::ReconstructReport;

use crate::export_cli::export;
use crate::support::Workbench;

/// x, y, z, normal, sigma, plane and two counts: 7 floats and 3 integers of 4 bytes.
const POINT_ROW: usize = 40;

/// A bench with three seconds of the demo: `out/capture.mcap`.
fn demo() -> Workbench {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "demo", "-o", "out", "--duration", "3s"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    bench
}

const CONFIG: [&str; 2] = ["--config", "out/rig.toml"];

#[test]
fn states_are_those_of_the_replay_as_trajectories_tools_read_them() {
    let bench = demo();
    let replay = bench.run(&["replay", "out/capture.mcap", "--config", "out/rig.toml", "-o", "states.jsonl"]);
    assert_eq!(replay.code, 0, "{}", replay.stderr);
    let text = bench.read("states.jsonl");
    let states: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let with_pose: Vec<&Value> = states.iter().filter(|state| !state["position_m"].is_null()).collect();

    let done = export(&bench, "out/capture.mcap", "state", "tum", "poses.tum", &[&CONFIG[..], &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: Value = serde_json::from_str(&done.stdout).expect("JSON");
    assert_eq!((&report["records"], &report["points"]), (&states.len().into(), &with_pose.len().into()));
    let poses = bench.read("poses.tum");
    assert_eq!(poses.lines().count(), with_pose.len());
    for (line, state) in poses.lines().zip(&with_pose) {
        let (time, rest) = line.split_once(' ').expect("columns");
        assert_eq!(time.replace('.', ""), state["unix_ns"].as_str().expect("a text"));
        let numbers: Vec<f64> = rest.split(' ').map(|number| number.parse().expect("a number")).collect();
        let parts = ["position_m", "rotation_xyzw"].iter().flat_map(|key| state[*key].as_array().expect("numbers"));
        let told: Vec<f64> = parts.map(|number| number.as_f64().expect("a number")).collect();
        assert_eq!(numbers.len(), 7);
        assert!(numbers.iter().zip(&told).all(|(a, b)| (a - b).abs() < 1e-8), "{line}: {told:?}");
    }

    // Every epoch, with or without a pose; a part of them.
    let csv = |name: &str, more: &[&str]| {
        let done = export(&bench, "out/capture.mcap", "state", "csv", name, &[&CONFIG[..], more].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        bench.read(name)
    };
    let all = csv("all.csv", &[]);
    assert_eq!(all.lines().count(), 1 + states.len());
    assert!(all.lines().all(|line| line.matches(',').count() == 22), "{}", all.lines().next().unwrap_or_default());
    let some = csv("some.csv", &["--frames", "10..20"]);
    assert_eq!(some.lines().skip(1).collect::<Vec<_>>(), all.lines().skip(11).take(10).collect::<Vec<_>>());
    let near = csv("near.csv", &["--sensor", "near"]);
    assert_eq!(near.lines().skip(1).count(), all.lines().filter(|line| line.contains(",near,")).count());
}

#[test]
fn the_targets_points_are_those_of_the_reconstruction() {
    let bench = demo();
    let done = bench.run(&[&["reconstruct", "out/capture.mcap"], &CONFIG[..], &["-o", "model", "--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let made: ReconstructReport = serde_json::from_str(&done.stdout).expect("JSON");
    for what in ["model", "fused"] {
        let name = format!("{what}.ply");
        let done = export(&bench, "out/capture.mcap", what, "ply", &name, &CONFIG);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let bytes = fs::read(bench.path(&name)).expect("a file");
        let end = b"end_header\n";
        let body = bytes.windows(end.len()).position(|window| window == end).expect("a header") + end.len();
        assert_eq!((bytes.len() - body) as u64, made.points * POINT_ROW as u64, "{what}");
        // On planes or not.
        let plane = |row: &[u8]| i32::from_le_bytes(row[28..32].try_into().expect("four bytes"));
        let on_planes = bytes[body..].chunks_exact(POINT_ROW).filter(|row| plane(row) >= 0).count() as f64;
        let share = if what == "model" { made.on_planes } else { 0.0 };
        assert!((on_planes - share * made.points as f64).abs() < 0.5, "{what}: {on_planes}");
    }
    let done =
        export(&bench, "out/capture.mcap", "model", "csv", "model.csv", &[&CONFIG[..], &["--frames", "0..5"]].concat());
    assert_eq!(done.code, 2);
    assert!(done.stderr.contains("leave out --frames"), "{}", done.stderr);
}
