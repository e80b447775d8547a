//! A live session that was held up goes on with the items that are due, and they are what they would have been.

use std::sync::Arc;
use tumbled_model::{Body, RigNs, SensorId, UnixNs};
use tumbled_sim::scene::{Scene, SceneConfig};
use tumbled_sim::session::{Item, Simulation};
use tumbled_sim::world::Role;

fn config(motion: &str) -> SceneConfig {
    toml::from_str(&format!(
        r#"
            name = "short"
            about = "for a test"
            seed = 3
            duration_s = 0.8
            unix_ns_at_zero = 1_795_341_600_000_000_000
            roi_center_m = [2.0, 0.0, 0.0]
            roi_radius_m = 1.0
            target = {{ shape = "cube" }}
            motion = {motion}
            [[lidar]]
            id = "front"
            model = "vlp-16"
            rpm = 600
            [[kinect]]
            id = "near"
            t_rig_kinect = {{ rotation_xyzw = [-0.5, 0.5, -0.5, 0.5] }}
        "#
    ))
    .expect("a scene")
}

const TURNING: &str = r#"{ kind = "turntable", axis = [0, 0, 1], center_m = [2, 0, 0], profile = { kind = "constant", rate_dps = 90.0 } }"#;
const DRIFTING: &str = r#"{ kind = "tumble", inertia = [1, 2, 3], rates_dps = [5, 0, 20],
    start = { translation_m = [2, 0, 0] }, velocity_mps = [0, 0.1, 0] }"#;

fn of<'a>(items: &'a [Item], sensor: &str) -> Vec<&'a Body> {
    let sensor = SensorId::from(sensor);
    items.iter().map(|item| &item.body).filter(|body| body.sensor() == Some(&sensor)).collect()
}

#[test]
fn what_follows_a_skip_is_what_it_would_have_been() {
    let scene = Arc::new(Scene::build(config(&TURNING.replace('\n', " "))).expect("a scene"));
    let whole: Vec<Item> = Simulation::new(Arc::clone(&scene), None).collect();
    let mut simulation = Simulation::new(scene, None);
    let mut items = vec![simulation.next().expect("an item")];
    assert_eq!(simulation.made(), RigNs(100_000_000));
    simulation.skip_to(RigNs(500_000_000));
    items.extend(simulation);
    // 0.1 s and 0.3 s of 0.8 s are left: of 603 packets (1.327 ms each) and 8 position packets 302 and 4; of 24 frames 12.
    for (sensor, lost) in [("front", 302 + 4), ("near", 12)] {
        let (all, left) = (of(&whole, sensor), of(&items, sensor));
        assert!(all.len().abs_diff(left.len() + lost) <= 1, "{sensor}: {} of {}", left.len(), all.len());
        let mut rest = all.iter();
        assert!(left.iter().all(|body| rest.any(|other| other == body)), "{sensor}: in their order, none other");
        assert!(rest.next().is_none(), "{sensor}: to the end");
    }
}

#[test]
fn an_endless_scene_turns_on_and_starts_over_where_the_target_would_leave() {
    let unix = UnixNs(1_800_000_000_000_000_000);
    let at = |motion: &str, s: f64| {
        let scene = Scene::endless(config(&motion.replace('\n', " ")), None, unix).expect("a scene");
        assert_eq!((scene.unix_at_zero(), scene.duration().0), (unix, 1_000_000_000_000_000));
        scene.world.target(RigNs((s * 1e9) as i64)).expect("a target").t_rig_body
    };
    // 90°/s: after 101 s at 9090 = 25 · 360 + 90 degrees, wherever its 0.8 s would have begun anew.
    let turned = at(TURNING, 101.0).rotation.angle().to_degrees();
    assert!((turned - 90.0).abs() < 1e-6, "{turned}");
    // 101 s = 126 · 0.8 s + 0.2 s, at 0.1 m/s.
    let drifted = at(DRIFTING, 101.0).translation.vector.y;
    assert!((drifted - 0.02).abs() < 1e-6, "{drifted}");
}

#[test]
fn a_stand_goes_with_its_target_when_the_scene_starts_over() {
    // The sphere rests 0.5 s at y = 0, moves for 0.2 s, and stays at y = 1: its 0.8 s are over long before 101 s.
    let text = r#"{ kind = "poses", rest_s = 0.5, move_s = 0.2, poses = [{ at_m = [2, 0, 0] }, { at_m = [2, 1, 0] }] }
        [room]
        floor_m = [2.0, 0.0, -1.2]
        size_m = [6.0, 5.0, 2.8]
        stand_radius_m = 0.02"#;
    let scene = Scene::endless(config(text), None, UnixNs(0)).expect("a scene");
    // 101 s = 126 * 0.8 s + 0.2 s: in the first rest again.
    let t = RigNs(101_000_000_000);
    let at = |role: Role| {
        let body = scene.world.bodies().iter().find(|body| body.role == role).expect("a body");
        body.motion.state(t).t_rig_body.translation.vector.y
    };
    assert_eq!((at(Role::Target), at(Role::Mount)), (0.0, 0.0));
}
