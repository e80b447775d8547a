//! `tumbled register`: two clouds to a pose, and what is refused.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use serde_json::Value;
use tumbled::cli::register::report::RegisterReport;
use tumbled::experiment::{Attitudes, Pair, PairSpec, PointCounts, Stand};
use tumbled_sim::target::TargetKind;

use crate::support::Workbench;

/// A bench with kinect.ply, lidar.ply and guess.json, the truth, of one simulated pair with sights 5 to 25 degrees apart.
fn pair() -> (Workbench, Pair) {
    let spec = PairSpec {
        target: TargetKind::BoxBus,
        points: PointCounts { kinect: 1239, lidar: 126 },
        sights_deg: [5.0, 25.0],
        overlap: [0.7, 1.0],
        attitudes: Attitudes::Random,
        organised: false,
    };
    let pair = Stand::new(spec.target).and_then(|stand| stand.pair(&spec, 11, 0)).expect("a pair");
    let bench = Workbench::new();
    bench.file("kinect.ply", text_ply(&pair.moving.points));
    bench.file("lidar.ply", text_ply(&pair.reference.points));
    bench.file("guess.json", pose_json(&pair.truth.expect("simulated")));
    (bench, pair)
}

fn text_ply(points: &[Point3<f32>]) -> String {
    let body: String = points.iter().map(|point| format!("{} {} {}\n", point.x, point.y, point.z)).collect();
    let count = points.len();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header\n{body}"
    )
}

fn pose_json(pose: &Isometry3<f64>) -> String {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    serde_json::json!({"t_reference_moving": {
        "translation_m": [t.x, t.y, t.z], "rotation_xyzw": [q.x, q.y, q.z, q.w]
    }})
    .to_string()
}

fn pose(report: &RegisterReport) -> Isometry3<f64> {
    let ([x, y, z], [i, j, k, w]) = (report.t_reference_moving.translation_m, report.t_reference_moving.rotation_xyzw);
    let rotation = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

/// Within 5° and 5 cm at the cloud's middle, as the acceptance figures have it.
fn is_right(found: &Isometry3<f64>, pair: &Pair) -> bool {
    let truth = pair.truth.expect("simulated");
    let middle = tumbled::experiment::trial::centroid(&pair.moving);
    found.rotation.angle_to(&truth.rotation).to_degrees() < 5.0 && (found * middle - truth * middle).norm() < 0.05
}

#[test]
fn the_report_has_the_contracts_keys_in_their_order_and_the_pose() {
    let (bench, pair) = pair();
    let done = bench.run(&["register", "kinect.ply", "lidar.ply", "--init", "guess.json", "--json", "--threads", "1"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: RegisterReport = done.json();
    assert!(is_right(&pose(&report), &pair), "{}", done.stdout);
    assert_eq!(report.accepted, report.reason.is_none());
    assert_eq!((report.moving.sensor.as_str(), report.reference.sensor.as_str()), ("kinect", "lidar"));
    assert_eq!((report.moving.points, report.reference.points), (1239, 126));
    // The contract's keys, in its order; what is ours comes after.
    let keys = [
        "t_reference_moving",
        "covariance",
        "accepted",
        "reason",
        "score",
        "gap",
        "inliers",
        "rmse_m",
        "iterations",
        "time_ms",
        "alternatives",
    ];
    let place = |key: &&str| done.stdout.find(&format!("\n  \"{key}\":")).unwrap_or_else(|| panic!("no {key}"));
    assert!(keys.iter().map(place).collect::<Vec<_>>().is_sorted(), "{}", done.stdout);
    let symmetric = |i: usize, j: usize| (report.covariance[i][j] - report.covariance[j][i]).abs() < 1e-12;
    assert!((0..6).all(|i| report.covariance[i][i] > 0.0 && (0..6).all(|j| symmetric(i, j))));
}

#[test]
fn the_roles_can_be_changed_and_the_result_is_the_inverse() {
    let (bench, pair) = pair();
    let truth = pair.truth.expect("simulated");
    bench.file("back.json", pose_json(&truth.inverse()));
    let done = bench.run(&["register", "lidar.ply", "kinect.ply", "--init", "back.json", "--json"]);
    let report: RegisterReport = done.json();
    assert_eq!((report.moving.sensor.as_str(), report.reference.sensor.as_str()), ("lidar", "kinect"));
    assert!(is_right(&pose(&report).inverse(), &pair), "{}", done.stdout);
}

#[test]
fn every_method_answers_and_the_same_each_time_but_for_the_time() {
    let (bench, _) = pair();
    for method in ["cga", "cga-paper", "icp", "plane-icp", "gicp", "cbd"] {
        let run = |threads| {
            let done = bench.run(&[
                "register",
                "kinect.ply",
                "lidar.ply",
                "--method",
                method,
                "--init",
                "guess.json",
                "--threads",
                threads,
                "--json",
            ]);
            assert_eq!(done.code, 0, "{method}: {}", done.stderr);
            RegisterReport { time_ms: 0.0, ..done.json() }
        };
        let found = run("1");
        assert_eq!(found, run("2"), "{method}");
        assert_eq!(found.method, method);
    }
}

#[test]
fn a_result_is_a_guess_for_the_next() {
    let (bench, pair) = pair();
    let first = bench.run(&["register", "kinect.ply", "lidar.ply", "--init", "guess.json", "--json"]);
    bench.file("first.json", &first.stdout);
    let second = bench.run(&["register", "kinect.ply", "lidar.ply", "--init", "first.json", "--json"]);
    assert!(is_right(&pose(&second.json()), &pair), "{}", second.stderr);
}

#[test]
fn people_are_told_the_pose_how_sure_it_is_and_whether_it_may_be_used() {
    let (bench, _) = pair();
    let done = bench.run(&["register", "kinect.ply", "lidar.ply", "--init", "guess.json"]);
    for word in
        ["cga: 1239 kinect points onto 126 lidar points", "translation", "rotation", "±", "deg", "mm", "accepted"]
    {
        assert!(done.stdout.contains(word), "{word} in {}", done.stdout);
    }
}

#[test]
fn the_page_holds_everything_and_no_text_of_a_name_gets_out() {
    let (bench, _) = pair();
    // A name that would open a script if it were written as it is.
    let moving = "<!--<script>.ply";
    bench.file(moving, bench.read("kinect.ply"));
    let done = bench.run(&["register", moving, "lidar.ply", "--method", "gicp", "--viz", "pair.html"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let page = bench.read("pair.html");
    assert!(!page.contains("http") && !page.contains("src=") && !page.contains("DATA_OF_THE_PAGE"));
    assert_eq!(page.matches("<script").count(), 2, "its own two scripts and none more");
    let (start, end) = ("<script type=\"application/json\" id=\"data\">", "</script>");
    let data = page.split(start).nth(1).and_then(|rest| rest.split(end).next()).expect("the data");
    let data: Value = serde_json::from_str(data).expect("JSON");
    assert_eq!(data["moving"]["name"], moving);
    assert_eq!(data["moving"]["points"].as_array().expect("numbers").len(), 3 * 1239);
    assert_eq!(data["poses"][0]["name"], "result");
}

#[test]
fn what_is_no_cloud_is_refused_with_its_name_and_a_remedy() {
    let (bench, pair) = pair();
    let refused = |arguments: &[&str], expected: &[&str]| {
        let done = bench.run(&[&["register"], arguments].concat());
        assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{arguments:?}: {}", done.stderr);
        for word in expected {
            assert!(done.stderr.contains(word), "{word} in {}", done.stderr);
        }
    };
    let points = &pair.moving.points;
    bench.file("three.ply", text_ply(&points[..3]));
    bench.file("empty.ply", text_ply(&[]));
    bench.file("nan.ply", text_ply(&[Point3::new(f32::NAN, 0.0, 1.0); 40]));
    bench.file("mm.ply", text_ply(&points.iter().map(|point| *point * 1000.0).collect::<Vec<_>>()));
    bench.file("line.ply", text_ply(&(0..50).map(|n| Point3::new(0.01 * n as f32, 1.0, 2.0)).collect::<Vec<_>>()));
    bench.file("bad.json", "{\"t_reference_moving\": {\"translation_m\": [0, 0, 0], \"rotation_xyzw\": [0, 0, 0, 2]}}");
    bench.file("other.json", "{\"pose\": 1}");
    refused(&["three.ply", "lidar.ply"], &["three.ply", "3 finite points", "at least 10"]);
    refused(&["kinect.ply", "empty.ply"], &["empty.ply", "0 finite points"]);
    refused(&["nan.ply", "lidar.ply"], &["nan.ply", "0 finite points"]);
    refused(&["mm.ply", "lidar.ply"], &["mm.ply", "millimetres"]);
    refused(&["line.ply", "lidar.ply"], &["line.ply", "line"]);
    refused(&["none.ply", "lidar.ply"], &["none.ply", "cannot be read"]);
    refused(&["kinect.ply", "lidar.ply", "--init", "bad.json"], &["bad.json", "length 2", "t_reference_moving"]);
    refused(&["kinect.ply", "lidar.ply", "--init", "other.json"], &["other.json", "t_reference_moving"]);
    refused(&["kinect.ply", "lidar.ply", "--method", "fmr"], &["cga-paper"]);
    refused(&["kinect.ply", "lidar.ply", "--sensors", "moving=radar"], &["kinect"]);
    refused(&["kinect.ply", "lidar.ply", "--viewpoint-moving", "here"], &["none"]);
    refused(&["kinect.ply", "lidar.ply", "--viz", "lidar.ply"], &["lidar.ply", "not written to"]);
    assert!(bench.read("lidar.ply").starts_with("ply"));
}

#[test]
fn a_cloud_of_which_nobody_knows_where_it_was_seen_from_is_registered_by_its_points_alone() {
    let (bench, pair) = pair();
    let arguments = ["--init", "guess.json", "--viewpoint-moving", "none", "--viewpoint-reference", "none", "--json"];
    let done = bench.run(&[&["register", "kinect.ply", "lidar.ply"], &arguments[..]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(is_right(&pose(&done.json()), &pair), "{}", done.stdout);
}
