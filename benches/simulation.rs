//! Time a second of a whole simulated session takes: every packet, frame and tick, in the order a host has them.
//!
//! `cargo bench --bench simulation`. Each sample simulates one second of the demo's rig (VLP-32C at 600 rpm, Kinect at 30 Hz, a
//! target that turns): with nothing around it, and in a room with a stage under it and a person who walks by. A sample of
//! 250 ms is four times as fast as the rig. The argument is the number of threads.

use std::sync::Arc;

use divan::Bencher;
use tumbled::simulation::SimulatedLedger;
use tumbled_model::{Body, Event};
use tumbled_sim::scene::{Scene, SceneConfig};

fn main() {
    divan::main();
}

const DEMO: &str = include_str!("../config/scenes/demo.toml");

/// Eight by six metres, and a way between the target and the wall behind it.
const ROOM: &str = r#"
[room]
floor_m = [2.0, 0.0, -1.2]
size_m = [8.0, 6.0, 3.0]
stage_radius_m = 0.3

[intruder]
points_m = [[3.4, -1.5, -1.2], [3.4, 1.5, -1.2]]
speed_mps = 1.0
begins_s = 0.0
"#;

fn bench(bencher: Bencher<'_, '_>, text: &str, threads: usize) {
    let config: SceneConfig = toml::from_str(text).expect("keys of a scene");
    let scene = Scene::build(SceneConfig { duration_s: 1.0, ..config }).expect("a scene");
    let pool = (threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads"));
    let pool = pool.map(Arc::new);
    let bytes = |event: Event| match event.body {
        Body::LidarPacket { bytes, .. } | Body::DepthFrame { bytes, .. } => bytes.len(),
        _ => 0,
    };
    bencher.bench_local(|| SimulatedLedger::new(scene.clone(), pool.clone()).map(bytes).sum::<usize>());
}

#[divan::bench(args = [1, 2], sample_count = 20, sample_size = 1)]
fn nothing_around(bencher: Bencher<'_, '_>, threads: usize) {
    bench(bencher, DEMO, threads);
}

#[divan::bench(args = [1, 2], sample_count = 20, sample_size = 1)]
fn in_a_room(bencher: Bencher<'_, '_>, threads: usize) {
    bench(bencher, &format!("{DEMO}{ROOM}"), threads);
}
