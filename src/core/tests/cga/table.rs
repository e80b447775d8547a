//! The inner products of points, planes and spheres.

use crate::arbitrary::{direction, motion, point};
use crate::multivector::Multivector;
use proptest::prelude::*;
use tumbled_core::cga::{Conformal, ConformalPoint, Motor, Plane, Sphere};

fn inner(a: &Conformal<f64>, b: &Conformal<f64>) -> f64 {
    Multivector::vector(a).inner(&Multivector::vector(b))
}

proptest! {
    #[test]
    fn every_entry_is_the_inner_product_and_what_it_is_said_to_mean(
        p in point(), q in point(), n in direction(), m in direction(), d in -3.0..3.0f64, r in 0.01..2.0f64, s in 0.01..2.0f64,
    ) {
        let (cp, cq) = (ConformalPoint::new(&p), ConformalPoint::new(&q));
        let (plane, other) = (Plane::new(&n, d), Plane::new(&m, 0.3));
        let (sphere, second) = (Sphere::new(&q, r * r), Sphere::new(&p, s * s));
        let square = (p - q).norm_squared();
        let entries = [
            ("P·Q", inner(cp.vector(), cq.vector()), -0.5 * cp.squared_distance(&cq), -0.5 * square),
            ("P·π", inner(cp.vector(), plane.vector()), plane.height(&cp), n.dot(&p.coords) - d),
            ("π·S", inner(plane.vector(), sphere.vector()), plane.center_height(&sphere), n.dot(&q.coords) - d),
            ("S·S'", inner(sphere.vector(), second.vector()), sphere.meeting(&second), 0.5 * (r * r + s * s - square)),
            ("P·S", inner(cp.vector(), sphere.vector()), -0.5 * sphere.power(&cp), 0.5 * (r * r - square)),
            ("π·π'", inner(plane.vector(), other.vector()), plane.cos_angle(&other), n.dot(&m)),
            ("P·P", inner(cp.vector(), cp.vector()), 0.0, 0.0),
            ("π·π", inner(plane.vector(), plane.vector()), 1.0, 1.0),
            ("S·S", inner(sphere.vector(), sphere.vector()), sphere.squared_radius(), r * r),
        ];
        for (name, oracle, ours, meaning) in entries {
            // ½p² is up to 37 m² here: 1e-12 is 30 ulp of it.
            prop_assert!((ours - oracle).abs() < 1e-12, "{name}: {ours} {oracle}");
            prop_assert!((ours - meaning).abs() < 1e-12, "{name}: {ours} {meaning}");
        }
    }

    #[test]
    fn a_motor_keeps_every_inner_product(
        p in point(), q in point(), n in direction(), d in -3.0..3.0f64, r in 0.01..2.0f64, motion in motion(),
    ) {
        let objects = [
            *ConformalPoint::new(&p).vector(),
            *ConformalPoint::new(&q).vector(),
            *Plane::new(&n, d).vector(),
            *Sphere::new(&q, r * r).vector(),
            *Sphere::new(&p, -r * r).vector(),
        ];
        let motor = Motor::from_isometry(&motion);
        let moved = objects.map(|object| motor.apply(&object));
        for (a, moved_a) in objects.iter().zip(&moved) {
            for (b, moved_b) in objects.iter().zip(&moved) {
                // The products of the moved are differences of squares up to 150 m².
                prop_assert!((a.dot(b) - moved_a.dot(moved_b)).abs() < 1e-12 * 150.0);
            }
        }
    }
}

#[test]
fn angles_and_sides_have_the_signs_the_table_says() {
    use nalgebra::{Point3, Vector3};
    let sphere = Sphere::new(&Point3::new(1.0, 2.0, 3.0), 0.25);
    let at = |x: f64| ConformalPoint::new(&Point3::new(x, 2.0, 3.0));
    // P·S = ½(r² − |p − c|²): inside 0.125, on it 0, half a metre outside ½(0.25 − 1).
    assert_eq!([at(1.0), at(1.5), at(2.0)].map(|p| -0.5 * sphere.power(&p)), [0.125, 0.0, -0.375]);
    // Spheres of radii 3 and 4 with centres 5 apart meet at a right angle.
    let (three, four) = (Sphere::new(&Point3::origin(), 9.0), Sphere::new(&Point3::new(5.0, 0.0, 0.0), 16.0));
    assert_eq!(three.meeting(&four), 0.0);
    // A plane 2 m up, seen from above: the origin lies 2 m below it.
    let plane = Plane::new(&Vector3::z_axis(), 2.0);
    assert_eq!(plane.height(&ConformalPoint::new(&Point3::origin())), -2.0);
    assert_eq!(Sphere::from_vector(plane.vector()), None);
}
