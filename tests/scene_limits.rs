//! What no scene can have is refused by the name of its key, before anything is simulated.

use tumbled_sim::scene::{Scene, SceneConfig};

const SCENE: &str = r#"
name = "short"
about = "for a test"
seed = 3
duration_s = 0.1
unix_ns_at_zero = 1_795_341_600_000_000_000
roi_center_m = [2.0, 0.0, 0.0]
roi_radius_m = 1.0
target = { shape = "cube" }
motion = { kind = "still", pose = { translation_m = [2.0, 0.0, 0.0] } }
[operator]
time_s = 0.002
[room]
floor_m = [2.0, 0.0, -1.2]
size_m = [6.0, 5.0, 2.8]
[intruder]
points_m = [[1.0, 1.0, 0.0], [1.0, 2.0, 0.0]]
speed_mps = 1.0
begins_s = 0.0
[[lidar]]
id = "front"
model = "vlp-16"
rpm = 600
clock = { offset_ns = 5, skew_ppm = 10.0, resets = [{ at_ns = 5, to_ns = 0 }] }
[[kinect]]
id = "near"
latency_s = 0.034
t_rig_kinect = { rotation_xyzw = [-0.5, 0.5, -0.5, 0.5] }
"#;

fn built(text: &str) -> Result<Scene, String> {
    let config: SceneConfig = toml::from_str(text).unwrap_or_else(|error| panic!("{error} in {text}"));
    Scene::build(config).map_err(|error| error.to_string())
}

fn turning(profile: &str) -> String {
    format!(r#"motion = {{ kind = "turntable", axis = [0, 0, 1], center_m = [2, 0, 0], profile = {{ {profile} }} }}"#)
}

#[test]
fn a_key_that_no_scene_can_have_is_named() {
    assert!(built(SCENE).is_ok());
    let motion = SCENE.lines().find(|line| line.starts_with("motion")).expect("a motion");
    let profile = |text: &str| SCENE.replace(motion, &turning(text));
    assert!(built(&profile("kind = \"constant\", rate_dps = 5.0")).is_ok());
    let one = |from: &str, to: &str| {
        assert!(SCENE.contains(from), "{from}");
        SCENE.replace(from, to)
    };
    let cases = [
        (one("name = \"short\"", "name = \"\""), "name is \"\": expected one of a line"),
        (one("for a test", "two\\nlines"), "about is"),
        (one("id = \"near\"", "id = \"front\""), "kinect.id is \"front\""),
        (one("id = \"near\"", "id = \"turntable\""), "kinect.id is \"turntable\""),
        (one("duration_s = 0.1", "duration_s = 0.0"), "duration_s is 0: expected more than 0"),
        (one("1_795_341_600_000_000_000", "9_223_372_036_854_775_807"), "unix_ns_at_zero is"),
        (one("unix_ns_at_zero = ", "unix_ns_at_zero = -"), "unix_ns_at_zero is -"),
        (one("roi_center_m = [2.0", "roi_center_m = [nan"), "roi_center_m is NaN"),
        (one("roi_radius_m = 1.0", "roi_radius_m = -1.0"), "roi_radius_m is -1: expected more than 0"),
        (one("pose = { translation_m = [2.0", "pose = { translation_m = [inf"), "motion.pose.translation_m is inf"),
        (one("time_s = 0.002", "time_s = nan"), "operator.time_s is NaN: expected 0 to 60 s"),
        (one("size_m = [6.0", "size_m = [-6.0"), "room.size_m is -6"),
        (one("points_m = [[1.0, 1.0, 0.0], [1.0, 2.0, 0.0]]", "points_m = []"), "number of intruder.points_m is 0"),
        (one("speed_mps = 1.0", "speed_mps = nan"), "intruder.speed_mps is NaN"),
        (one("skew_ppm = 10.0", "skew_ppm = -1e6"), "clock.skew_ppm is -1000000: expected -10000 to 10000 ppm"),
        (one("resets = [", "resets = [{ at_ns = 9, to_ns = 0 }, "), "clock.resets.at_ns is 5: expected no earlier"),
        (one("latency_s = 0.034", "latency_s = -1.0"), "kinect.latency_s is -1: expected 0 to 10 s"),
        (one("[-0.5, 0.5, -0.5, 0.5]", "[-1.0, 1.0, -1.0, 1.0]"), "length of kinect.t_rig_kinect.rotation_xyzw is 2"),
        (one("[-0.5, 0.5, -0.5, 0.5]", "[nan, 0.5, -0.5, 0.5]"), "length of kinect.t_rig_kinect.rotation_xyzw is NaN"),
        (profile("kind = \"constant\", rate_dps = nan"), "motion.profile.rate_dps is NaN"),
        (
            profile("kind = \"sinusoid\", mean_dps = 0, amplitude_deg = 30, period_s = 0"),
            "motion.profile.period_s is 0",
        ),
        (profile("kind = \"stop_and_go\", rate_dps = 9, stop_s = 0, go_s = 0, ramp_s = 0"), "motion.profile.go_s is 0"),
    ];
    for (text, expected) in cases {
        let error = built(&text).expect_err(expected);
        assert!(error.contains(expected), "{error:?} and not {expected:?}");
    }
}
