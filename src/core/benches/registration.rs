//! What the parts of a registration cost, one thread.
//!
//! `cargo bench -p tumbled-core --bench registration`

use divan::counter::ItemsCount;
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_core::neighbours::{KdTree, Neighbours};
use tumbled_core::register::{Cloud, FreeSpace, Placement, Scorer, SensorKind, View, Weights};
use tumbled_core::surface::{Surface, SurfaceOptions, farthest_points};

fn main() {
    divan::main();
}

/// Dense and sparse points, as in the published table.
const SIZES: [(usize, usize); 3] = [(1_239, 126), (2_653, 358), (8_105, 828)];

/// A number that looks random, 0..1: the same each time.
fn chance(k: usize, salt: u32) -> f32 {
    let mut x = (k as u32).wrapping_mul(0x9e37_79b9) ^ salt;
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    (x ^ (x >> 16)) as f32 / u32::MAX as f32
}

/// A body 1.3 m long as a camera 2 m away sees it: two panels tilted a little, a box face before them; with noise.
fn surface_point(u: f32, v: f32, noise: f32) -> Point3<f32> {
    let x = (u - 0.5) * 1.3;
    let is_bus = x.abs() < 0.22;
    let y = (v - 0.5) * if is_bus { 0.5 } else { 0.36 };
    let z = if is_bus { 1.78 } else { 2.0 + 0.2 * y * x.signum() };
    Point3::new(x, y, z + 0.004 * (noise - 0.5))
}

fn dense(n: usize) -> Cloud {
    // Rows of even steps with some jitter: spread as evenly as the means of voxels.
    let columns = ((n as f32) * 1.3 / 0.4).sqrt() as usize;
    let rows = n.div_ceil(columns);
    let point = |k: usize| {
        let (i, j) = ((k % columns) as f32 + 0.4 * chance(k, 1), (k / columns) as f32 + 0.4 * chance(k, 2));
        surface_point(i / columns as f32, j / rows as f32, chance(k, 3))
    };
    Cloud {
        sensor: SensorKind::Kinect,
        points: (0..n).map(point).collect(),
        viewpoint: Some(Point3::origin()),
        view: View::Bare,
    }
}

/// The LiDAR stands a metre beside the camera, 1 m farther back; x forward, z up: x right, y down, z forward turned.
fn pose() -> Isometry3<f64> {
    let axes = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, -1.0, 0.0, //
        0.0, 0.0, -1.0, //
        1.0, 0.0, 0.0,
    ));
    let aside = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -0.3);
    let turn = aside * nalgebra::UnitQuaternion::from_rotation_matrix(&axes);
    Isometry3::from_parts(nalgebra::Translation3::new(1.0, 0.0, -1.0), turn)
}

fn sparse(n: usize) -> Cloud {
    let inverse = pose().inverse().cast::<f32>();
    let point = |k: usize| {
        // On rings, a third of a degree apart, 24 of them.
        let seen = inverse * surface_point(chance(k, 4), chance(k, 5), chance(k, 6));
        let flat = libm::hypotf(seen.x, seen.y);
        let ring = (libm::atan2f(seen.z, flat) / 0.0058).round() * 0.0058;
        Point3::new(seen.x, seen.y, flat * libm::tanf(ring))
    };
    Cloud {
        sensor: SensorKind::Lidar,
        points: (0..n).map(point).collect(),
        viewpoint: Some(Point3::origin()),
        view: View::Bare,
    }
}

#[divan::bench(args = SIZES)]
fn tree(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let cloud = dense(n);
    bencher.bench_local(|| KdTree::build(&cloud.points));
}

#[divan::bench(args = SIZES)]
fn tree_nearest(bencher: divan::Bencher<'_, '_>, (n, m): (usize, usize)) {
    let tree = KdTree::build(&dense(n).points);
    let pose = pose().cast::<f32>();
    let queries: Vec<_> = sparse(m).points.iter().map(|point| pose * point).collect();
    bencher.counter(ItemsCount::new(m)).bench_local(|| {
        queries.iter().filter_map(|query| tree.nearest(query, 0.04)).map(|(index, _)| u64::from(index)).sum::<u64>()
    });
}

#[divan::bench(args = SIZES)]
fn tree_20_nearest_of_all(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let cloud = dense(n);
    let tree = KdTree::build(&cloud.points);
    let mut near = Neighbours::with_capacity(20);
    bencher.counter(ItemsCount::new(n)).bench_local(|| {
        let mut sum = 0.0;
        for point in &cloud.points {
            tree.knn(point, 20, &mut near);
            sum += near.get(19).map_or(0.0, |(_, squared)| squared);
        }
        sum
    });
}

/// Neighbours, fits and look-up grid.
#[divan::bench(args = SIZES)]
fn surface(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let cloud = dense(n);
    bencher.counter(ItemsCount::new(n)).bench_local(|| Surface::build(&cloud, &SurfaceOptions::default()));
}

/// Neighbours and fits with the smallest of grids.
#[divan::bench(args = SIZES)]
fn surface_without_grid(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let cloud = dense(n);
    let options = SurfaceOptions { cell_m: 1.0, margin_m: 0.0, ..SurfaceOptions::default() };
    bencher.counter(ItemsCount::new(n)).bench_local(|| Surface::build(&cloud, &options));
}

#[divan::bench(args = SIZES)]
fn farthest_400(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let cloud = dense(n);
    bencher.bench_local(|| farthest_points(&cloud.points, 400));
}

#[divan::bench(args = SIZES)]
fn free_space_of_camera(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let cloud = dense(n);
    let spacing = Surface::build(&cloud, &SurfaceOptions::default()).spacing_m();
    bencher.bench_local(|| FreeSpace::build(&cloud, spacing));
}

#[divan::bench(args = SIZES)]
fn free_space_of_lidar(bencher: divan::Bencher<'_, '_>, (_, m): (usize, usize)) {
    let cloud = sparse(m);
    bencher.bench_local(|| FreeSpace::build(&cloud, 0.0));
}

#[divan::bench]
fn free_space_of_depth_image(bencher: divan::Bencher<'_, '_>) {
    let view = tumbled_core::register::DepthView {
        width: 640,
        height: 480,
        focal_px: [590.0; 2],
        center_px: [319.5, 239.5],
        z_m: (0..640 * 480).map(|k| 2.0 + 0.01 * chance(k, 7)).collect(),
    };
    let cloud = Cloud { view: View::Depth(view), ..dense(2_653) };
    bencher.bench_local(|| FreeSpace::build(&cloud, 0.0));
}

/// Look-ups of places within 10 cm of the surface.
#[divan::bench(args = SIZES)]
fn look(bencher: divan::Bencher<'_, '_>, (n, _): (usize, usize)) {
    let surface = Surface::build(&dense(n), &SurfaceOptions::default());
    let place = |k: usize| {
        let p = surface_point(chance(k, 8), chance(k, 9), 0.5);
        [p.x, p.y, p.z + 0.2 * (chance(k, 10) - 0.5)]
    };
    let places: Vec<[f32; 3]> = (0..1_000).map(place).collect();
    bencher.counter(ItemsCount::new(1_000usize)).bench_local(|| {
        places
            .iter()
            .filter_map(|place| surface.look(place).map(|patch| patch.height(&patch.offset(place))))
            .sum::<f32>()
    });
}

/// Scores of 32 poses near the truth, counted by points: sparse and dense ones.
fn scores(bencher: divan::Bencher<'_, '_>, n: usize, m: usize, asked: usize, probes: usize) {
    let (dense, sparse) = (dense(n), sparse(m));
    let surface = Surface::build(&dense, &SurfaceOptions::default());
    let scorer = Scorer::new(&surface, &dense, &sparse, Weights::HIDDEN_EXPLAINED);
    let near = |k: usize| {
        let step = Vector3::new(chance(k, 11) - 0.5, chance(k, 12) - 0.5, chance(k, 13) - 0.5).cast::<f64>() * 0.1;
        Placement::from(&(Isometry3::translation(step.x, step.y, step.z) * pose()))
    };
    let poses: Vec<Placement> = (0..32).map(near).collect();
    let points: Vec<_> = sparse.points.iter().take(asked).copied().collect();
    bencher
        .counter(ItemsCount::new(32 * (points.len() + probes)))
        .bench_local(|| poses.iter().map(|pose| scorer.score(pose, &points, probes)).sum::<f64>());
}

#[divan::bench(args = SIZES)]
fn score(bencher: divan::Bencher<'_, '_>, (n, m): (usize, usize)) {
    scores(bencher, n, m, m, 200);
}

#[divan::bench(args = SIZES)]
fn score_of_sparse_points(bencher: divan::Bencher<'_, '_>, (n, m): (usize, usize)) {
    scores(bencher, n, m, m, 0);
}

#[divan::bench(args = SIZES)]
fn score_of_dense_points(bencher: divan::Bencher<'_, '_>, (n, m): (usize, usize)) {
    scores(bencher, n, m, 0, 400);
}

/// Everything before the first pose can be scored.
#[divan::bench(args = SIZES)]
fn preparation(bencher: divan::Bencher<'_, '_>, (n, m): (usize, usize)) {
    let (dense, sparse) = (dense(n), sparse(m));
    bencher.bench_local(|| {
        let surface = Surface::build(&dense, &SurfaceOptions::default());
        Scorer::new(&surface, &dense, &sparse, Weights::HIDDEN_EXPLAINED).dense_sights().is_some()
    });
}
