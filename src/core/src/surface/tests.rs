//! Claims about whole surfaces.

use super::*;
use crate::register::SensorKind;
use nalgebra::Vector3;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A number of standard normal distribution, of twelve uniform ones.
fn normal(rng: &mut ChaCha8Rng) -> f32 {
    (0..12).map(|_| rng.next_u32() as f32 / u32::MAX as f32).sum::<f32>() - 6.0
}

fn cloud(points: Vec<Point3<f32>>, viewpoint: Option<Point3<f32>>) -> Cloud {
    Cloud { sensor: SensorKind::Kinect, points, viewpoint, view: crate::register::View::Bare }
}

/// A square lattice of 40 × 40 points, 1 cm apart, lifted by a function of its place, 2 m before the origin.
fn sheet(lift: impl Fn(f32, f32) -> f32) -> Vec<Point3<f32>> {
    let at = |k: usize| (k as f32 - 19.5) * 0.01;
    (0..40)
        .flat_map(|i| (0..40).map(move |j| (at(i), at(j))))
        .map(|(x, y)| Point3::new(x, y, 2.0 - lift(x, y)))
        .collect()
}

/// Patches that are not at the sheet's rim.
fn inner(surface: &Surface) -> Vec<&Detail> {
    surface.details().iter().filter(|d| d.mean.x.abs() < 0.15 && d.mean.y.abs() < 0.15).collect()
}

#[test]
fn a_plane_is_flat_faces_the_viewpoint_and_is_planar() {
    let surface = Surface::build(&cloud(sheet(|_, _| 0.0), Some(Point3::origin())), &SurfaceOptions::default());
    // 1.2 × 1 cm.
    assert!((surface.spacing_m() - 0.012).abs() < 1e-5);
    for detail in surface.details() {
        assert!((detail.normal + Vector3::z()).norm() < 1e-5 && detail.curvature == 0.0, "{detail:?}");
    }
    for patch in surface.patches() {
        // σ of a point 2 m away is 5.7 mm, averaged over six 2.3 mm.
        assert!((patch.sigma - 1.425e-3 * 4.0 / 6f32.sqrt()).abs() < 1e-4, "{}", patch.sigma);
    }
    let flat = Surface::build(
        &Cloud { sensor: SensorKind::Lidar, ..cloud(sheet(|_, _| 0.0), None) },
        &SurfaceOptions { neighbours: 400, ..SurfaceOptions::default() },
    );
    // A square of 20 × 20 points in the middle: λ₁ = λ₂, λ₃ = 0, and the noise taken off leaves them so.
    let middle = flat.details().get(820).expect("the middle");
    assert!(middle.shape.planar > 0.98, "{:?}", middle.shape);
}

#[test]
fn the_rim_is_where_neighbours_lie_to_one_side() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    // A lattice of 1 cm, every point moved by up to 3 mm each way.
    let mut away = || (rng.next_u32() as f32 / u32::MAX as f32 - 0.5) * 0.006;
    let points = sheet(|_, _| 0.0).into_iter().map(|p| p + Vector3::new(away(), away(), 0.0)).collect();
    let surface = Surface::build(&cloud(points, Some(Point3::origin())), &SurfaceOptions::default());
    let (mut rim, mut inside) = ((0, 0), (0, 0));
    for index in 0..1600 {
        let (row, column) = (index / 40, index % 40);
        let from_edge = row.min(column).min(39 - row).min(39 - column);
        let of = if from_edge == 0 { &mut rim } else { &mut inside };
        if from_edge == 0 || from_edge >= 3 {
            *of = (of.0 + 1, of.1 + usize::from(surface.is_rim(index)));
        }
    }
    // 4 × 39 of them are the rim, of which chance may hide one in twenty; 34² lie three points and more inside.
    assert!(rim.0 == 156 && rim.1 >= 148, "{rim:?}");
    assert_eq!(inside, (1156, 0));
    assert!(!surface.is_rim(1600), "there is no such point");
}

#[test]
fn a_noisy_plane_has_hardly_any_curved_patch() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let points = sheet(|_, _| 0.0).into_iter().map(|p| p + Vector3::z() * 0.003 * normal(&mut rng)).collect();
    let surface = Surface::build(&cloud(points, Some(Point3::origin())), &SurfaceOptions::default());
    // Three standard deviations: 1 of 60 at 16 degrees of freedom even without the normal's own fit; overlapping
    // neighbourhoods come in clusters, so allow 1 of 20.
    let curved = surface.details().iter().filter(|detail| detail.curvature != 0.0).count();
    assert!(curved * 20 < surface.details().len(), "{curved}");
}

#[test]
fn a_spheres_radius_is_found_convex_and_concave() {
    for sign in [1.0, -1.0f32] {
        // A cap of radius 0.5 m, towards the viewpoint (convex) or away from it (a dish).
        let lift = |x: f32, y: f32| sign * ((0.25 - x * x - y * y).sqrt() - 0.5);
        let surface = Surface::build(&cloud(sheet(lift), Some(Point3::origin())), &SurfaceOptions::default());
        for detail in inner(&surface) {
            // ±2 m⁻¹; the fit takes ρ²/2r for the sphere's height: off by a quarter of (ρ/r)² or 1 %, plus float dust.
            assert!((detail.curvature - f64::from(sign) * 2.0).abs() < 0.04, "{}", detail.curvature);
            let centre = Point3::new(0.0, 0.0, 2.0 + f64::from(sign) * 0.5);
            let outward = (detail.anchor - centre).normalize() * f64::from(sign);
            assert!((detail.normal - outward).norm() < 0.01, "{:?} {outward:?}", detail.normal);
            assert!(((detail.anchor - centre).norm() - 0.5).abs() < 1e-4);
        }
    }
}

#[test]
fn curvature_is_clamped_and_can_be_switched_off() {
    // Radius 5 cm: 20 m⁻¹.
    let ball = |n: i32| {
        let golden = 2.399_963_2_f32;
        let point = |k: i32| {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / n as f32;
            let (r, a) = ((1.0 - z * z).sqrt(), golden * k as f32);
            Point3::new(0.05 * r * libm::cosf(a), 0.05 * r * libm::sinf(a), 2.0 + 0.05 * z)
        };
        (0..n).map(point).collect::<Vec<_>>()
    };
    let built =
        |curved| Surface::build(&cloud(ball(800), None), &SurfaceOptions { curved, ..SurfaceOptions::default() });
    assert!(built(true).patches().iter().all(|patch| patch.a == 8.0));
    assert!(built(false).patches().iter().all(|patch| patch.a == 0.0));
    // Nobody knows the viewpoint: still all normals point outwards.
    for detail in built(true).details() {
        assert!(detail.normal.dot(&(detail.anchor - Point3::new(0.0, 0.0, 2.0))) > 0.04);
    }
}

#[test]
fn shapes_of_a_rod_a_disc_and_a_ball() {
    for (eigenvalues, expected) in [
        ([0.0, 0.0, 1.0], Shape { linear: 1.0, planar: 0.0, spherical: 0.0 }),
        ([0.0, 1.0, 1.0], Shape { linear: 0.0, planar: 1.0, spherical: 0.0 }),
        ([1.0, 1.0, 1.0], Shape { linear: 0.0, planar: 0.0, spherical: 1.0 }),
        // A disc as thick as its noise is flat all the same.
        ([0.25, 1.25, 1.25], Shape { linear: 0.0, planar: 0.5 * 2.0, spherical: 0.0 }),
    ] {
        let noise = if eigenvalues[0] == 0.25 { 0.25 } else { 0.0 };
        assert_eq!(Shape::of(eigenvalues, noise), expected);
    }
    assert_eq!(Shape::of([0.1, 0.1, 0.1], 0.2), Shape::default());
}

#[test]
fn clouds_of_hardly_any_points_make_surfaces_too() {
    for n in 0..6 {
        let points = (0..n).map(|k| Point3::new(k as f32 * 0.01, 0.0, 2.0)).collect();
        let surface = Surface::build(&cloud(points, Some(Point3::origin())), &SurfaceOptions::default());
        assert_eq!(surface.patches().len(), n);
        assert!(surface.spacing_m() >= LEAST_SPACING_M);
        assert!(surface.patches().iter().all(|p| p.n.iter().chain(&p.p).all(|c| c.is_finite())));
    }
    let nowhere = Surface::build(&cloud(vec![Point3::new(f32::NAN, 0.0, 0.0)], None), &SurfaceOptions::default());
    assert!(nowhere.points().is_empty() && nowhere.look(&[0.0; 3]).is_none());
}

proptest! {
    #[test]
    fn shares_of_a_shape_sum_to_one(
        l in proptest::array::uniform3(1e-6..1.0f64), noise in 0.0..1e-7f64,
    ) {
        let mut l = l;
        l.sort_by(f64::total_cmp);
        let shape = Shape::of(l, noise);
        prop_assert!((shape.linear + shape.planar + shape.spherical - 1.0).abs() < 1e-12);
        prop_assert!([shape.linear, shape.planar, shape.spherical].iter().all(|c| (0.0..=1.0 + 1e-12).contains(c)));
    }

    #[test]
    fn a_surface_turns_and_moves_with_its_cloud(
        angle in -3.0..3.0f32, step in -1.0..1.0f32, seed in 0u64..50,
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let points: Vec<_> =
            sheet(|x, y| 0.5 * x * x - 0.2 * x * y).into_iter().map(|p| p + Vector3::z() * 0.001 * normal(&mut rng)).collect();
        let turn = nalgebra::Rotation3::from_axis_angle(
            &nalgebra::Unit::new_normalize(Vector3::new(1.0, 2.0, -0.5f32)), angle,
        );
        let moved: Vec<_> = points.iter().map(|p| turn * p + Vector3::new(step, 0.0, -step)).collect();
        let viewpoint = turn * Point3::origin() + Vector3::new(step, 0.0, -step);
        let options = SurfaceOptions::default();
        let here = Surface::build(&cloud(points, Some(Point3::origin())), &options);
        let there = Surface::build(&cloud(moved, Some(viewpoint)), &options);
        let mut same = 0;
        for (a, b) in here.details().iter().zip(there.details()) {
            let normal = turn.cast::<f64>() * a.normal;
            // Rounding may change who is the twentieth neighbour, and so a few patches.
            same += usize::from((normal - b.normal).norm() < 1e-3 && (a.curvature - b.curvature).abs() < 0.05);
        }
        prop_assert!(same * 100 >= 90 * here.details().len(), "{same}");
        prop_assert!((here.spacing_m() - there.spacing_m()).abs() < 1e-5);
    }
}
