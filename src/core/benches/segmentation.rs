//! What it costs to tell the target's points of an epoch from the others.
//!
//! `cargo bench -p tumbled-core --bench segmentation`

use divan::counter::ItemsCount;
use nalgebra::Point3;
use tumbled_core::RegionOfInterest;
use tumbled_core::epoch::{Epoch, KinectScan, RigCloud, Scan, TimeBasis};
use tumbled_core::segment::{Expectation, Search, Segment, Segmenter};
use tumbled_kinect::{BackProjector, Image, Intrinsics, NoiseModel, Points};
use tumbled_model::{Point, RigNs, Span};

fn main() {
    divan::main();
}

/// A depth frame of a room: a target of 0.9 m × 0.6 m at 2.5 m, a floor 0.6 m below the camera, a wall at 4 m.
fn frame() -> Epoch {
    let (f, c) = (Intrinsics::default().fy as f32, Intrinsics::default().cy as f32);
    let depth = |u: usize, v: usize| {
        let (u, v) = (u as f32, v as f32);
        // A ripple as large as the noise, so that no two neighbours are alike.
        let ripple = 0.004 * ((u * 37.0 + v * 11.0) % 7.0 - 3.0);
        let is_target = (u - 320.0).abs() < 0.45 * f / 2.5 && (v - 240.0).abs() < 0.3 * f / 2.5;
        let floor = if v > c { 0.6 * f / (v - c) } else { f32::INFINITY };
        let z = if is_target { 2.5 + 0.1 * ((u - 320.0) / 100.0) } else { floor.min(4.0) };
        z + ripple * z * z / 9.0
    };
    let mut points = Points::new();
    let projector = BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("a camera");
    projector.points(&Image::from_fn(depth), &mut points);
    let mut rig = RigCloud::default();
    for ((x, y), z) in points.x().iter().zip(points.y()).zip(points.z()) {
        let (x, y, z) = (*z, -*x, -*y);
        let offset = (x - 2.5, y, z);
        rig.in_roi.push(offset.0 * offset.0 + offset.1 * offset.1 + offset.2 * offset.2 <= 0.9 * 0.9);
        rig.x.push(x);
        rig.y.push(y);
        rig.z.push(z);
    }
    Epoch {
        number: 0,
        sensor: "left".into(),
        t: RigNs(0),
        span: (RigNs(0), RigNs(0)),
        sigma: Span(0),
        basis: TimeBasis::Arrival,
        arrived: RigNs(0),
        scan: Scan::Kinect(KinectScan { points, ..KinectScan::default() }),
        rig,
    }
}

fn segmenter() -> Segmenter {
    Segmenter::new(Search::Region(RegionOfInterest { center: Point::new(2.5, 0.0, 0.0), radius_m: 0.9 }))
}

/// In the region of interest, nothing known.
#[divan::bench]
fn kinect_first_sight(bencher: divan::Bencher<'_, '_>) {
    let (epoch, mut segmenter, mut segment) = (frame(), segmenter(), Segment::default());
    segmenter.segment(&epoch, None, &mut segment);
    let counter = ItemsCount::new(segment.counts.looked_at);
    bencher.counter(counter).bench_local(|| segmenter.segment(&epoch, None, &mut segment));
}

/// Where the target is expected.
#[divan::bench]
fn kinect_tracked(bencher: divan::Bencher<'_, '_>) {
    let (epoch, mut segmenter, mut segment) = (frame(), segmenter(), Segment::default());
    let expected = Expectation { center: Point3::new(2.5, 0.0, 0.0), radius_m: 0.6 };
    segmenter.segment(&epoch, Some(&expected), &mut segment);
    let counter = ItemsCount::new(segment.counts.looked_at);
    bencher.counter(counter).bench_local(|| segmenter.segment(&epoch, Some(&expected), &mut segment));
}

/// The same with the room learned.
#[divan::bench]
fn kinect_learned_room(bencher: divan::Bencher<'_, '_>) {
    let (epoch, mut segmenter, mut segment) = (frame(), segmenter(), Segment::default());
    let mut empty = epoch.clone();
    for (inside, x) in empty.rig.in_roi.iter_mut().zip(&empty.rig.x) {
        // The floor and what else is not at the target's distance.
        *inside &= (x - 2.5).abs() > 0.35;
    }
    segmenter.learn(&empty);
    segmenter.learn(&empty);
    segmenter.learned();
    bencher.bench_local(|| segmenter.segment(&epoch, None, &mut segment));
}
