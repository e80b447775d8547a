//! What the sensors of the program's scenes see of their targets, through the decoders.

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::{Isometry3, Point3};
use tumbled_model::{DepthEncoding, PacketMask, RigNs, Span};
use tumbled_sim::motion::poses::Stop;
use tumbled_sim::scene::Scene;
use tumbled_velodyne::stream::{Decoded, StreamDecoder};

use super::rig;
use super::scenes::{self, NAMES};
use crate::config::Config;
use crate::decoding::kinect::Frame;
use crate::decoding::{KinectDecoder, lidar};

/// Points of one frame of the Kinect, and of one crossing of the LiDAR at the same time, rig frame, m.
struct Look {
    kinect: Vec<Point3<f64>>,
    lidar: Vec<Point3<f64>>,
}

/// At 600 rpm the head looks along +x, where the targets are, each tenth of a second.
const TURN: Span = Span(100_000_000);
/// While it turns by 72°.
const REACH: Span = Span(20_000_000);

/// What the first Kinect and the first LiDAR see when the head looks ahead next, cropped as an experiment says, or about
/// the target.
fn look(scene: &Scene, config: &Config, t: RigNs) -> Look {
    let t = RigNs((t.0 / TURN.0 + 1) * TURN.0);
    let seed = scene.config.seed;
    let centre = Point3::from(scene.world.target(t).expect("a target").t_rig_body.translation.vector);
    let radius_m = scene.config.experiment.map_or(scene.surface.radius() + 0.1, |experiment| experiment.crop_radius_m);
    let crop = (centre, radius_m);
    let kinect = &scene.kinects[0];
    // Frames' noise is that of their number.
    let frame = kinect.model.frame(&scene.world, t, (t.0 / 33_333_333) as u64, seed);
    let bytes = frame.packed().expect("codes of eleven bits").into();
    let mut decoder = KinectDecoder::new(&config.kinects[0]).expect("a decoder");
    let lost = &PacketMask::NONE;
    let points =
        decoder.points(Frame { ticks: None, encoding: DepthEncoding::Packed11, lost, bytes: &bytes }).expect("a frame");
    let mounting = scene.config.kinect[0].t_rig_kinect.isometry();
    let seen = points.x().iter().zip(points.y()).zip(points.z()).map(|((x, y), z)| [*x, *y, *z]);
    let kinect = placed(&mounting, crop, seen);

    let head = &scene.lidars[0].model;
    let mut decoder = StreamDecoder::new(lidar::settings(&config.lidars[0]).expect("settings"));
    let mut decoded = Decoded::default();
    for index in head.first_packet_at(t - REACH)..head.first_packet_at(t + REACH) {
        let packet = head.packet(&scene.world, index, seed);
        assert_eq!(decoder.push(&packet.bytes, packet.end, &mut decoded), None);
    }
    decoder.finish(&mut decoded);
    let mounting = scene.config.lidar[0].t_rig_lidar.isometry();
    let points = &decoded.points;
    let seen = points.x.iter().zip(&points.y).zip(&points.z).map(|((x, y), z)| [*x, *y, *z]);
    Look { kinect, lidar: placed(&mounting, crop, seen) }
}

/// Sensor points within reach of the target, in the rig's frame: those of a room are most, and left out first.
fn placed(
    mounting: &Isometry3<f64>,
    (centre, radius_m): (Point3<f64>, f64),
    points: impl Iterator<Item = [f32; 3]>,
) -> Vec<Point3<f64>> {
    let own = mounting.inverse_transform_point(&centre);
    let (cx, cy, cz, reach) = (own.x as f32, own.y as f32, own.z as f32, (radius_m * radius_m) as f32);
    let near = |[x, y, z]: &[f32; 3]| {
        let (dx, dy, dz) = (x - cx, y - cy, z - cz);
        dx * dx + dy * dy + dz * dz <= reach
    };
    points.filter(near).map(|point| mounting * Point3::from(point.map(f64::from))).collect()
}

/// How many of the points lie in the target's own box, 3 cm wider for noise and warp.
fn on_target(scene: &Scene, t: RigNs, points: &[Point3<f64>]) -> usize {
    let pose = scene.world.target(t).expect("a target").t_rig_body;
    let [low, high] = scene.surface.extents();
    let inside = |point: &Point3<f64>| {
        let own = pose.inverse_transform_point(point);
        (0..3).all(|axis| (low[axis] - 0.03..high[axis] + 0.03).contains(&own[axis]))
    };
    points.iter().filter(|point| inside(point)).count()
}

fn seconds(s: f64) -> RigNs {
    RigNs((s * 1e9) as i64)
}

fn of_program(name: &str) -> (Scene, Config) {
    let scene = scenes::load(name).expect("a scene");
    let config = rig::operators(&scene, Path::new("rig.toml"), &[]).expect("a config").config;
    (scene, config)
}

#[test]
fn both_sensors_see_the_target_of_every_scene_from_its_beginning_to_its_end() {
    for name in NAMES {
        let (scene, config) = of_program(name);
        // In the middle of rests, or at three times from begin to end; in the intruder's scene before the person covers.
        let rests: Vec<RigNs> = scene.rests().iter().map(Stop::middle).collect();
        // Every second pose of a calibration, some of an experiment's views.
        let every = rests.len().div_ceil(8).max(1);
        let times: Vec<RigNs> = match rests.is_empty() {
            false => rests.into_iter().step_by(every).collect(),
            true if name == "intruder" => [0.5, 4.0, 9.0].map(seconds).to_vec(),
            true => {
                (0..5).map(|n| seconds(0.5 + f64::from(n) * (scene.config.duration_s.min(300.0) - 1.0) / 4.0)).collect()
            }
        };
        for t in times {
            let look = look(&scene, &config, t);
            let (kinect, lidar) = (on_target(&scene, t, &look.kinect), on_target(&scene, t, &look.lidar));
            assert!(kinect >= 1_000 && lidar >= 100, "{name} at {t:?}: {kinect}/{lidar} points");
            // The region of interest of the rig's config holds all of it.
            let middle = Point3::from(scene.config.roi_center_m);
            let pose = scene.world.target(t).expect("a target").t_rig_body;
            let reaches =
                scene.surface.vertices.iter().map(|corner| (pose * corner - middle).norm()).fold(0.0, f64::max);
            assert!(reaches <= scene.config.roi_radius_m, "{name} at {t:?}: {reaches} m");
        }
    }
}

/// The points of each cube become one: how many cubes have some.
fn voxels(points: &[Point3<f64>], edge_m: f64) -> usize {
    let cubes: BTreeSet<[i64; 3]> =
        points.iter().map(|p| [p.x, p.y, p.z].map(|x| (x / edge_m).floor() as i64)).collect();
    cubes.len()
}

/// Kinect/LiDAR points left of a paper scene's views, by distance, after the crop and the voxels it states.
fn counts(name: &str) -> Vec<(f64, [usize; 2])> {
    let (scene, config) = of_program(name);
    let experiment = scene.config.experiment.expect("an experiment");
    // Every fifth view: all angles of the three axes come in turn, about ten at each place.
    let views = scene.rests().into_iter().step_by(5).map(|stop| {
        let look = look(&scene, &config, stop.middle());
        let left = [voxels(&look.kinect, experiment.kinect_voxel_m), voxels(&look.lidar, experiment.lidar_voxel_m)];
        (stop.pose.translation.vector.x, left)
    });
    views.collect()
}

/// Published: 1239/126 to 8105/951 (Kinect/LiDAR). What is least and most here has to come within 15 % of that.
fn assert_published(name: &str) {
    const LEAST: [f64; 2] = [1239.0, 126.0];
    const MOST: [f64; 2] = [8105.0, 951.0];
    let counts = counts(name);
    let distances: BTreeSet<u64> = counts.iter().map(|(x, _)| x.to_bits()).collect();
    assert!(distances.len() >= 4, "{name}: {} distances", distances.len());
    for sensor in 0..2 {
        let of = || counts.iter().map(|(_, counts)| counts[sensor] as f64);
        let (least, most) = (of().fold(f64::INFINITY, f64::min), of().fold(0.0, f64::max));
        println!("{name}, sensor {sensor}: {least} to {most}");
        assert!((LEAST[sensor] / least - 1.0).abs() <= 0.15, "{name}, sensor {sensor}: least {least}");
        assert!((MOST[sensor] / most - 1.0).abs() <= 0.15, "{name}, sensor {sensor}: most {most}");
    }
}

#[test]
fn the_published_rigs_counts_of_points_are_those_of_its_scene() {
    assert_published("paper-rig");
}
#[test]
fn the_published_simulations_counts_of_points_are_those_of_its_scene() {
    assert_published("paper-simulation");
}
