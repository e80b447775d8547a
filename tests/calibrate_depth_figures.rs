//! Figures of `calibrate kinect` over seeds: a scaled and warped depth, simulated to the byte, calibrated, held against the truth.

use nalgebra::Isometry3;
use tumbled::calibration::camera::KinectCamera;
use tumbled_calib::Status;
use tumbled_calib::board::BoardSize;
use tumbled_calib::depth_camera::{Camera, DepthCalibration, calibrate};
use tumbled_calib::fit::difference;
use tumbled_kinect::Intrinsics;
use tumbled_model::RigNs;
use tumbled_sim::scene::Scene;

use crate::calibrate_figures::{BOARD, Row, places, scene, spread, views};

const WARPED: Row = Row { name: "depth scale 1 %, warp 5 mm", depth_scale: 1.01, warp_m: 0.005, ..BOARD };

/// What one seed gave.
struct Trial {
    rotation_deg: f64,
    translation_mm: f64,
    /// The solved scale off the true one, a share: of whole depths at 2 m, scale and surface together.
    scale: f64,
    /// Of depths at 2 m where boards were seen: before and after, mm, root mean square, and the worst after.
    before_mm: f64,
    after_mm: f64,
    worst_mm: f64,
    status: Status,
}

fn trial(row: &Row, seed: u64) -> (Trial, DepthCalibration) {
    let scene = scene(row, seed);
    let (truth, start) = places(&scene);
    let views = views(&scene, &start);
    let seconds: Vec<f64> = scene.rests().iter().map(|rest| rest.from.0 as f64 * 1e-9).collect();
    let camera = KinectCamera::new(Intrinsics::default());
    let begun = std::time::Instant::now();
    let done = calibrate(&views, &seconds, &BoardSize::new(0.8, 0.6), &start, &camera);
    println!("seed {seed}: solved in {:.1} s", begun.elapsed().as_secs_f64());
    (score(&done, &truth, &scene, &camera), done)
}

fn score(done: &DepthCalibration, truth: &Isometry3<f64>, scene: &Scene, camera: &KinectCamera) -> Trial {
    for tried in &done.tried {
        println!("  {}: cost {:.0}, criterion {:.0}", tried.model.name(), tried.cost, tried.criterion);
    }
    for gate in done.gates.iter().filter(|gate| gate.status > Status::Pass) {
        println!("  not passed: {gate:?}");
    }
    let found = done.found.as_ref().unwrap_or_else(|| panic!("{:?} {:?}", done.gates, done.poses));
    let error = difference(&found.state.t_lidar_camera, truth, 0.0);
    let device = &scene.kinects[0].model;
    let middle = RigNs(scene.rests()[scene.rests().len() / 2].from.0);
    let scale = scene.config.kinect[0].parameters.depth_scale;
    let (mut before, mut after, mut worst, mut count) = (0.0, 0.0, 0.0_f64, 0.0);
    // Depths at 1.5, 2 and 2.5 m in the cells where boards were seen.
    for (cell, _) in found.maps.1.cells_mm.iter().enumerate().filter(|(_, mm)| mm.is_some()) {
        let (u, v) = (cell % 16 * 40 + 20, cell / 16 * 40 + 20);
        for z in [1.5, 2.0, 2.5] {
            let measured = scale * z + device.warp_m(middle, scene.config.seed, u, v);
            let corrected = found.state.depth(measured, &camera.terms(u as f64, v as f64));
            let (off, was) = (1e3 * (corrected - z), 1e3 * (measured - z));
            (before, after, count) = (before + was * was, after + off * off, count + 1.0);
            worst = worst.max(off.abs());
        }
    }
    let trial = Trial {
        rotation_deg: error.fixed_rows::<3>(0).norm().to_degrees(),
        translation_mm: 1e3 * error.fixed_rows::<3>(3).norm(),
        scale: found.state.depth_scale * scale - 1.0,
        before_mm: f64::sqrt(before / count),
        after_mm: f64::sqrt(after / count),
        worst_mm: worst,
        status: Status::worst(done.gates.iter().map(|gate| gate.status)),
    };
    println!(
        "  {}: {:.3} deg {:.2} mm, scale {:.5} (sigma {:?}), depths {:.1} -> {:.2} mm (worst {:.2}), held out {:?} -> {:?}, noise {:?}, \
         drift {:?}, lens {:?}, edge {:.2?}",
        found.model.name(),
        trial.rotation_deg,
        trial.translation_mm,
        trial.scale,
        found.sigma[6],
        trial.before_mm,
        trial.after_mm,
        trial.worst_mm,
        found.maps.0.rms_mm(),
        found.maps.1.rms_mm(),
        found.noise,
        found.drift,
        found.state.lens,
        found.state.edge_px
    );
    println!("  sigma {:?}", found.sigma);
    trial
}

fn run(row: &Row, seeds: std::ops::Range<u64>) -> Vec<Trial> {
    let (accepted, refused): (Vec<Trial>, Vec<Trial>) =
        seeds.map(|seed| trial(row, seed).0).partition(|trial| trial.status < Status::Fail);
    let of = |value: &dyn Fn(&Trial) -> f64| spread(accepted.iter().map(value));
    println!(
        "{}: {} accepted, {} refused; rotation {:.3?} deg, translation {:.2?} mm, scale {:.5?}, depths {:.2?} -> {:.2?} mm, worst \
         {:.2?} (median, worst)",
        row.name,
        accepted.len(),
        refused.len(),
        of(&|t| t.rotation_deg),
        of(&|t| t.translation_mm),
        of(&|t| t.scale.abs()),
        of(&|t| t.before_mm),
        of(&|t| t.after_mm),
        of(&|t| t.worst_mm)
    );
    accepted
}

#[test]
#[ignore = "minutes: the table of docs/calibration-kinect.md"]
fn cameras_that_are_accepted_are_within_the_figures_asked_for() {
    // Boards in random poses: some sets are refused, because their normals do not fix the place.
    let trials = run(&WARPED, 101..121);
    assert!(trials.len() >= 16, "{}", trials.len());
    let of = |value: &dyn Fn(&Trial) -> f64| spread(trials.iter().map(value));
    let (degrees, mm) = (of(&|t| t.rotation_deg), of(&|t| t.translation_mm));
    assert!(degrees.0 <= 0.225 && mm.0 <= 6.0 && degrees.1 <= 0.6 && mm.1 <= 12.0, "{degrees:?} {mm:?}");
    let (scale, left) = (of(&|t| t.scale.abs()), of(&|t| t.after_mm));
    assert!(scale.1 <= 0.001 && left.1 <= 2.0, "{scale:?} {left:?}");
    assert!(trials.iter().all(|trial| trial.before_mm > 15.0));
}
