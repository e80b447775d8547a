//! Rigid motion as a motor: a unit dual quaternion.

use super::{AnchoredSphere, Conformal, ConformalPoint, Plane, Sphere};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};
use tumbled_model::Twist;

/// A motor `M = T R`: first the rotor `R = cos(φ/2) − sin(φ/2) B`, then the translator `T = 1 − ½ t e∞`; an object X goes
/// to `M X M̃`.
///
/// Stored as the isomorphic dual quaternion `q + ε d` with `d = ½ t q` (t as a pure quaternion), of unit length: `|q| = 1`
/// and `q·d = 0`. A motor and its negative are the same motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    q: Quaternion<f64>,
    d: Quaternion<f64>,
}

impl Motor {
    /// No motion.
    pub fn identity() -> Self {
        Self { q: Quaternion::identity(), d: Quaternion::new(0.0, 0.0, 0.0, 0.0) }
    }

    /// From its two quaternions, brought to unit length. `None`: the first is 0 or a number is not finite.
    pub fn from_dual_quaternion(q: Quaternion<f64>, d: Quaternion<f64>) -> Option<Self> {
        let finite = q.coords.iter().chain(d.coords.iter()).all(|number| number.is_finite());
        (finite && q.norm() > 0.0).then(|| Self { q, d }.renormalized())
    }

    /// From a rigid transform.
    pub fn from_isometry(motion: &Isometry3<f64>) -> Self {
        let q = motion.rotation.into_inner();
        Self { q, d: Quaternion::from_imag(motion.translation.vector) * q * 0.5 }.renormalized()
    }

    /// As a rigid transform.
    pub fn isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.translation()), self.rotation())
    }

    /// The motion of a twist (θ, ρ), rad and m.
    pub fn exp(twist: &Twist) -> Self {
        Self::from_isometry(&twist.exp())
    }

    /// The twist of least angle whose motion it is.
    pub fn log(&self) -> Twist {
        Twist::log(&self.isometry())
    }

    /// q: the rotor.
    pub fn rotor(&self) -> Quaternion<f64> {
        self.q
    }

    /// d: the dual part, ½ t q.
    pub fn dual(&self) -> Quaternion<f64> {
        self.d
    }

    /// Its rotation.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_unchecked(self.q)
    }

    /// Its translation `t = 2 d q*`, m.
    pub fn translation(&self) -> Vector3<f64> {
        (self.d * self.q.conjugate()).imag() * 2.0
    }

    /// `self` after `first`.
    pub fn after(&self, first: &Self) -> Self {
        Self { q: self.q * first.q, d: self.q * first.d + self.d * first.q }
    }

    /// The motion back.
    pub fn inverse(&self) -> Self {
        Self { q: self.q.conjugate(), d: self.d.conjugate() }
    }

    /// The nearest unit dual quaternion: what a long chain of motions loses to rounding is put right.
    pub fn renormalized(&self) -> Self {
        let length = self.q.norm();
        let (q, d) = (self.q / length, self.d / length);
        Self { q, d: d - q * q.coords.dot(&d.coords) }
    }

    /// Moves a vector, whatever it stands for: with x' = R x the Euclidean part goes to `x' + o t`, e0's coefficient
    /// stays, e∞'s goes to `i + t·x' + ½ o t²`.
    pub fn apply(&self, object: &Conformal<f64>) -> Conformal<f64> {
        let t = self.translation();
        let turned = self.rotation() * object.euclidean;
        let origin = object.origin;
        Conformal::new(turned + t * origin, origin, object.infinity + t.dot(&turned) + 0.5 * origin * t.norm_squared())
    }

    /// Moves a point.
    pub fn point(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation() * point.coords + self.translation())
    }

    /// Moves a conformal point. Made anew from its coordinates, so it stays null.
    pub fn conformal_point(&self, point: &ConformalPoint<f64>) -> ConformalPoint<f64> {
        ConformalPoint::new(&self.point(&point.point()))
    }

    /// Moves a plane.
    pub fn plane(&self, plane: &Plane<f64>) -> Plane<f64> {
        let moved = self.apply(plane.vector());
        Plane::new(&Unit::new_unchecked(moved.euclidean), moved.infinity)
    }

    /// Moves a sphere. Made anew from its centre and radius, so its radius stays.
    pub fn sphere(&self, sphere: &Sphere<f64>) -> Sphere<f64> {
        Sphere::new(&self.point(&sphere.center()), sphere.squared_radius())
    }

    /// Moves an anchored sphere.
    pub fn anchored(&self, sphere: &AnchoredSphere<f64>) -> AnchoredSphere<f64> {
        AnchoredSphere::new(self.point(&sphere.anchor), self.rotation() * sphere.normal, sphere.curvature)
    }
}
