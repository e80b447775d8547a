//! `tumbled reconstruct` and `experiment reconstruction`: a model of a simulated session, whose target is known.

use tumbled::cli::replay::ReplayReport;
use tumbled::experiment::reconstruction::ReconstructionReport;
use tumbled::reconstruction::ReconstructReport;
use tumbled::reconstruction::report::{ContourFile, EdgeTag, PlanesFile};

use crate::support::Workbench;
use crate::support::real::{HAND_HELD, real};

#[test]
fn a_session_gives_the_same_model_on_any_threads_with_the_sides_of_its_target() {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "out", "--duration", "6s"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let recording = ["out/capture.mcap", "--config", "out/rig.toml"];
    let model = |folder: &str, threads: &str| {
        let options = ["-o", folder, "--threads", threads, "--json"];
        let done = bench.run(&[&["reconstruct"], &recording[..], &options].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json::<ReconstructReport>()
    };
    let report = model("one", "1");
    assert_eq!(report, model("two", "2"));
    assert_eq!(report.files, ["model.ply", "planes.json", "contour.obj", "contour.json", "motion.csv", "model.png"]);
    for file in &report.files {
        let [one, two] = ["one", "two"].map(|folder| std::fs::read(bench.path(folder).join(file)).expect("a file"));
        assert!(!one.is_empty() && one == two, "{file}");
    }
    // To keep frames changes nothing of the session.
    let replay: ReplayReport = bench.run(&[&["replay", "--json"], &recording[..]].concat()).json();
    assert_eq!(report.digest, replay.digest);
    // 6 s, of which 0.7 s pass before it is tracked: some 100° at a frame every 3°, fewer than every Kinect frame there was.
    assert!((20..=60).contains(&report.kinect_frames) && report.lidar_frames >= 20, "{report:?}");
    // 20 °/s about z, by a third of a turn and an operator's config.
    let spin = report.spin.as_ref().expect("a motion");
    assert!((spin.rate_dps - 20.0).abs() < 0.2 && spin.axis[2] > 0.9995 && spin.wander_deg < 0.5, "{spin:?}");
    assert_eq!(bench.read("one/motion.csv").lines().count() as u64, 1 + report.kinect_frames + report.lidar_frames);
    let planes: PlanesFile = serde_json::from_str(&bench.read("one/planes.json")).expect("planes");
    assert_eq!(planes.planes.len() as u64, report.planes);
    // Two sides of the bus were seen: 90° apart to a degree.
    let largest = &planes.planes[..4];
    let upright = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>().abs() < 0.018;
    assert!(largest.iter().any(|a| largest.iter().any(|b| upright(&a.normal, &b.normal))), "{largest:?}");
    let contour: ContourFile = serde_json::from_str(&bench.read("one/contour.json")).expect("a contour");
    // The bus is 0.45 m high; both its sides were seen at once.
    let length = |ends: &[[f64; 3]; 2]| ends[0].iter().zip(ends[1]).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    let creases = contour.edges.iter().filter(|edge| edge.tag == EdgeTag::Crease);
    assert!(creases.map(|edge| length(&edge.ends_m)).any(|length| (length - 0.45).abs() < 0.05));
    assert!(bench.read("one/contour.obj").contains("g crease\nv "));
    // Of a LiDAR's 16 mm a tenth is left at most: σ_s = 2 mm leaves 1.5 %.
    let lidar = report.lidar.expect("LiDAR points");
    assert!(lidar.after_mm < 0.1 * lidar.before_mm, "{lidar:?}");
    // The points as they were measured have no planes.
    let plain = ["-o", "plain", "--no-planes", "--json"];
    let done = bench.run(&[&["reconstruct"], &recording[..], &plain].concat());
    let plain: ReconstructReport = done.json();
    assert_eq!((plain.points, plain.planes, plain.creases + plain.boundaries), (report.points, 0, 0));
}

#[test]
fn a_session_without_a_target_has_no_model_and_says_so() {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "out", "--duration", "500ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let done = bench.run(&["reconstruct", "out/capture.mcap", "--config", "out/rig.toml", "-o", "model"]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    assert!(done.stderr.contains("no frame shows a tracked target"), "{}", done.stderr);
    let done = bench.run(&["reconstruct", "out/capture.mcap", "-o", "model", "--surface-sigma", "-1"]);
    assert_eq!(done.code, 2, "{}", done.stderr);
}

/// Long, for it turns a target once: run where figures are wanted.
#[test]
#[ignore = "half a minute of simulation"]
fn a_model_of_a_turn_lies_on_the_true_surface() {
    let bench = Workbench::new();
    let done = bench.run(&["experiment", "reconstruction", "--target", "box", "--seeds", "1", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: ReconstructionReport = done.json();
    let fused = report.rows.iter().find(|row| row.sensors == "fused" && row.planes).expect("a row");
    // What must hold of a model: 4 mm from the mesh, 90 % complete, the LiDAR's points at half their distance.
    assert!(fused.to_mesh_mm.expect("a model") <= 4.0, "{fused:?}");
    assert!(fused.complete.expect("a surface") >= 0.9, "{fused:?}");
    assert!(fused.lidar_ratio.expect("points") >= 2.0, "{fused:?}");
}

#[test]
fn a_real_scene_has_planes_that_are_thinner_than_they_were_measured() {
    let Some(folder) = real("kinect/seq7") else { return };
    let bench = Workbench::new();
    bench.file("rig.toml", HAND_HELD);
    let input = folder.display().to_string();
    let done = bench.run(&["reconstruct", &input, "--config", "rig.toml", "-o", "model", "--json"]);
    assert!([0, 3].contains(&done.code), "{}", done.stderr);
    let report: ReconstructReport = done.json();
    println!("{}", report.text());
    let kinect = report.kinect.expect("points on planes");
    assert!(report.planes >= 3 && kinect.after_mm < kinect.before_mm / 2.0, "{report:?}");
}
