//! `tumbled campaign` of kind `pose` and `tumbled experiment pose`: the same figures on any number of threads, exit codes,
//! and what is refused.

use tumbled::cli::replay::ReplayReport;
use tumbled::experiment::campaign::pose::PoseCampaignReport;
use tumbled::experiment::campaign::pose::figure::PoseFigure;
use tumbled::experiment::campaign::pose::trial::PoseTrial;
use tumbled::experiment::pose::PoseExperimentReport;

use crate::support::Workbench;

/// Two scenes of three seconds, one with both sensors, one with the Kinect alone: it is acquired within the first second.
const CAMPAIGN: &str = r#"
kind = "pose"
name = "small"
about = "a test"
seed = 5
[[config]]
id = "fused"
[[config]]
id = "kinect"
sensors = "kinect"
set = ["filter.motion=fixed-axis"]
[[scene]]
id = "turns"
scene = "turntable-20dps"
seeds = 1
duration_s = 3.0
configs = ["fused", "kinect"]
[scene.interval]
all = {}
end = { from_s = 2.0, until_s = 2.5 }
[[scene]]
id = "blind"
scene = "turntable-20dps"
seeds = 1
duration_s = 2.0
configs = ["kinect"]
change = { lidar_rpm = 1200, fault = [{ sensor = "near", from_s = 0.5, action = "unplug" }] }
[scene.interval]
all = {}
[[claim]]
about = "turns"
runs = ["turns/fused"]
interval = "all"
figure = "attitude_deg"
must = { at_most = 10.0 }
[[claim]]
about = "turns, against the Kinect"
runs = ["turns/fused"]
interval = "all"
figure = "attitude_deg"
against = { runs = ["turns/kinect"] }
must = { at_least = 0.0 }
"#;

fn trials(text: &str) -> Vec<PoseTrial> {
    text.lines().map(|line| serde_json::from_str(line).expect("a trial")).collect()
}

#[test]
fn a_pose_campaign_has_the_same_figures_on_one_thread_and_on_two_and_replays_what_replay_does() {
    let bench = Workbench::new();
    bench.file("small.toml", CAMPAIGN);
    let run = |folder: &str, threads: &str| {
        let done = bench.run(&["campaign", "small.toml", "-o", folder, "--threads", threads, "--json"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done
    };
    let (one, two) = (run("one", "1"), run("two", "2"));
    let report: PoseCampaignReport = one.json();
    assert_eq!(report, two.json());
    assert_eq!(bench.read("one/campaign.json"), one.stdout);
    assert!(report.holds && report.whole && report.claims.iter().all(|claim| claim.value.is_some()));
    // Two configs over two intervals, and one over one.
    let found = trials(&bench.read("one/trials.jsonl"));
    assert_eq!((report.rows.len(), found.len()), (5, 5));
    assert_eq!(found, trials(&bench.read("two/trials.jsonl")));
    // The states are those of a replay, to the bit.
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "sim", "--duration", "3s", "--seed", "5"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let replay: ReplayReport = bench.run(&["replay", "sim/capture.mcap", "--config", "sim/rig.toml", "--json"]).json();
    let fused = found.iter().find(|trial| trial.config == "fused" && trial.interval == "all").expect("a trial");
    assert_eq!((&fused.digest, fused.epochs), (&replay.digest, replay.checkpoint.epochs));
    // 0.5 s of 30 frames and of 10 crossings a second, an epoch more or less at either end.
    let end = found.iter().find(|trial| trial.config == "fused" && trial.interval == "end").expect("a trial");
    assert!((18..=22).contains(&end.tracked.of), "{end:?}");
    // A Kinect that is unplugged before anything was acquired: nothing is scored, and its figures are none.
    let blind = found.iter().find(|trial| trial.scene == "blind").expect("a trial");
    assert!(blind.errors.is_none() && blind.unscored.is_some() && blind.acquired_s.is_none());
    let row = report.rows.iter().find(|row| row.scene == "blind").expect("a row");
    assert!(row.figures.iter().any(|found| found.figure == PoseFigure::AttitudeDeg && found.value.is_none()));
    assert!(bench.read("one/campaign.md").contains("| turns | attitude |"));
    assert!(bench.read("one/campaign.html").contains("<svg"));
}

#[test]
fn a_pose_campaign_ends_with_3_where_something_does_not_hold() {
    let bench = Workbench::new();
    bench.file("misses.toml", CAMPAIGN.replace("at_most = 10.0", "at_most = 1e-9"));
    let done = bench.run(&["campaign", "misses.toml", "-o", "out", "--seeds", "1"]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    assert!(done.stdout.contains("MISSED") && done.stdout.contains("rehearsal"), "{}", done.stdout);
}

#[test]
fn what_is_wrong_with_a_pose_campaign_is_told_before_anything_is_measured() {
    let bench = Workbench::new();
    let refused = |text: String, expected: &[&str]| {
        bench.file("wrong.toml", text);
        let done = bench.run(&["campaign", "wrong.toml", "-o", "out"]);
        assert_eq!(done.code, 2, "{}", done.stderr);
        assert!(
            expected.iter().all(|part| done.stderr.contains(part)) && !bench.path("out").exists(),
            "{}",
            done.stderr
        );
    };
    let with = |from: &str, to: &str| CAMPAIGN.replacen(from, to, 1);
    refused(with("seeds = 1", "seeds = 0"), &["wrong.toml", "scene turns", "seeds = 0"]);
    refused(with("\"turntable-20dps\"", "\"no-such\""), &["no-such"]);
    refused(with("\"fused\", \"kinect\"", "\"fused\", \"both\""), &["scene turns", "no config both", "fused, kinect"]);
    refused(with("runs = [\"turns/fused\"]", "runs = [\"turns/lidar\"]"), &["claim `turns`", "turns/lidar"]);
    refused(with("interval = \"all\"", "interval = \"late\""), &["no interval late"]);
    refused(with("figure = \"attitude_deg\"", "figure = \"luck\""), &["wrong.toml", "luck"]);
    refused(with("filter.motion=fixed-axis", "filter.motoin=fixed-axis"), &["filter.motoin"]);
    refused(with("lidar_rpm = 1200", "mean_motion_rps = 0.1"), &["blind", "tumbles"]);
    let done = bench.run(&["campaign", "pose", "-o", "out", "--pairs", "3"]);
    assert_eq!(done.code, 2);
    assert!(done.stderr.contains("--pairs is of a campaign of registration"), "{}", done.stderr);
}

#[test]
fn the_programs_own_pose_campaign_can_be_run_and_has_the_seeds_that_figures_need() {
    use tumbled::experiment::campaign::Campaign;
    let Ok(Campaign::Pose(file)) = Campaign::read(std::path::Path::new("pose")) else { panic!("a pose campaign") };
    file.rehearse().expect("scenes and configs that are some");
    assert!(file.scene.iter().all(|scene| scene.seeds >= 10), "ten at least");
    // What is said of uncertainty is of thirty.
    let of = |figure: PoseFigure| file.claim.iter().find(|claim| claim.figure == figure).expect("a claim");
    let scene = of(PoseFigure::NeesKnownFrame).runs[0].split_once('/').expect("scene/config").0.to_owned();
    assert!(file.scene.iter().any(|entry| entry.id == scene && entry.seeds >= 30));
}

#[test]
fn a_turned_target_is_told_at_its_rests() {
    let bench = Workbench::new();
    let arguments = ["--rests", "2", "--sensors", "vlp-32c", "--axis", "z", "--method", "kinect,gicp-chain"];
    let done = bench.run(&[&["experiment", "pose", "-o", "out", "--json"], &arguments[..]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: PoseExperimentReport = done.json();
    assert_eq!(bench.read("out/report.json"), done.stdout);
    assert_eq!((report.rows.len(), report.rests_by.as_str()), (2, "scene"));
    let kinect = &report.rows[0];
    assert_eq!((kinect.rests, kinect.posed), (2, 2));
    // One step of 22.5°, about which a Kinect is right to a few degrees even while its model is made.
    let step = kinect.at[1].step_deg.expect("a step");
    assert!(
        (step - 22.5).abs() < 3.0 && (kinect.at[1].true_step_deg.expect("truth") - 22.5).abs() < 0.01,
        "{kinect:?}"
    );
    assert!(bench.read("out/report.html").contains("gicp-chain"));
    let wrong = bench.run(&["experiment", "pose", "--axis", "w"]);
    assert_eq!(wrong.code, 2);
    assert!(wrong.stderr.contains("x, y or z"), "{}", wrong.stderr);
}

#[test]
fn the_rests_of_a_recording_are_its_turntables() {
    let bench = Workbench::new();
    let scene =
        include_str!("../config/scenes/turntable-20dps.toml").replace("duration_s = 60.0", "duration_s = 4.5").replace(
            "{ kind = \"constant\", rate_dps = 20.0 }",
            "{ kind = \"steps\", step_deg = 22.5, rest_s = 1.5, move_s = 1.5, ramp_s = 0.1, count = 1 }",
        );
    bench.file("steps.toml", scene);
    let done = bench.run(&["experiment", "pose", "--from", "sim:steps.toml", "--method", "kinect", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: PoseExperimentReport = done.json();
    let row = &report.rows[0];
    assert!(report.rests_by.starts_with("turntable"), "{}", report.rests_by);
    assert_eq!((row.rests, row.attitude_deg, row.axis_deg), (2, None, None));
    // The encoder's own step, 768 000 counts a turn.
    assert!((row.at[1].true_step_deg.expect("an encoder") - 22.5).abs() < 0.01, "{row:?}");
    assert!(row.step_deg.expect("a step").max < 3.0, "{row:?}");
}
