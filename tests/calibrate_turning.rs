//! `tumbled calibrate turntable`, `calibrate time` and `replay --vary` on a simulated stage: what they tell of it, and what
//! they refuse.

use tumbled::calibration::time::TimeReport;
use tumbled::calibration::turntable::TurntableReport;
use tumbled::vary::VaryReport;
use tumbled_calib::Status;

use crate::support::Workbench;

/// `out/` of three seconds of a stage at 20 °/s: 60° of turning.
fn simulated() -> Workbench {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "out", "--duration", "3s"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    bench
}

const RECORDING: [&str; 4] = ["--from", "out/capture.mcap", "--config", "out/rig.toml"];

#[test]
fn sixty_degrees_are_no_axis_and_one_rate_is_no_time_and_nothing_is_written() {
    let bench = simulated();
    let turntable = ["calibrate", "turntable", "-o", "calibration.toml", "--report", "axis.html", "--json"];
    let done = bench.run(&[&turntable[..], &RECORDING].concat());
    assert_eq!(done.code, 3, "{}", done.stderr);
    let report: TurntableReport = done.json();
    assert_eq!((report.provenance.status, report.turntable, report.written), (Status::Fail, None, None));
    let gate = report.provenance.gates.first().and_then(|gate| gate.remedy.clone()).expect("a reason");
    assert!(gate.contains("300° are the least"), "{gate}");
    let page = bench.read("axis.html");
    assert!(page.contains("FAIL: not to be used") && !page.contains("http") && !page.contains("NaN"));
    let time = ["calibrate", "time", "-o", "calibration.toml", "--sensor", "near", "--json"];
    let done = bench.run(&[&time[..], &RECORDING].concat());
    assert_eq!(done.code, 3, "{}", done.stderr);
    let report: TimeReport = done.json();
    let near = report.sensors.first().expect("one sensor");
    assert!(report.sensors.len() == 1 && near.time_offset_ms.is_none() && report.written.is_none());
    assert!(near.refused.iter().any(|reason| reason.contains("two turns each way")), "{:?}", near.refused);
    assert!(!bench.path("calibration.toml").exists());
}

#[test]
fn inputs_without_a_turntable_and_sensors_that_are_none_are_refused() {
    let bench = simulated();
    let done = bench.run(&[&["calibrate", "time", "-o", "c.toml", "--sensor", "far"], &RECORDING[..]].concat());
    assert_eq!(done.code, 2);
    assert!(done.stderr.contains("--sensor far: the config has front, near"), "{}", done.stderr);
    let done = bench.run(&["calibrate", "turntable", "-o", "c.toml", "--from", "out/kinect"]);
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(done.stderr.contains("no angle of a turntable"), "{}", done.stderr);
}

#[test]
fn each_assumption_has_a_row_for_each_value_and_the_configs_own_is_the_same_in_all() {
    let bench = simulated();
    let replay = ["replay", "out/capture.mcap", "--config", "out/rig.toml", "--json", "--html", "vary.html"];
    let vary = ["--vary", "time_offset_ms=-20..20:3,front.extrinsic.rz_deg=-2..2:3"];
    let done = bench.run(&[&replay[..], &vary].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: VaryReport = done.json();
    let names: Vec<&str> = report.assumptions.iter().map(|assumption| assumption.name.as_str()).collect();
    assert_eq!(names, ["near.time_offset_ms", "front.extrinsic.rz_deg"]);
    let [time, turned] = report.assumptions.as_slice() else { panic!("two") };
    assert_eq!(time.rows.iter().map(|row| row.value).collect::<Vec<_>>(), [-20.0, 0.0, 20.0]);
    assert_eq!(time.rows[1], turned.rows[1]);
    assert!(report.turntable && time.rows.iter().all(|row| row.states > 10 && row.about_axis_rms_deg.is_some()));
    let page = bench.read("vary.html");
    assert!(page.contains("near.time_offset_ms") && page.contains("<svg") && !page.contains("NaN"));
    for (wrong, told) in
        [("time=-1..1", "KEY one of"), ("far.time_offset_ms=-1..1", "the config's sensors are near, front")]
    {
        let done = bench.run(&["replay", "out/capture.mcap", "--config", "out/rig.toml", "--vary", wrong]);
        assert!(done.code == 2 && done.stderr.contains(told), "{}", done.stderr);
    }
}
