//! With the true offsets of a simulated rig the core's times are the true ones.

use std::path::Path;

use tumbled::cli::VERSION;
use tumbled::config::{Recorded, load_recorded};
use tumbled::session::{Engine, engine, setup};
use tumbled::simulation::{SimulatedLedger, rig, scenes};
use tumbled_core::{Epoch, Scan};
use tumbled_model::RigNs;
use tumbled_sim::scene::{Scene, SceneConfig};

/// The accuracy scene with a change to its keys.
fn scene(change: impl FnOnce(&mut SceneConfig)) -> Scene {
    let mut config = scenes::load("turntable-20dps").expect("a scene").config;
    config.duration_s = 10.0;
    change(&mut config);
    Scene::build(config).expect("a scene")
}

/// All epochs of a scene, read with the truth of its rig.
fn epochs(scene: Scene) -> Vec<Epoch> {
    let loaded = rig::operators(&scene, Path::new("rig.toml"), &[]).expect("a config");
    let mut header = rig::header(&scene, &loaded, VERSION);
    header.config = rig::toml(&scene, rig::View::Truth);
    let config = load_recorded(Recorded { path: "rig-true.toml".into(), header }, &[]).expect("a config").config;
    let core = setup::core_config(&config).expect("a core");
    let workers = engine::workers(1).expect("threads");
    let mut engine = Engine::new(core, String::new(), workers, engine::interpreter(&config, false));
    let mut epochs = Vec::new();
    for event in SimulatedLedger::new(scene, None) {
        epochs.extend(engine.step(&event).outputs.epochs.iter().cloned());
    }
    epochs.extend(engine.finish().outputs.epochs.iter().cloned());
    epochs
}

/// Mean of what times are late by after the first seconds, µs.
fn mean_late_us(times: impl Iterator<Item = (RigNs, RigNs)>) -> f64 {
    let late: Vec<f64> =
        times.filter(|(t, _)| t.0 > 4_000_000_000).map(|(t, truth)| (t - truth).as_secs_f64() * 1e6).collect();
    assert!(late.len() > 50, "{}", late.len());
    late.iter().sum::<f64>() / late.len() as f64
}

#[test]
fn a_lidars_epochs_are_when_its_head_passed_the_target_whatever_the_model_and_the_returns() {
    for (model, returns) in [
        ("vlp-32c", "strongest"),
        ("vlp-32c", "dual"),
        ("vlp-16", "strongest"),
        ("vlp-16", "dual"),
        ("hdl-64e", "strongest"),
        ("hdl-64e", "dual"),
    ] {
        let scene = scene(|config| {
            config.kinect.clear();
            config.lidar[0].model = model.to_owned();
            config.lidar[0].returns = returns.to_owned();
        });
        let clock = scene.config.lidar[0].clock.clone();
        // The target is on the x axis, which the head passes ten times a second of its own clock, first at 0.
        let passes = |t: RigNs| {
            let turns = (clock.oscillator_ns(t) + 50_000_000).div_euclid(100_000_000);
            clock.instant(turns * 100_000_000)
        };
        let epochs = epochs(scene);
        assert!(epochs.iter().all(|epoch| matches!(epoch.scan, Scan::Lidar(_)) && !epoch.scan.is_empty()));
        let late_us = mean_late_us(epochs.iter().map(|epoch| (epoch.t, passes(epoch.t))));
        assert!(late_us.abs() < 50.0, "{model} {returns}: {late_us} us");
    }
}
