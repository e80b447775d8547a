//! Figures of `calibrate extrinsic` over seeds: random poses, simulated to the byte, decoded, calibrated, held against the truth.

use nalgebra::{Isometry3, Matrix3, SVector, UnitQuaternion, Vector3};
use tumbled::simulation::scenes;
use tumbled_calib::board::BoardSize;
use tumbled_calib::fit::{PARAMETERS, difference};
use tumbled_calib::{CameraView, Extrinsic, LidarPoint, Status, View, board, sphere};
use tumbled_kinect::{BackProjector, DepthImage, DepthTable, Intrinsics, NoiseModel, Points, ZeroPlane, decode_metres};
use tumbled_model::{DepthEncoding, PacketMask, RigNs, Span};
use tumbled_sim::noise::Noise;
use tumbled_sim::scene::{Scene, SceneConfig, SceneMotion, Transform};
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};

/// Frames and turns of a pose, a part of the second that is advised.
const FRAMES: i64 = 10;
const TURNS: i64 = 10;
const TURN: Span = Span(100_000_000);
/// The drawing's error: what an operator's tape measure leaves, rad and m by axis.
const DRAWN: (f64, f64) = (0.02, 0.02);

/// A row of the acceptance table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) sphere: bool,
    pub(crate) poses: usize,
    pub(crate) lidar_bias_m: f64,
    pub(crate) warp_m: f64,
    pub(crate) depth_scale: f64,
}

pub(crate) const BOARD: Row =
    Row { name: "board, 12 poses", sphere: false, poses: 12, lidar_bias_m: 0.0, warp_m: 0.0, depth_scale: 1.0 };
const SPHERE: Row = Row { name: "sphere, 15 poses", sphere: true, poses: 15, ..BOARD };

/// What one seed gave.
struct Trial {
    rotation_deg: f64,
    translation_mm: f64,
    scale: f64,
    /// Squared error over the covariance, by parameter count.
    nees: f64,
    /// Parameters within three standard deviations, of how many.
    within: (usize, usize),
    status: Status,
    used: usize,
}

fn pose(row: &Row, noise: &mut Noise) -> ([f64; 3], [f64; 3]) {
    let mut between = |low: f64, high: f64| low + (high - low) * noise.uniform();
    let x = between(1.3, 2.6);
    // Within what both see, about the Kinect's own height and side, of its 58 by 45 degrees: of a board half; of a sphere, whose
    // places have to be spread as the gates ask, 48 by 37 less its radius and a little.
    let (wide, high) =
        if row.sphere { (0.45 * x - 0.28, 0.33 * x - 0.28) } else { (0.28 * (x - 0.6), 0.18 * (x - 0.6)) };
    let at = [x, 0.3 + between(-wide, wide), between(-high, high)];
    let turned = if row.sphere { [0.0; 3] } else { [between(-20.0, 20.0), between(-45.0, 45.0), between(-45.0, 45.0)] };
    (at, turned)
}

/// The spread of places across the line that they are nearest to, m.
fn second_spread_m(places: impl Iterator<Item = Vector3<f64>> + Clone) -> f64 {
    let count = places.clone().count() as f64;
    let middle = places.clone().sum::<Vector3<f64>>() / count;
    let scatter: Matrix3<f64> = places.map(|place| (place - middle) * (place - middle).transpose()).sum();
    let mut spreads: [f64; 3] = (scatter / count).symmetric_eigenvalues().map(|value| value.max(0.0).sqrt()).into();
    spreads.sort_by(f64::total_cmp);
    spreads[1]
}

/// A scene of a row with random poses.
pub(crate) fn scene(row: &Row, seed: u64) -> Scene {
    let name = if row.sphere { "calibration-sphere" } else { "calibration-board" };
    let change = |config: &mut SceneConfig| {
        config.seed = seed;
        config.lidar[0].parameters.beam_bias_sigma_m = row.lidar_bias_m;
        // Only what the Kinect may see is made.
        config.lidar[0].view = tumbled_sim::lidar::View::Sector { from_deg: 315.0, to_deg: 405.0 };
        config.kinect[0].parameters.warp_m = row.warp_m;
        config.kinect[0].parameters.depth_scale = row.depth_scale;
        let mut noise = Noise::new(seed, "calibration.poses", 0);
        let SceneMotion::Poses { poses, .. } = &mut config.motion else { panic!("a scene of poses") };
        loop {
            *poses = (0..row.poses)
                .map(|_| {
                    let (at_m, turned_deg) = pose(row, &mut noise);
                    tumbled_sim::scene::ScenePose { at_m, turned_deg }
                })
                .collect();
            // Places near one line are refused, which a test of its own shows: an operator would have spread them.
            if !row.sphere || second_spread_m(poses.iter().map(|pose| pose.at_m.into())) > 0.27 {
                break;
            }
        }
        config.duration_s = 3.5 * row.poses as f64;
    };
    scenes::load_changed(name, change).expect("a scene")
}

/// What the sensors see in a rest, through bytes and decoders.
fn view(scene: &Scene, middle: RigNs, pose: u64, t_lidar_kinect: &Isometry3<f64>) -> View {
    let seed = scene.config.seed;
    let table = DepthTable::from_law(&ZeroPlane::default());
    let projector = BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("a camera");
    let (mut depth, mut points) = (DepthImage::new(), Points::new());
    let mut sums = vec![([0.0; 3], 0_u32); 320 * 240];
    for n in 0..FRAMES {
        let t = middle + Span(33_333_333 * (n - FRAMES / 2));
        let frame = scene.kinects[0].model.frame(&scene.world, t, pose * 100 + n as u64, seed);
        let bytes = frame.packed().expect("eleven bits");
        decode_metres(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &table, &mut depth).expect("a frame");
        projector.points(&depth, &mut points);
        for (n, pixel) in points.pixel().iter().enumerate() {
            let (column, row) = (*pixel as usize % 640, *pixel as usize / 640);
            if column % 2 == 0 && row % 2 == 0 {
                let (sum, count) = &mut sums[row / 2 * 320 + column / 2];
                for (sum, value) in sum.iter_mut().zip([points.x()[n], points.y()[n], points.z()[n]]) {
                    *sum += f64::from(value);
                }
                *count += 1;
            }
        }
    }
    let mean = |(sum, count): ([f64; 3], u32)| {
        if 2 * i64::from(count) >= FRAMES { sum.map(|sum| (sum / f64::from(count)) as f32) } else { [f32::NAN; 3] }
    };
    let camera = CameraView { width: 320, height: 240, points: sums.into_iter().map(mean).collect() };
    let head = &scene.lidars[0].model;
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut decoded = Decoded::default();
    let from = middle - Span(TURN.0 * TURNS / 2);
    for index in head.first_packet_at(from)..head.first_packet_at(from + Span(TURN.0 * TURNS)) {
        let packet = head.packet(&scene.world, index, seed);
        decoder.push(&packet.bytes, packet.end, &mut decoded);
    }
    decoder.finish(&mut decoded);
    let t_kinect_lidar = t_lidar_kinect.inverse();
    let in_sight = |xyz: [f32; 3]| {
        let p = t_kinect_lidar * nalgebra::Point3::from(xyz.map(f64::from));
        p.z > 0.2 && p.z < 4.5 && (p.x / p.z).abs() < 0.75 && (p.y / p.z).abs() < 0.6
    };
    let lidar = decoded
        .points
        .iter_range(0..decoded.points.len())
        .filter(|point| in_sight(point.xyz))
        .map(|point| LidarPoint { xyz: point.xyz, ring: point.ring })
        .collect();
    View { camera, lidar }
}

/// What both sensors see in every rest.
pub(crate) fn views(scene: &Scene, start: &Isometry3<f64>) -> Vec<View> {
    let rests = scene.rests();
    (0..).zip(&rests).map(|(n, rest)| view(scene, rest.from + Span(1_000_000_000), n, start)).collect()
}

/// The Kinect in the LiDAR's frame: truly, and as the drawing has it.
pub(crate) fn places(scene: &Scene) -> (Isometry3<f64>, Isometry3<f64>) {
    let isometry = |transform: &Transform| transform.isometry();
    let truth = isometry(&scene.config.lidar[0].t_rig_lidar).inverse() * isometry(&scene.config.kinect[0].t_rig_kinect);
    let mut noise = Noise::new(scene.config.seed, "calibration.drawing", 0);
    let mut three = |size: f64| Vector3::new(noise.normal(), noise.normal(), noise.normal()) * size;
    let off = UnitQuaternion::from_scaled_axis(three(DRAWN.0));
    let start = Isometry3::from_parts((truth.translation.vector + three(DRAWN.1)).into(), off * truth.rotation);
    (truth, start)
}

fn trial(row: &Row, seed: u64) -> Trial {
    let scene = scene(row, seed);
    let (truth, start) = places(&scene);
    let views = views(&scene, &start);
    let found = if row.sphere {
        sphere::calibrate(&views, 0.25, &start)
    } else {
        board::calibrate(&views, &BoardSize::new(0.8, 0.6), &start)
    };
    score(&found, &truth, 1.0 / row.depth_scale)
}

fn score(found: &Extrinsic, truth: &Isometry3<f64>, scale: f64) -> Trial {
    for gate in found.gates.iter().filter(|gate| gate.status > Status::Pass) {
        println!("not passed: {gate:?}");
    }
    let fit = found.fit().unwrap_or_else(|| panic!("{:?} {:?}", found.gates, found.poses));
    let error: SVector<f64, PARAMETERS> =
        difference(&fit.t_lidar_camera, truth, fit.depth_scale.map_or(0.0, |found| found - scale));
    let sigma = fit.sigma();
    let parameters = if fit.depth_scale.is_some() { 7 } else { 6 };
    let of_six = fit.covariance.fixed_view::<6, 6>(0, 0).try_inverse().expect("positive");
    let six = error.fixed_rows::<6>(0);
    Trial {
        rotation_deg: error.fixed_rows::<3>(0).norm().to_degrees(),
        translation_mm: 1e3 * error.fixed_rows::<3>(3).norm(),
        scale: error[6],
        nees: six.dot(&(of_six * six)) / 6.0,
        within: ((0..parameters).filter(|n| error[*n].abs() <= 3.0 * sigma[*n]).count(), parameters),
        status: Status::worst(found.gates.iter().map(|gate| gate.status)),
        used: found.agreement.as_ref().map_or(0, |agreement| agreement.used.len()),
    }
}

/// Median and largest.
pub(crate) fn spread(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    (0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2]), values[values.len() - 1])
}

fn run(row: &Row, seeds: std::ops::Range<u64>) -> Vec<Trial> {
    let trials: Vec<Trial> = seeds.map(|seed| trial(row, seed)).collect();
    let (degrees, mm) =
        (spread(trials.iter().map(|t| t.rotation_deg)), spread(trials.iter().map(|t| t.translation_mm)));
    let scale = spread(trials.iter().map(|t| t.scale.abs()));
    let within = trials.iter().fold((0, 0), |(a, b), t| (a + t.within.0, b + t.within.1));
    let nees = trials.iter().map(|t| t.nees).sum::<f64>() / trials.len() as f64;
    let of = |status| trials.iter().filter(|t| t.status == status).count();
    println!(
        "{}: N {}, rotation {:.3}/{:.3} deg, translation {:.2}/{:.2} mm (median/worst), scale {:.5}/{:.5}, NEES/dof {nees:.2}, \
         within 3 sigma {}/{}, pass/warn/fail {}/{}/{}, poses used at least {}",
        row.name,
        trials.len(),
        degrees.0,
        degrees.1,
        mm.0,
        mm.1,
        scale.0,
        scale.1,
        within.0,
        within.1,
        of(Status::Pass),
        of(Status::Warn),
        of(Status::Fail),
        trials.iter().map(|t| t.used).min().unwrap_or(0)
    );
    trials
}

/// What the worst of twenty may be.
fn are_within_the_worst(trials: &[Trial]) {
    for trial in trials {
        assert!(
            trial.rotation_deg < 0.4 && trial.translation_mm < 8.0,
            "{} {}",
            trial.rotation_deg,
            trial.translation_mm
        );
        assert!(trial.status < Status::Fail);
    }
}

#[test]
#[ignore = "twenty seconds: .ci/long calibration"]
fn a_board_in_twelve_random_poses_gives_the_kinects_place() {
    are_within_the_worst(&run(&BOARD, 1..3));
}

#[test]
#[ignore = "twenty seconds: .ci/long calibration"]
fn a_sphere_in_fifteen_random_places_gives_the_kinects_place() {
    are_within_the_worst(&run(&SPHERE, 1..2));
}

/// Seeds of the acceptance table: `cargo test --test main -- --ignored --nocapture calibrate_figures`.
const SEEDS: std::ops::Range<u64> = 1..21;

#[test]
#[ignore = "minutes: the acceptance table of docs/calibration.md"]
fn twenty_boards_are_within_the_accepted_figures() {
    let trials = run(&BOARD, SEEDS);
    let (degrees, mm) =
        (spread(trials.iter().map(|t| t.rotation_deg)), spread(trials.iter().map(|t| t.translation_mm)));
    assert!(degrees.0 <= 0.15 && mm.0 <= 4.0 && degrees.1 <= 0.4 && mm.1 <= 8.0, "{degrees:?} {mm:?}");
}

#[test]
#[ignore = "minutes: the acceptance table of docs/calibration.md"]
fn twenty_spheres_are_within_the_accepted_figures() {
    let trials = run(&SPHERE, SEEDS);
    let (degrees, mm) =
        (spread(trials.iter().map(|t| t.rotation_deg)), spread(trials.iter().map(|t| t.translation_mm)));
    assert!(degrees.0 <= 0.10 && mm.0 <= 3.0, "{degrees:?} {mm:?}");
}

/// Rows that are reported beside: beam biases, a wrong depth scale, a warped depth.
#[test]
#[ignore = "minutes: the rows beside the acceptance table of docs/calibration.md"]
fn harder_rows_have_results_that_may_be_used() {
    for row in reported() {
        let trials = run(&row, SEEDS);
        assert!(trials.iter().all(|trial| trial.status < Status::Fail), "{}", row.name);
    }
}

fn reported() -> [Row; 6] {
    [
        Row { name: "board, beam bias 10 mm", lidar_bias_m: 0.01, ..BOARD },
        Row { name: "sphere, beam bias 10 mm", lidar_bias_m: 0.01, ..SPHERE },
        Row { name: "board, depth scale 1 %, no warp", depth_scale: 1.01, ..BOARD },
        Row { name: "board, depth scale 1 %, warp 5 mm", depth_scale: 1.01, warp_m: 0.005, ..BOARD },
        Row { name: "board, warp 5 mm", warp_m: 0.005, ..BOARD },
        Row { name: "sphere, warp 5 mm", warp_m: 0.005, ..SPHERE },
    ]
}
