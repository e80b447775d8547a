//! A pose as the search moves it: about the probes' centroid, in single precision.

use super::score::Placement;
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use tumbled_model::se3::exp_rotation;

/// Takes probes to the surface's frame: `x = R (p − c) + centre`, c the probes' centroid. About the centroid rotation and
/// translation hardly mix, and single precision is enough for a body metres away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// R.
    pub(super) rotation: Matrix3<f32>,
    /// Where the probes' centroid comes to lie, m.
    pub(super) center: Vector3<f32>,
}

impl Pose {
    /// From a rotation and the place of the centroid.
    pub(super) fn new(rotation: &UnitQuaternion<f64>, center: Vector3<f64>) -> Self {
        Self { rotation: rotation.to_rotation_matrix().into_inner().cast(), center: center.cast() }
    }

    /// From a transform of points; `centroid`: the probes'.
    pub(super) fn of(transform: &Isometry3<f64>, centroid: &Point3<f64>) -> Self {
        Self::new(&transform.rotation, (transform * centroid).coords)
    }

    /// As a transform of points; `centroid`: the probes'.
    pub(super) fn isometry(&self, centroid: &Point3<f64>) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_matrix(&self.rotation.cast::<f64>());
        let translation = self.center.cast::<f64>() - rotation * centroid.coords;
        Isometry3::from_parts(Translation3::from(translation), rotation)
    }

    /// As the score wants it; `centroid`: the probes'.
    pub(super) fn placement(&self, centroid: &Point3<f64>) -> Placement {
        let r = &self.rotation;
        let translation = self.center - r * centroid.coords.cast::<f32>();
        Placement {
            rotation: [[r.m11, r.m12, r.m13], [r.m21, r.m22, r.m23], [r.m31, r.m32, r.m33]],
            translation: translation.into(),
        }
    }

    /// Turned about the centroid's place by a rotation vector, rad, and moved, m.
    pub(super) fn moved(&self, turn: &Vector3<f64>, step: &Vector3<f64>) -> Self {
        let turn = exp_rotation(turn).to_rotation_matrix().into_inner();
        Self {
            rotation: (turn * self.rotation.cast::<f64>()).cast(),
            center: (self.center.cast::<f64>() + step).cast(),
        }
    }

    /// One step of a descent: turned about the centroid's place by very nearly a rotation vector, rad, and moved, m.
    ///
    /// The rotation is Cayley's of the half vector, by 2 atan(ω/2): of 0.1 rad less by 1/1200, exactly a rotation, and
    /// without a sine.
    pub(super) fn stepped(&self, turn: &Vector3<f64>, step: &Vector3<f64>) -> Self {
        let half = turn * 0.5;
        let (square, [x, y, z]) = (half.norm_squared(), half.into());
        let cross = Matrix3::new(0.0, -z, y, z, 0.0, -x, -y, x, 0.0);
        let turn = Matrix3::identity() + (cross + cross * cross) * (2.0 / (1.0 + square));
        Self {
            rotation: (turn * self.rotation.cast::<f64>()).cast(),
            center: (self.center.cast::<f64>() + step).cast(),
        }
    }

    /// Whether another one is the same for the search: nearer than an angle, rad, and a distance, m.
    pub(super) fn is_near(&self, other: &Self, angle_rad: f32, distance_m: f32) -> bool {
        // tr(RᵀR') = 1 + 2 cos a: no inverse cosine needed.
        let trace = self.rotation.component_mul(&other.rotation).sum();
        let near = (self.center - other.center).norm_squared() <= distance_m * distance_m;
        near && trace >= 1.0 + 2.0 * libm::cosf(angle_rad)
    }
}
