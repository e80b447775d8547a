//! `tumbled calibrate extrinsic`: from a recording to a file that a config takes, and what is refused.

use tumbled::calibration::depth::KinectReport;
use tumbled::calibration::extrinsic::ExtrinsicReport;
use tumbled_calib::Status;

use crate::support::Workbench;

/// Five poses of a board, each held for 1.6 s.
const SCENE: &str = r#"
name = "board"
about = "five poses"
seed = 3
duration_s = 12.0
unix_ns_at_zero = 1_795_341_600_000_000_000
roi_center_m = [1.8, 0.3, 0.0]
roi_radius_m = 1.2
target = { shape = "board" }
[motion]
kind = "poses"
upright_xyzw = [0.5, -0.5, -0.5, 0.5]
rest_s = 1.6
move_s = 1.0
poses = [
    { at_m = [1.5, 0.3, 0.0] },
    { at_m = [1.7, 0.2, 0.1], turned_deg = [0.0, 35.0, 0.0] },
    { at_m = [1.8, 0.4, -0.1], turned_deg = [0.0, -35.0, 0.0] },
    { at_m = [1.9, 0.2, 0.0], turned_deg = [0.0, 0.0, 35.0] },
    { at_m = [2.0, 0.4, 0.0], turned_deg = [0.0, 0.0, -35.0] },
]
[room]
floor_m = [2.0, 0.0, -1.2]
size_m = [6.0, 5.0, 2.8]
[[lidar]]
id = "front"
model = "vlp-32c"
rpm = 600
view = { sector = { from_deg = 315.0, to_deg = 405.0 } }
parameters = { range_sigma_m = 0.020, beam_bias_sigma_m = 0.0 }
[[kinect]]
id = "near"
t_rig_kinect = { translation_m = [0.0, 0.3, 0.0], rotation_xyzw = [-0.5, 0.5, -0.5, 0.5] }
"#;

#[test]
fn a_recorded_board_becomes_a_calibration_that_the_config_takes_and_a_wrong_size_is_refused() {
    let bench = Workbench::new();
    bench.file("board.toml", SCENE);
    let done = bench.run(&["simulate", "board.toml", "-o", "out"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let calibrate = |more: &[&str]| {
        let common = ["calibrate", "extrinsic", "--from", "out/capture.mcap", "--config", "out/rig.toml", "--json"];
        bench.run(&[&common[..], more].concat())
    };
    // A file that is there is kept.
    bench.file("cal.toml", "");
    let done = calibrate(&["-o", "cal.toml", "--report", "report.html"]);
    assert_eq!(done.code, 0, "{} {}", done.stdout, done.stderr);
    let report: ExtrinsicReport = done.json();
    // Five poses are usable and fewer than wanted.
    assert_eq!(report.provenance.status, Status::Warn);
    assert_eq!(report.poses.iter().filter(|pose| pose.left_aside.is_none()).count(), 5, "{:?}", report.poses);
    let result = report.result.expect("a result");
    let [x, y, z] = result.t_lidar_kinect.translation_m;
    let off_mm = 1e3 * (x * x + (y - 0.3) * (y - 0.3) + z * z).sqrt();
    // The camera's depths are warped by up to 3 mm in this scene.
    assert!(off_mm < 15.0, "{off_mm} mm");
    let page = bench.read("report.html");
    for part in
        ["WARN: usable", "Where the boards face", "Do the poses agree?", "In the LiDAR's frame, with the result"]
    {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("http") && !page.contains("NaN"));
    // The config takes it, and shows it.
    let rig = bench.read("out/rig.toml");
    bench.file("rig.toml", rig.replacen("[rig]\n", "[rig]\ncalibration = \"cal.toml\"\n", 1));
    let shown = bench.run(&["config", "show", "--origin", "--config", "rig.toml"]);
    assert_eq!(shown.code, 0, "{}", shown.stderr);
    assert!(shown.stdout.contains(&format!("{:?}", result.t_rig_kinect.translation_m[0])), "{}", shown.stdout);
    assert!(report.kept.is_some_and(|kept| kept.ends_with(".bak")));
    // Another board than was shown: nothing is written, and it says what it saw.
    let done = calibrate(&["-o", "other.toml", "--board", "1.2x0.9"]);
    let refused: ExtrinsicReport = done.json();
    assert_eq!((done.code, refused.written, refused.result), (3, None, None));
    assert!(done.stderr.contains("nothing flat of 1.20 x 0.90 m"), "{}", done.stderr);
}

/// The board over the whole picture, near and far, of a camera whose depths are 1 % too large.
fn wide_scene() -> String {
    let poses = "poses = [
    { at_m = [1.25, 0.25, 0.05], turned_deg = [0.0, 20.0, 0.0] },
    { at_m = [2.1, -0.45, 0.35], turned_deg = [0.0, -30.0, 20.0] },
    { at_m = [2.0, 1.05, 0.35], turned_deg = [0.0, 0.0, -35.0] },
    { at_m = [2.1, 1.0, -0.4], turned_deg = [0.0, 30.0, 25.0] },
    { at_m = [2.0, -0.45, -0.4], turned_deg = [0.0, 20.0, 35.0] },
]";
    let (head, rest) = SCENE.split_once("poses = [").expect("poses");
    let (_, tail) = rest.split_once("]\n[room]").expect("the room");
    let mounting = "t_rig_kinect = { translation_m = [0.0, 0.3";
    let bent = format!("parameters = {{ depth_scale = 1.01 }}\n{mounting}");
    format!("{head}{poses}\n[room]{tail}")
        .replace(mounting, &bent)
        .replace("duration_s = 12.0", "duration_s = 10.4")
        .replace("move_s = 1.0", "move_s = 0.6")
}

#[test]
fn a_kinects_depths_are_calibrated_from_a_recording_and_the_config_takes_them() {
    let bench = Workbench::new();
    bench.file("board.toml", wide_scene());
    let done = bench.run(&["simulate", "board.toml", "-o", "out"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let common = ["calibrate", "kinect", "--from", "out/capture.mcap", "--config", "out/rig.toml", "--json"];
    let done = bench.run(&[&common[..], &["-o", "cal.toml", "--report", "report.html"]].concat());
    assert_eq!(done.code, 0, "{} {}", done.stdout, done.stderr);
    let report: KinectReport = done.json();
    // Five poses are usable and fewer than wanted.
    assert_eq!(report.provenance.status, Status::Warn);
    let result = report.result.expect("a result");
    let scale = result.place.depth_scale.expect("a scale");
    assert!((1.01 * scale - 1.0).abs() < 0.004, "{scale}");
    let page = bench.read("report.html");
    for part in ["WARN: usable", "With the model, mm", "What the data bear", "Warming up"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("http") && !page.contains("NaN"));
    // The config takes it, and decodes by it.
    let rig = bench.read("out/rig.toml");
    bench.file("rig.toml", rig.replacen("[rig]\n", "[rig]\ncalibration = \"cal.toml\"\n", 1));
    let shown = bench.run(&["config", "show", "--origin", "--config", "rig.toml"]);
    assert_eq!(shown.code, 0, "{}", shown.stderr);
    let of_key = |key: &str| shown.stdout.lines().find_map(|line| line.strip_prefix(key)?.split_whitespace().next());
    let taken: f64 = of_key("depth_scale = ").and_then(|text| text.parse().ok()).expect("a scale");
    assert!((taken - scale).abs() < 1e-9 && of_key("depth_warp.factors = ").is_some(), "{}", shown.stdout);
    // A surface that is none is refused with its place.
    let cal = bench.read("cal.toml");
    let (head, _) = cal.split_once("factors = [").expect("a surface");
    bench.file("cal.toml", format!("{head}factors = [9.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0]\n"));
    let refused = bench.run(&["config", "check", "rig.toml"]);
    assert!(
        refused.code == 2 && refused.stderr.contains("changes a depth of 2 m by 9"),
        "{} {}",
        refused.stdout,
        refused.stderr
    );
}

#[test]
fn arguments_and_files_that_are_none_are_refused() {
    let bench = Workbench::new();
    bench.file("rig.toml", "[stream]\n");
    let run = |more: &[&str]| {
        let done = bench.run(&[&["calibrate", "extrinsic", "--from", "sim:calibration-board"], more].concat());
        (done.code, done.stderr)
    };
    let (code, said) = run(&["-o", "rig.toml"]);
    assert!(code == 2 && said.contains("a calibration file is expected there"), "{said}");
    let (code, said) = run(&["-o", "cal.toml", "--board", "0.8"]);
    assert!(code == 2 && said.contains("two sides in metres"), "{said}");
    let (code, said) = run(&["-o", "cal.toml", "--kinect", "far"]);
    assert!(code == 2 && said.contains("no [[kinect]] `far`"), "{said}");
}
