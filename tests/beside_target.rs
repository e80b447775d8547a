//! What stands beside a target that moves: found out and left out, without an order and without an empty room.

use tumbled::evaluation::EvaluateReport;
use tumbled_core::estimate::Mode;

use crate::support::{Workbench, repository};

/// A target at 20°/s about an axis that leans by 10°, over a plate on a column in a room: both are in the region, and neither moves.
/// Were the plate taken for a part, it would hold the model upright: measured 4.1° of attitude and 4.8° of axis, instead of 0.4° and
/// 0.6°.
#[test]
fn a_plate_under_a_leaning_target_is_no_part_of_it() {
    let bench = Workbench::new();
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    let room =
        "[room]\nfloor_m = [2.2, 0.0, -1.2]\nsize_m = [8.0, 8.0, 3.0]\nstage_radius_m = 0.25\nstage_below_m = 0.55\n\n";
    let leaning = scene.replace("axis = [0.0, 0.0, 1.0]", "axis = [0.1736, 0.0, 0.9848]");
    let leaning = leaning.replacen("[motion]", &format!("{room}[motion]"), 1);
    assert!(leaning.contains("0.1736") && leaning.contains("stage_radius_m"), "{leaning}");
    bench.file("leaning.toml", leaning);
    let done = bench.run(&["simulate", "./leaning.toml", "-o", "out", "--duration", "8s", "--seed", "5"]);
    assert_eq!(done.code, 0, "{}", done.stderr);

    let session = ["out/capture.mcap", "--config", "out/rig.toml"];
    let done = bench.run(&[&["evaluate"], &session[..], &["--truth", "out/truth.csv", "--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: EvaluateReport = done.json();
    let tracking = report.modes.iter().find(|mode| mode.mode == Mode::Tracking).expect("a mode").epochs;
    assert!(tracking as f64 > 0.85 * report.epochs as f64, "{:?}", report.modes);
    let figures = report.scored.and_then(|scored| scored.pose).expect("scored against the truth");
    let gauge_free = figures.pose.first().expect("a pose");
    assert!(gauge_free.attitude_rms_deg < 1.0, "{gauge_free:?}");
    let axis = figures.axis_deg.expect("an axis");
    assert!(axis.rms < 2.0, "{axis:?}");
}
