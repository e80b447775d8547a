//! The same seed gives the same bytes, in any order and on any number of threads, and the decoder reads them.

use crate::scenes::{SEED, kinect, placed, plate};
use tumbled_kinect::{RawImage, decode_raw};
use tumbled_model::{DepthEncoding, PacketMask, RigNs};
use tumbled_sim::kinect::{Frame, KinectParameters};
use tumbled_sim::shape::Material;
use tumbled_sim::world::{Role, World};

fn world() -> World {
    World::new(vec![
        placed(plate(0.4, 0.3, Material::Foil), [0.1, 0.0, 1.5], 10.0, 30.0, Role::Target),
        placed(plate(30.0, 30.0, Material::Matt), [0.0, 0.0, 3.0], 0.0, 15.0, Role::Room),
    ])
}

fn nth(index: u64, seed: u64) -> Frame {
    kinect(KinectParameters::default()).frame(&world(), RigNs(index as i64 * 33_333_333), index, seed)
}

#[test]
fn frame_7_alone_is_frame_7_of_a_run() {
    let device = kinect(KinectParameters::default());
    let run: Vec<Frame> = (0..8).map(|i| device.frame(&world(), RigNs(i * 33_333_333), i as u64, SEED)).collect();
    assert_eq!(run[7], nth(7, SEED));
    assert_ne!(run[7].raw, run[6].raw, "a still scene's noise is new in every frame");
    assert_ne!(run[7].raw, nth(7, SEED + 1).raw);
}

#[test]
fn threads_do_not_change_the_bytes() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("three threads");
    let device = kinect(KinectParameters { readout_s: 0.03, ..KinectParameters::default() }).with_truth();
    let alone = device.frame(&world(), RigNs(5), 2, SEED);
    assert_eq!(device.frame_on(&pool, &world(), RigNs(5), 2, SEED), alone);
}

#[test]
fn the_decoder_reads_back_the_codes() {
    let frame = nth(3, SEED);
    let bytes = frame.packed().expect("eleven bits");
    assert_eq!(bytes.len(), 422_400);
    let mut decoded = RawImage::new();
    decode_raw(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &mut decoded).expect("a whole frame");
    assert_eq!(decoded, frame.raw);
}

#[test]
fn truth_names_what_is_seen_and_how_far() {
    let device = kinect(KinectParameters::default()).with_truth();
    let truth = device.frame(&world(), RigNs(0), 0, SEED).truth.expect("asked for");
    // The plate's middle is at (0.1, 0, 1.5): column 320 + 575.8/15 = 358.4. Past its edges is the wall.
    assert_eq!((truth.role.at(358, 240), truth.role.at(20, 20)), (Some(Some(Role::Target)), Some(Some(Role::Room))));
    let depth = truth.depth.at(358, 240).expect("in the image");
    assert!((depth - 1.5).abs() < 2e-3, "{depth}");
}

#[test]
fn an_empty_world_is_an_empty_frame() {
    let frame = kinect(KinectParameters::default()).frame(&World::default(), RigNs(0), 0, SEED);
    assert_eq!(frame.raw, RawImage::new());
}

#[test]
fn two_devices_of_one_scene_do_not_share_their_noise() {
    let device = |name| {
        let camera = tumbled_kinect::Intrinsics::default();
        let at_the_rig = nalgebra::Isometry3::identity();
        tumbled_sim::kinect::KinectModel::new(name, &camera, at_the_rig, KinectParameters::default()).expect("a camera")
    };
    let raw = |name| device(name).frame(&world(), RigNs(0), 0, SEED).raw;
    assert_ne!(raw("left"), raw("right"));
}
