//! The unit sphere held at a point of its surface.

use crate::arbitrary::{direction, motion, point};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use tumbled_core::cga::{AnchoredSphere, ConformalPoint, Motor};

/// Curvatures of all a registration meets, flat included.
fn curvature() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1e-9), -8.0..8.0f64, -0.1..0.1f64]
}

proptest! {
    #[test]
    fn it_is_a_unit_vector_whose_product_with_a_point_is_f(
        p0 in point(), n in direction(), a in curvature(), p in point(),
    ) {
        let sphere = AnchoredSphere::new(p0, n.into_inner(), a);
        // The five numbers reach a·p₀² = 600: their differences hold to 1e-12 of that.
        let scale = 1.0 + a.abs() * 75.0;
        prop_assert!((sphere.vector().dot(&sphere.vector()) - 1.0).abs() < 1e-12 * scale);
        prop_assert!((sphere.vector().dot(ConformalPoint::new(&p).vector()) - sphere.product(&p)).abs() < 1e-12 * scale);
        prop_assert_eq!(sphere.product(&p0), 0.0);
        prop_assert_eq!(sphere.gradient(&p0), n.into_inner());
    }

    #[test]
    fn the_gradient_obeys_its_identity_and_is_the_slope(p0 in point(), n in direction(), a in curvature(), p in point()) {
        let sphere = AnchoredSphere::new(p0, n.into_inner(), a);
        let (f, g) = (sphere.product(&p), sphere.gradient(&p));
        prop_assert!((g.norm_squared() - (1.0 + 2.0 * a * f)).abs() < 1e-12 * (1.0 + g.norm_squared()));
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            // f is quadratic: its central difference is exact but for rounding, |f| ≤ 1200 over 2e-2.
            let slope = (sphere.product(&(p + axis * 1e-2)) - sphere.product(&(p - axis * 1e-2))) / 2e-2;
            prop_assert!((slope - g.dot(&axis)).abs() < 1e-9, "{slope} {g}");
        }
    }

    #[test]
    fn the_distance_is_exact_on_either_side_of_convex_and_hollow(
        c in point(), r in 0.125..20.0f64, n in direction(), p in point(), hollow in any::<bool>(),
    ) {
        // Convex: the normal points away from the centre, distance |p − c| − r; hollow: both turned round.
        let sign = if hollow { -1.0 } else { 1.0 };
        let p0 = c + n.into_inner() * r;
        let sphere = AnchoredSphere::new(p0, n.into_inner() * sign, sign / r);
        let expected = sign * ((p - c).norm() - r);
        prop_assert!((sphere.distance(&p) - expected).abs() < 1e-12 * 40.0, "{} {expected}", sphere.distance(&p));
        let same = sphere.sphere().expect("it is curved");
        prop_assert!((same.center() - c).norm() < 1e-10 && (same.squared_radius().sqrt() - r).abs() < 1e-9);
    }

    #[test]
    fn without_curvature_it_is_the_plane_and_it_comes_there_without_a_jump(p0 in point(), n in direction(), p in point()) {
        let height = n.dot(&(p - p0));
        let flat = AnchoredSphere::new(p0, n.into_inner(), 0.0);
        prop_assert_eq!(flat.distance(&p), flat.product(&p));
        prop_assert!((flat.distance(&p) - height).abs() < 1e-14);
        for a in [1e-6, 1e-9, 1e-12] {
            // δ = h + ½a(v² − h²) + O(a²): at 17 m at most 150 a away from the plane's.
            let near = AnchoredSphere::new(p0, n.into_inner(), a);
            prop_assert!((near.distance(&p) - height).abs() <= 160.0 * a + 1e-14);
        }
        prop_assert_eq!(flat.sphere(), None);
    }

    #[test]
    fn in_single_precision_it_is_good_to_a_hundredth_of_a_millimetre_at_five_metres(
        sight in direction(), n in direction(), a in -8.0..8.0f64, x in -0.15..0.15f64, y in -0.15..0.15f64, z in -0.15..0.15f64,
    ) {
        // What comes in is f32 already: its rounding, 2.4e-7 m at 5 m, is no fault of the form.
        let p0: Point3<f32> = Point3::from(sight.into_inner() * 5.0).cast();
        let p: Point3<f32> = p0 + Vector3::new(x, y, z).cast::<f32>();
        let (normal, a) = (n.into_inner().cast::<f32>(), a as f32);
        let single = AnchoredSphere::new(p0, normal, a);
        let double = AnchoredSphere::new(p0.cast::<f64>(), normal.cast(), f64::from(a));
        prop_assert!((f64::from(single.product(&p)) - double.product(&p.cast())).abs() < 1e-6);
        // Near the centre δ = 2f/(1 + √…) has the slope 1/|g|: it may lose digits there, not elsewhere.
        if double.gradient(&p.cast()).norm() > 0.3 {
            prop_assert!((f64::from(single.distance(&p)) - double.distance(&p.cast())).abs() < 1e-5);
        }
    }

    #[test]
    fn held_elsewhere_it_is_the_same_surface(
        p0 in point(), n in direction(), a in -8.0..8.0f64, near in point(), p in point(), motion in motion(),
    ) {
        let sphere = AnchoredSphere::new(p0, n.into_inner(), a);
        prop_assume!(sphere.gradient(&near).norm() > 1e-3);
        let other = sphere.held_near(&near).expect("not the centre");
        prop_assert!((other.distance(&p) - sphere.distance(&p)).abs() < 1e-9);
        prop_assert!(((near - other.anchor).norm() - sphere.distance(&near).abs()).abs() < 1e-9);
        // And a motor takes surface and point along.
        let motor = Motor::from_isometry(&motion);
        let moved = motor.anchored(&sphere).distance(&motor.point(&p));
        prop_assert!((moved - sphere.distance(&p)).abs() < 1e-9);
    }
}

#[test]
fn the_centre_is_a_radius_inside() {
    // a = 4: r = 0.25, centre at p₀ − n/4. f = −¼ + ½·4/16 = −1/8, |g|² = 1 − 1 = 0, δ = −¼.
    let sphere = AnchoredSphere::new(Point3::new(0.0, 0.0, 2.0), -Vector3::z(), 4.0);
    let center = Point3::new(0.0, 0.0, 2.25);
    assert_eq!(sphere.product(&center), -0.125);
    assert_eq!(sphere.distance(&center), -0.25);
    assert_eq!(sphere.held_near(&center), None);
}
