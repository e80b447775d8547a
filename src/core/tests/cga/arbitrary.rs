//! Things anywhere within a few metres.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use proptest::prelude::*;
use tumbled_model::Twist;

pub(crate) fn point() -> impl Strategy<Value = Point3<f64>> {
    (-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64).prop_map(|(x, y, z)| Point3::new(x, y, z))
}

pub(crate) fn direction() -> impl Strategy<Value = Unit<Vector3<f64>>> {
    (-1.0..1.0f64, 0.0..core::f64::consts::TAU).prop_map(|(z, around)| {
        let across = (1.0 - z * z).sqrt();
        Unit::new_normalize(Vector3::new(across * libm::cos(around), across * libm::sin(around), z))
    })
}

/// Up to half a turn, that included.
pub(crate) fn motion() -> impl Strategy<Value = Isometry3<f64>> {
    let angle = prop_oneof![3 => 0.0..core::f64::consts::PI, 1 => Just(core::f64::consts::PI), 1 => Just(0.0)];
    (direction(), angle, point())
        .prop_map(|(axis, angle, place)| Twist::new(axis.into_inner() * angle, place.coords).exp())
}
