//! The three spheres of a neighbourhood of points.

use crate::arbitrary::{motion, point};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_core::cga::{Conformal, ConformalPoint, FitError, Motor, fit_sphere, moment_sphere, tangent_sphere};

/// Draws by seed: uniform in −1..1 and normal.
struct Chance(ChaCha8Rng);

impl Chance {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        2.0 * (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64 - 1.0
    }

    /// The sum of twelve uniforms of variance ⅓ has variance 4.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() / 2.0
    }
}

fn even(points: &[Point3<f64>]) -> impl Iterator<Item = (Point3<f64>, f64)> + Clone + '_ {
    points.iter().map(|point| (*point, 1.0))
}

/// `count` points of a spherical cap about +z: centre, radius, half angle by its cosine, noise along the radius.
fn cap(seed: u64, count: usize, center: Point3<f64>, radius: f64, cos_half: f64, noise: f64) -> Vec<Point3<f64>> {
    let mut chance = Chance::new(seed);
    (0..count)
        .map(|_| {
            let z = cos_half + (1.0 - cos_half) * 0.5 * (1.0 + chance.uniform());
            let (around, across) = (core::f64::consts::PI * chance.uniform(), (1.0 - z * z).sqrt());
            let way = Vector3::new(across * libm::cos(around), across * libm::sin(around), z);
            center + way * (radius + noise * chance.normal())
        })
        .collect()
}

fn plane(seed: u64, count: usize, half: f64, noise: f64) -> Vec<Point3<f64>> {
    let mut chance = Chance::new(seed);
    (0..count)
        .map(|_| Point3::new(half * chance.uniform(), half * chance.uniform(), 2.0 + noise * chance.normal()))
        .collect()
}

proptest! {
    #[test]
    fn the_mean_of_points_is_an_imaginary_sphere_about_their_centroid(points in prop::collection::vec(point(), 1..40)) {
        let count = points.len() as f64;
        let mut mean = Conformal::new(Vector3::zeros(), 0.0, 0.0);
        for point in &points {
            mean = mean + *ConformalPoint::new(point).vector() * (1.0 / count);
        }
        let centroid = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / count;
        let variance = points.iter().map(|point| (point.coords - centroid).norm_squared()).sum::<f64>() / count;
        // ½p² ≤ 37.5 m².
        prop_assert!((mean.dot(&mean) + variance).abs() < 1e-12 * 75.0);
        let moment = moment_sphere(even(&points)).expect("there are points");
        prop_assert!((moment.center.coords - centroid).norm() < 1e-12);
        prop_assert!((moment.radius * moment.radius - variance).abs() < 1e-12 * 75.0);
        let vector = moment.mean_vector();
        prop_assert!((vector - mean).euclidean.norm() < 1e-12 && (vector.infinity - mean.infinity).abs() < 1e-11);
        prop_assert!((moment.product(&points[0]) + 0.5 * moment.sphere().power(&ConformalPoint::new(&points[0]))).abs() < 1e-11);
    }

    #[test]
    fn a_fitted_sphere_moves_with_its_points_and_forgets_their_order(motion in motion(), seed in 0..100u64) {
        let points = cap(seed, 60, Point3::new(0.3, -0.2, 1.0), 0.5, 0.8, 1e-3);
        let motor = Motor::from_isometry(&motion);
        let mut moved: Vec<_> = points.iter().map(|point| motor.point(point)).collect();
        moved.reverse();
        let (here, there) = (fit_sphere(even(&points)).expect("a cap"), fit_sphere(even(&moved)).expect("a cap"));
        prop_assert!((here.rms_m - there.rms_m).abs() < 1e-9);
        prop_assert!((here.surface.curvature.abs() - there.surface.curvature.abs()).abs() < 1e-7);
        // The sign of the normal is arbitrary, that of the distance with it.
        let (a, b) = (here.surface.distance(&points[0]), there.surface.distance(&moved[59]));
        prop_assert!((a.abs() - b.abs()).abs() < 1e-9);
    }

    #[test]
    fn a_sphere_through_exact_points_is_found_exactly(c in point(), r in 0.05..2.0f64, seed in 0..50u64) {
        let fitted = fit_sphere(even(&cap(seed, 40, c, r, 0.5, 0.0))).expect("a cap");
        let sphere = fitted.surface.sphere().expect("curved");
        // The ridge of 1e-12 under the moments is a residual of 1e-6 radii.
        prop_assert!((sphere.center() - c).norm() < 1e-5 * r && (1.0 / fitted.surface.curvature.abs() - r).abs() < 1e-5 * r);
        prop_assert!(fitted.rms_m < 1e-6 * r);
    }
}

#[test]
fn a_cap_of_37_degrees_with_1_mm_noise_gives_its_radius_to_a_half_percent() {
    // 0.8 = cos 37°: the cap is 0.2 r deep, so 1 mm of noise on 300 points leaves some 1 mm of the radius open.
    for seed in 0..20 {
        let points = cap(seed, 300, Point3::new(0.3, -0.2, 1.0), 0.5, 0.8, 1e-3);
        let fitted = fit_sphere(even(&points)).expect("a cap");
        let radius = 1.0 / fitted.surface.curvature.abs();
        assert!((radius - 0.5).abs() < 0.0025, "{radius}");
        assert!((fitted.rms_m - 1e-3).abs() < 2e-4, "{}", fitted.rms_m);
        let center = fitted.surface.sphere().expect("curved").center();
        assert!((center - Point3::new(0.3, -0.2, 1.0)).norm() < 0.004);
    }
}

#[test]
fn a_plane_is_a_fitted_sphere_without_curvature() {
    for seed in 0..20 {
        let fitted = fit_sphere(even(&plane(seed, 300, 0.2, 1e-3))).expect("a plane");
        // σ_a ≈ 2·√5·1 mm/(0.04 m² ⅔ · √300) ≈ 0.01.
        assert!(fitted.surface.curvature.abs() < 0.02, "{}", fitted.surface.curvature);
        assert!(fitted.surface.normal.z.abs() > 0.999_99);
        assert!((fitted.surface.anchor.z - 2.0).abs() < 5e-4);
    }
    let exact = fit_sphere(even(&plane(1, 50, 0.2, 0.0))).expect("a plane");
    assert!(exact.surface.curvature.abs() < 1e-4 && exact.rms_m < 1e-6);
}

#[test]
fn points_that_fix_no_sphere_are_an_error_not_a_number() {
    let line: Vec<_> = (0..20).map(|n| Point3::new(f64::from(n), 2.0 * f64::from(n), 0.0)).collect();
    assert!(matches!(fit_sphere(even(&line)), Err(FitError::Collinear { .. })));
    let place = [Point3::new(1.0, 2.0, 3.0); 8];
    assert_eq!(fit_sphere(even(&place)), Err(FitError::Collinear { ratio: 0.0 }));
    assert_eq!(fit_sphere(even(&line[..4])), Err(FitError::TooFewPoints { found: 4 }));
    assert_eq!(fit_sphere(core::iter::empty()), Err(FitError::TooFewPoints { found: 0 }));
    let mut bad = cap(1, 20, Point3::origin(), 0.5, 0.8, 0.0);
    bad[7].y = f64::NAN;
    assert_eq!(fit_sphere(even(&bad)), Err(FitError::NotFinite));
    assert_eq!(fit_sphere(bad.iter().map(|_| (Point3::origin(), -1.0))), Err(FitError::NotFinite));
    assert!(moment_sphere(core::iter::empty()).is_none() && moment_sphere(even(&bad)).is_none());
}

#[test]
fn a_tangent_sphere_touches_a_ball_from_outside_and_a_bowl_from_inside() {
    // A cap of half angle 10° on a ball of 0.4 m radius: a = 2.5 convex, −2.5 seen from inside.
    let points = cap(3, 400, Point3::new(0.0, 0.0, 3.0), 0.4, 0.985, 0.0);
    let mean = Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / 400.0);
    for (normal, expected) in [(Vector3::z(), 2.5), (-Vector3::z(), -2.5)] {
        let found = tangent_sphere(points.iter().copied(), &mean, &normal, 1e-4);
        // h = r cos − … : the parabola ½aρ² leaves out (a³ρ⁴)/8, a relative ¾·sin²10° ≈ 2 %.
        assert!((found.surface.curvature - expected).abs() < 0.06, "{}", found.surface.curvature);
        // The anchor lies on the ball, at 3.4 m, the mean 1.5 mm below it.
        assert!((found.surface.anchor.z - 3.4).abs() < 1e-4, "{}", found.surface.anchor.z);
    }
    let single = tangent_sphere(points.iter().map(|point| point.cast::<f32>()), &mean.cast(), &Vector3::z(), 1e-4);
    assert!((single.surface.curvature - 2.5).abs() < 0.06);
}

#[test]
fn curvature_within_the_noise_is_flat_and_curvature_beyond_sense_is_cut() {
    // A 5 cm patch at 2 m with 5.7 mm noise: σ_a is some 2/m: a ball of 0.5 m is not told from flat.
    for seed in 0..20 {
        let points = plane(seed, 40, 0.05, 5.7e-3);
        let mean = Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / 40.0);
        let found = tangent_sphere(points.iter().copied(), &mean, &Vector3::z(), 5.7e-3);
        assert_eq!(found.surface.curvature, 0.0);
        // σ_a = 2σ/√Σ(ρ²−ρ̄²)²; ρ² uniform over a square of side 0.1 has s.d. 1.05e-3 m²: 2·5.7e-3/(1.05e-3·√40) = 1.7.
        assert!((1.2..2.5).contains(&found.sigma_curvature), "{}", found.sigma_curvature);
    }
    let marble = cap(1, 100, Point3::origin(), 0.02, 0.9, 0.0);
    let mean = Point3::from(marble.iter().map(|point| point.coords).sum::<Vector3<f64>>() / 100.0);
    assert_eq!(tangent_sphere(marble.iter().copied(), &mean, &Vector3::z(), 1e-4).surface.curvature, 8.0);
    let nothing = tangent_sphere(core::iter::empty(), &mean, &Vector3::z(), 1e-3);
    assert!(nothing.surface.curvature == 0.0 && nothing.sigma_curvature.is_infinite());
}
