//! Motors against the general product and against rigid transforms.

use crate::arbitrary::{direction, motion, point};
use crate::multivector::Multivector;
use nalgebra::Quaternion;
use proptest::prelude::*;
use tumbled_core::cga::{ConformalPoint, Motor, Plane, Sphere};
use tumbled_model::se3::angle_between;

proptest! {
    #[test]
    fn it_moves_a_vector_as_the_product_from_both_sides_does(
        motion in motion(), p in point(), n in direction(), d in -3.0..3.0f64, r in 0.1..2.0f64,
    ) {
        let motor = Motor::from_isometry(&motion);
        let oracle = Multivector::motor(&motor);
        let objects = [*ConformalPoint::new(&p).vector(), *Plane::new(&n, d).vector(), *Sphere::new(&p, r * r).vector()];
        for object in objects {
            let expected = oracle.sandwich(&Multivector::vector(&object));
            prop_assert!(Multivector::vector(&motor.apply(&object)).difference(&expected) < 1e-11);
        }
        prop_assert!(oracle.times(&oracle.reversed()).difference(&Multivector::scalar(1.0)) < 1e-12);
    }

    #[test]
    fn it_moves_points_planes_and_spheres_as_the_rigid_transform_does(
        motion in motion(), p in point(), n in direction(), d in -3.0..3.0f64, r in 0.1..2.0f64,
    ) {
        let motor = Motor::from_isometry(&motion);
        prop_assert!((motor.point(&p) - motion * p).norm() < 1e-12);
        let moved = motor.conformal_point(&ConformalPoint::new(&p));
        prop_assert!((motor.plane(&Plane::new(&n, d)).height(&moved) - (n.dot(&p.coords) - d)).abs() < 1e-11);
        let sphere = motor.sphere(&Sphere::new(&p, r * r));
        prop_assert!((sphere.center() - motion * p).norm() < 1e-12);
        prop_assert!((sphere.squared_radius() - r * r).abs() < 1e-12 * 150.0);
    }

    #[test]
    fn composition_is_the_product_and_the_inverse_the_way_back(a in motion(), b in motion(), p in point()) {
        let (first, second) = (Motor::from_isometry(&a), Motor::from_isometry(&b));
        let both = second.after(&first);
        prop_assert!((both.point(&p) - b * (a * p)).norm() < 1e-11);
        let product = Multivector::motor(&second).times(&Multivector::motor(&first));
        prop_assert!(Multivector::motor(&both).difference(&product) < 1e-11);
        prop_assert!((first.inverse().point(&first.point(&p)) - p).norm() < 1e-11);
    }

    #[test]
    fn there_and_back_between_motor_transform_and_twist(motion in motion()) {
        let motor = Motor::from_isometry(&motion);
        let back = motor.isometry();
        prop_assert!((back.translation.vector - motion.translation.vector).norm() < 1e-12);
        prop_assert!(angle_between(&back.rotation, &motion.rotation) < 1e-12);
        let again = Motor::exp(&motor.log()).isometry();
        // V⁻¹ V at half a turn costs a few digits.
        prop_assert!((again.translation.vector - motion.translation.vector).norm() < 1e-10);
        prop_assert!(angle_between(&again.rotation, &motion.rotation) < 1e-10);
    }

    #[test]
    fn a_spoilt_motor_is_put_right(
        motion in motion(), length in 0.5..2.0f64, along in -1.0..1.0f64,
    ) {
        // Scaling both quaternions and adding a multiple of q to d is all that can be wrong without moving anything.
        let motor = Motor::from_isometry(&motion);
        let (q, d) = (motor.rotor() * length, (motor.dual() + motor.rotor() * along) * length);
        let right = Motor::from_dual_quaternion(q, d).expect("finite and not 0");
        prop_assert!((right.rotor().norm() - 1.0).abs() < 1e-14);
        prop_assert!(right.rotor().coords.dot(&right.dual().coords).abs() < 1e-14 * 10.0);
        prop_assert!((right.translation() - motion.translation.vector).norm() < 1e-12 * 10.0);
    }
}

#[test]
fn a_thousand_quarter_turns_of_a_thousandth_stay_a_motor() {
    let step = Motor::exp(&tumbled_model::Twist::new(
        nalgebra::Vector3::z() * (core::f64::consts::FRAC_PI_2 / 1000.0),
        nalgebra::Vector3::z() * 0.001,
    ));
    let all = (0..1000).fold(Motor::identity(), |motor, _| step.after(&motor).renormalized());
    // A screw: a quarter turn about z and 1 m along it.
    let moved = all.point(&nalgebra::Point3::new(1.0, 0.0, 0.0));
    assert!((moved - nalgebra::Point3::new(0.0, 1.0, 1.0)).norm() < 1e-12);
}

#[test]
fn numbers_that_are_no_motor_are_none() {
    let (nil, nan) = (Quaternion::new(0.0, 0.0, 0.0, 0.0), Quaternion::new(f64::NAN, 0.0, 0.0, 0.0));
    assert_eq!(Motor::from_dual_quaternion(nil, Quaternion::identity()), None);
    assert_eq!(Motor::from_dual_quaternion(Quaternion::identity(), nan), None);
}
