//! What the geometric algebra costs by the piece, and the methods of comparison on one pair of views.

use divan::black_box;
use divan::counter::ItemsCount;
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_core::cga::{AnchoredSphere, PointPair, align, fit_sphere};
use tumbled_core::register::baseline::{CbdOptions, IterationOptions, cbd, gicp, icp, plane_icp};
use tumbled_core::register::paper::{PaperOptions, cga_paper};
use tumbled_core::register::{Cloud, Prior};

#[path = "../tests/methods/scene.rs"]
#[expect(dead_code, reason = "the tests use the rest of it")]
mod scene;

fn main() {
    divan::main();
}

/// Points within 15 cm of (0, 0, 3).
fn points(count: u32) -> Vec<Point3<f64>> {
    let mut chance = scene::Chance::new(1);
    let mut number = || 0.3 * chance.share() - 0.15;
    (0..count).map(|_| Point3::new(number(), number(), 3.0 + number())).collect()
}

/// Distances from an anchored sphere in single precision: the search's innermost.
#[divan::bench]
fn anchored_distance_f32(bencher: divan::Bencher<'_, '_>) {
    let points: Vec<Point3<f32>> = points(1000).iter().map(|point| point.cast()).collect();
    let sphere = AnchoredSphere::new(Point3::new(0.0f32, 0.0, 3.0), -Vector3::z(), 2.0);
    bencher.counter(ItemsCount::new(points.len())).bench(|| {
        let sphere = black_box(&sphere);
        points.iter().map(|point| sphere.distance(point).abs()).fold(0.0f32, f32::max)
    });
}

/// The closed form, by pairs.
#[divan::bench(args = [60, 358, 2653])]
fn closed_form(bencher: divan::Bencher<'_, '_>, count: u32) {
    let motion = Isometry3::translation(0.1, 0.2, 0.3);
    let pair = |point: Point3<f64>| PointPair { point, center: motion * point, weight: 1.0 };
    let pairs: Vec<PointPair> = points(count).into_iter().map(pair).collect();
    bencher.counter(ItemsCount::new(count)).bench(|| align(black_box(&pairs), &[]));
}

/// One fitted sphere of 20 points.
#[divan::bench]
fn fitted_sphere(bencher: divan::Bencher<'_, '_>) {
    let points = points(20);
    bencher.bench(|| fit_sphere(black_box(&points).iter().map(|point| (*point, 1.0))));
}

/// Two views 20° apart, about 2653 and 358 points, and a prior 10° and 10 cm off.
fn views() -> (Cloud, Cloud, Prior) {
    let views = scene::pair(3, 20.0);
    let chance = &mut scene::Chance::new(1);
    let prior = scene::prior(chance, &views.t_lidar_kinect, &views.kinect, 0.1745, 0.10);
    (views.kinect, views.lidar, prior)
}

#[divan::bench]
fn method_icp(bencher: divan::Bencher<'_, '_>) {
    let (kinect, lidar, prior) = views();
    bencher.bench(|| icp(&kinect, &lidar, Some(&prior), &IterationOptions::points()));
}

#[divan::bench]
fn method_plane_icp(bencher: divan::Bencher<'_, '_>) {
    let (kinect, lidar, prior) = views();
    bencher.bench(|| plane_icp(&kinect, &lidar, Some(&prior), &IterationOptions::planes()));
}

#[divan::bench]
fn method_gicp(bencher: divan::Bencher<'_, '_>) {
    let (kinect, lidar, prior) = views();
    bencher.bench(|| gicp(&kinect, &lidar, Some(&prior), &IterationOptions::points()));
}

#[divan::bench]
fn method_cbd(bencher: divan::Bencher<'_, '_>) {
    let (kinect, lidar, _) = views();
    bencher.bench(|| cbd(&kinect, &lidar, &CbdOptions::default()));
}

#[divan::bench]
fn method_cga_paper(bencher: divan::Bencher<'_, '_>) {
    let (kinect, lidar, _) = views();
    bencher.bench(|| cga_paper(&kinect, &lidar, &PaperOptions::default()));
}
