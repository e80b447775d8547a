//! `tumbled evaluate`: a simulated session held against its truth, and what is refused.

use tumbled::cli::replay::ReplayReport;
use tumbled::evaluation::EvaluateReport;
use tumbled::evaluation::figures::AlignedBy;
use tumbled::evaluation::report::TruthClock;
use tumbled_core::estimate::Mode;

use crate::support::{Done, Workbench, repository};

/// `out/` of three seconds of the turntable.
fn simulated() -> Workbench {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "out", "--duration", "3s"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    bench
}

fn evaluate(bench: &Workbench, arguments: &[&str]) -> Done {
    bench.run(&[&["evaluate", "--json"], arguments].concat())
}

#[test]
fn a_session_is_held_against_its_truth_and_its_turntable_and_reported() {
    let bench = simulated();
    let recording = ["out/capture.mcap", "--config", "out/rig.toml"];
    let done = evaluate(&bench, &[&recording[..], &["--truth", "out/truth.csv", "-o", "report"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(bench.read("report/report.json"), done.stdout);
    let report: EvaluateReport = done.json();
    // The states are those of a replay, to the bit.
    let replay: ReplayReport = bench.run(&[&["replay", "--json"], &recording[..]].concat()).json();
    assert_eq!((&report.digest, report.epochs), (&replay.digest, replay.checkpoint.epochs));
    // 0 to 3 s a hundred times a second; a scene's own times are the session's.
    assert_eq!((report.truth.samples, report.truth.clock), (301, TruthClock::Session));
    let tracking = report.modes.iter().find(|mode| mode.mode == Mode::Tracking).expect("a mode").epochs;
    assert_eq!(report.modes.iter().map(|mode| mode.epochs).sum::<u64>(), report.epochs);
    let scored = report.scored.expect("scored");
    // 60° are no revolution: everything is scored, and the report says so.
    assert!(report.warnings.iter().any(|warning| warning.contains("revolutions")), "{:?}", report.warnings);
    assert!(scored.states > 10 && scored.states + scored.left_out <= tracking, "{scored:?}");
    assert!((report.first_tracking_s.expect("tracked") - scored.from_s).abs() < 1e-6);
    assert!((scored.travel_deg - 20.0 * (scored.to_s - scored.from_s)).abs() < 0.01, "{scored:?}");
    let pose = scored.pose.expect("poses");
    let kinds: Vec<AlignedBy> = pose.pose.iter().map(|pose| pose.alignment).collect();
    assert_eq!(kinds, [AlignedBy::MeanTwist, AlignedBy::FirstSecond]);
    // Not a measure of the estimation: a frame mixed up is tens of degrees and decimetres off.
    let free = &pose.pose[0];
    assert!(free.attitude_rms_deg < 3.0 && free.position_rms_mm < 100.0, "{free:?}");
    assert!(pose.axis_deg.expect("it turns").rms < 10.0 && pose.rate_dps.rms < 5.0);
    let consistency = free.consistency.as_ref().expect("covariances");
    assert_eq!(consistency.nees12.count + consistency.not_positive, scored.states);
    let page = bench.read("report/report.html");
    for part in ["gauge-free", "NEES(12)", "<svg", "Spin axis", "scored from"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("http") && !page.contains("NaN"));
    // The encoder knows the angle alone: no position, and nothing keeps its limit by not being known.
    bench.file(
        "limits.toml",
        "[limits]\nrate_rms_dps = 5.0\naxis_rms_deg = 0.0\nposition_rms_mm = 1e6\nlost_share = 0.0\n",
    );
    let limited = ["--truth", "turntable", "--from", "0", "--limits", "limits.toml"];
    let done = evaluate(&bench, &[&recording[..], &limited].concat());
    assert_eq!(done.code, 3, "{}", done.stderr);
    let report: EvaluateReport = done.json();
    let kept: Vec<(&str, bool)> = report.limits.iter().map(|check| (check.limit.as_str(), check.kept)).collect();
    let expected = [("rate_rms_dps", true), ("axis_rms_deg", false), ("position_rms_mm", false), ("lost_share", true)];
    assert_eq!(kept, expected, "{:?}", report.limits);
    assert!(report.complete, "the inputs are whole all the same");
    let scored = report.scored.expect("scored");
    assert!(report.truth.name == "turntable turntable" && report.truth.samples > 130, "{:?}", report.truth);
    let turntable = scored.turntable.expect("a turntable");
    // The scene turns about z.
    assert!(turntable.axis[2] > 0.98 && turntable.about_axis_deg.rms < 3.0 && scored.pose.is_none(), "{turntable:?}");
    // The same from packets and frames, whose times are wall time.
    let captures = ["out/velodyne.pcap", "out/kinect", "--config", "out/rig.toml", "--truth", "out/truth.csv"];
    let done = bench.run(&[&["evaluate"], &captures[..]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(done.stdout.contains("301 samples by wall time") && done.stdout.contains("gauge-free"), "{}", done.stdout);
}

#[test]
fn a_truth_that_is_none_or_of_another_time_is_refused() {
    let bench = Workbench::new();
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    bench.file("short.toml", scene.replace("duration_s = 60.0", "duration_s = 0.3"));
    let heading = "t_ns,unix_ns,px,py,pz,qx,qy,qz,qw,wx,wy,wz\n";
    let refused = |truth: &str, expected: &str| {
        bench.file("truth.csv", truth);
        let done = evaluate(&bench, &["sim:short.toml", "--truth", "truth.csv"]);
        assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{expected}");
        assert!(done.stderr.contains(expected), "{}", done.stderr);
    };
    refused("time,x\n", "truth.csv:1: no column t_ns");
    refused(&format!("{heading}0,0,1,0,0,0,0,0,1,0,0,0\n10,10,1,0,0,0,0,0,1,0,0\n"), "truth.csv:3: 11 values");
    // An hour later, by either clock.
    let late = "3600000000000,1,1,0,0,0,0,0,1,0,0,0\n3700000000000,2,1,0,0,0,0,0,1,0,0,0\n";
    refused(&format!("{heading}{late}"), "of other times than the inputs");
    let done = evaluate(&bench, &["sim:short.toml", "--truth", "nowhere.csv"]);
    assert!(done.code == 2 && done.stderr.contains("cannot read nowhere.csv"), "{}", done.stderr);
}

#[test]
fn a_session_without_a_tracked_epoch_is_incomplete_and_says_why() {
    let bench = Workbench::new();
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    bench.file("short.toml", scene.replace("duration_s = 60.0", "duration_s = 0.3"));
    let rows: String = (0..=30).map(|n| format!("{0},{0},2.2,0,0,0,0,0,1,0,0,0\n", n * 10_000_000)).collect();
    bench.file("truth.csv", format!("t_ns,unix_ns,px,py,pz,qx,qy,qz,qw,wx,wy,wz\n{rows}"));
    // Nothing stands there.
    let region = "target.roi_center_m=[0.0, 0.0, 50.0]";
    let arguments = ["sim:short.toml", "--truth", "truth.csv", "--set", region, "-o", "report"];
    let done = evaluate(&bench, &arguments);
    assert_eq!(done.code, 3, "{}", done.stderr);
    let report: EvaluateReport = done.json();
    assert_eq!((report.unscored.as_deref(), report.first_tracking_s), (Some("no epoch was tracked"), None));
    assert!(report.epochs > 5 && report.scored.is_none() && !report.complete);
    assert_eq!(report.reasons.first().map(|count| count.reason.name()), Some("no_points"));
    assert!(bench.read("report/report.html").contains("Nothing scored: no epoch was tracked"));
}

#[test]
fn help_tells_what_is_scored() {
    insta::assert_snapshot!("help_evaluate", Workbench::new().run(&["evaluate", "--help"]).transcript());
}
