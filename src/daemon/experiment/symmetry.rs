//! Targets that look the same in several poses.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use tumbled_model::se3::angle_between;
use tumbled_sim::target::TargetKind;

/// The motion of a target's own frame nearest to `body` that leaves it looking as it did: the identity unless the target
/// is symmetric. `body` takes the target's pose as it is to the pose as found, both in its own frame.
pub fn nearest(kind: TargetKind, body: &Isometry3<f64>) -> Isometry3<f64> {
    let rotation = match kind {
        TargetKind::Cube => {
            let off = |turn: &UnitQuaternion<f64>| angle_between(turn, &body.rotation);
            cube_turns().into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default()
        }
        TargetKind::RocketBody => {
            // The turn about z alone that comes closest: the twist of the swing-twist decomposition.
            let q = body.rotation.quaternion();
            let twist = nalgebra::Quaternion::new(q.w, 0.0, 0.0, q.k);
            UnitQuaternion::try_new(twist, 1e-9).unwrap_or_default()
        }
        TargetKind::Sphere => body.rotation,
        TargetKind::BoxBus | TargetKind::HexBus | TargetKind::Board => UnitQuaternion::identity(),
    };
    // All of them turn about the frame's origin.
    Isometry3::from_parts(Point3::origin().coords.into(), rotation)
}

/// The 24 turns of a cube.
fn cube_turns() -> Vec<UnitQuaternion<f64>> {
    let quarter = |axis: Vector3<f64>, n: u32| {
        UnitQuaternion::from_scaled_axis(axis * (f64::from(n) * core::f64::consts::FRAC_PI_2))
    };
    // Each of the six faces up, then turned about the vertical.
    let faces = (0..4).map(|n| quarter(Vector3::x(), n)).chain([1, 3].map(|n| quarter(Vector3::y(), n)));
    faces.flat_map(|face| (0..4).map(move |n| quarter(Vector3::z(), n) * face)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_has_24_turns() {
        let turns = cube_turns();
        assert_eq!(turns.len(), 24);
        for (n, turn) in turns.iter().enumerate() {
            assert!(turns.iter().take(n).all(|other| angle_between(turn, other) > 1.0));
        }
    }

    #[test]
    fn what_looks_the_same_is_no_error_and_the_rest_is() {
        let turned = |axis: Vector3<f64>, degrees: f64| {
            Isometry3::from_parts(
                Vector3::new(0.0, 0.01, 0.0).into(),
                UnitQuaternion::from_scaled_axis(axis * degrees.to_radians()),
            )
        };
        let left =
            |kind, body: &Isometry3<f64>| angle_between(&nearest(kind, body).rotation, &body.rotation).to_degrees();
        assert!((left(TargetKind::Cube, &turned(Vector3::y(), 93.0)) - 3.0).abs() < 1e-9);
        assert!(left(TargetKind::RocketBody, &turned(Vector3::z(), 71.0)) < 1e-6);
        assert!((left(TargetKind::RocketBody, &turned(Vector3::x(), 20.0)) - 20.0).abs() < 1e-6);
        assert!((left(TargetKind::BoxBus, &turned(Vector3::z(), 90.0)) - 90.0).abs() < 1e-9);
        assert!(nearest(TargetKind::Cube, &turned(Vector3::y(), 93.0)).translation.vector.norm() < 1e-12);
    }
}
