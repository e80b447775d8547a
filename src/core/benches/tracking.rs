//! What a frame costs to track, one thread: a Kinect's of 20,000 pixels, a LiDAR's crossing of 2,000 returns, a model of
//! about 10,000 surfels.
//!
//! `cargo bench -p tumbled-core --bench tracking`

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use tumbled_core::register::SensorKind;
use tumbled_core::track::{LidarReturn, Pixel, RigMotion, Shot, TrackFrame, Tracker};
use tumbled_model::RigNs;

fn main() {
    divan::main();
}

/// A number that looks random, 0..1: the same each time.
fn chance(k: usize, salt: u32) -> f64 {
    let mut x = (k as u32).wrapping_mul(0x9e37_79b9) ^ salt;
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    f64::from(x ^ (x >> 16)) / f64::from(u32::MAX)
}

/// A lump of about a third of a metre: its surface in a direction, m.
fn lump(direction: &Vector3<f64>) -> Point3<f64> {
    let [x, y, z] = (*direction).into();
    let radius = 0.32 * (1.0 + 0.12 * libm::sin(4.0 * x + 1.0) * libm::cos(5.0 * y) + 0.1 * libm::sin(6.0 * z));
    Point3::from(direction * radius)
}

fn pose(degrees: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.2, 0.9, 0.3).normalize() * degrees.to_radians());
    Isometry3::from_parts(Translation3::new(0.0, 0.0, 2.1), turn)
}

/// Points of the side towards a sensor at the rig's origin, with noise, in the order of rows.
fn seen(count: usize, pose: Isometry3<f64>, noise_m: f64) -> impl Iterator<Item = Point3<f32>> {
    let golden = core::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..2 * count).filter_map(move |k| {
        let up = 1.0 - (2 * k + 1) as f64 / (2 * count) as f64;
        let (sin, cos) = libm::sincos(golden * k as f64);
        let flat = (1.0 - up * up).sqrt();
        let point = pose * lump(&Vector3::new(flat * cos, flat * sin, up));
        let ray = point.coords * (1.0 + noise_m * (chance(k, 1) + chance(k, 2) - 1.0) * 2.0 / point.coords.norm());
        (point.z < 2.1).then(|| Point3::from(ray).cast())
    })
}

fn pixels(degrees: f64) -> Vec<Pixel> {
    seen(20_000, pose(degrees), 0.006).map(|point| Pixel { point, sigma_m: 0.0063 }).collect()
}

fn returns(degrees: f64) -> Vec<LidarReturn> {
    let shift = |k: usize| (chance(k, 3) - 0.5) as f32 * 0.016;
    let points = seen(2_000, pose(degrees), 0.015).enumerate();
    points.map(|(k, point)| LidarReturn { point, beam: (k % 32) as u8, dt_s: shift(k) }).collect()
}

fn shot(sensor: usize) -> Shot {
    Shot { sensor, t: RigNs(0), viewpoint: Point3::origin() }
}

fn frame(kind: SensorKind, degrees: f64) -> TrackFrame {
    match kind {
        SensorKind::Kinect => TrackFrame::of_kinect(shot(0), pixels(degrees)),
        SensorKind::Lidar => TrackFrame::of_lidar(shot(1), returns(degrees), 0.0165, &RigMotion::STILL),
    }
}

/// After a whole turn.
fn tracker() -> Tracker {
    let mut tracker = Tracker::begin(&frame(SensorKind::Kinect, 0.0), &pose(0.0));
    for step in 1..90 {
        let degrees = f64::from(step) * 4.0;
        let frame = frame(SensorKind::Kinect, degrees);
        let fit = tracker.fit(&frame, &pose(degrees));
        tracker.accept(&frame, &fit);
    }
    let count = tracker.surfels().len();
    assert!((7_000..14_000).contains(&count), "{count} surfels");
    tracker
}

const KINDS: [SensorKind; 2] = [SensorKind::Kinect, SensorKind::Lidar];

#[divan::bench(args = KINDS)]
fn make_frame(bencher: divan::Bencher<'_, '_>, kind: &SensorKind) {
    let motion = RigMotion { angular_rps: Vector3::new(0.1, 0.3, 0.1), ..RigMotion::STILL };
    let (pixels, returns) = (pixels(10.0), returns(10.0));
    bencher.bench(|| match kind {
        SensorKind::Kinect => TrackFrame::of_kinect(shot(0), pixels.iter().copied()),
        SensorKind::Lidar => TrackFrame::of_lidar(shot(1), returns.iter().copied(), 0.0165, &motion),
    });
}

/// From a start 0.3° and 2 mm away.
#[divan::bench(args = KINDS)]
fn fit(bencher: divan::Bencher<'_, '_>, kind: &SensorKind) {
    let mut tracker = tracker();
    let frame = frame(*kind, 11.0);
    let start = Isometry3::translation(0.002, 0.0, 0.0) * pose(11.3);
    bencher.bench_local(|| tracker.fit(&frame, &start));
}

/// With an insertion.
#[divan::bench(args = KINDS)]
fn accept(bencher: divan::Bencher<'_, '_>, kind: &SensorKind) {
    let tracker = tracker();
    let frame = frame(*kind, 11.0);
    bencher
        .with_inputs(|| {
            let mut tracker = tracker.clone();
            let fit = tracker.fit(&frame, &pose(11.0));
            (tracker, fit)
        })
        .bench_local_refs(|(tracker, fit)| tracker.accept(&frame, fit));
}
