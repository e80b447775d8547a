//! Points, planes and spheres as vectors, and what their inner products mean.
//!
//! | product | value | meaning |
//! | --- | --- | --- |
//! | P·Q | −½\|p−q\|² | distance of two points: [`ConformalPoint::squared_distance`] |
//! | P·π | n·p − d | height of a point over a plane: [`Plane::height`] |
//! | π·S | n·c − d | height of a sphere's centre over a plane: [`Plane::center_height`] |
//! | S₁·S₂ | ½(r₁²+r₂²−\|c₁−c₂\|²) | r₁r₂ times the cosine of the angle they meet at: [`Sphere::meeting`] |
//! | P·S | ½(r²−\|p−c\|²) | minus half the point's power, above 0 inside: [`Sphere::power`] |
//! | π₁·π₂ | n₁·n₂ | cosine of the angle between two planes: [`Plane::cos_angle`] |
//!
//! All in the representation in which a point lies on an object where their inner product is 0. These forms subtract
//! squares of coordinates: exact enough in `f64`; for `f32` use [`AnchoredSphere`](super::AnchoredSphere).

use super::{Conformal, Real};
use nalgebra::{Point3, Unit, Vector3};

/// A point p: `(p, 1, ½p²)`. Null: `P·P = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConformalPoint<T: Real>(Conformal<T>);

impl<T: Real> ConformalPoint<T> {
    /// The point with these coordinates, m.
    #[inline]
    pub fn new(point: &Point3<T>) -> Self {
        Self(Conformal::new(point.coords, T::UNIT, T::HALF * point.coords.norm_squared()))
    }

    /// Its vector.
    #[inline]
    pub fn vector(&self) -> &Conformal<T> {
        &self.0
    }

    /// Its coordinates, m.
    pub fn point(&self) -> Point3<T> {
        Point3::from(self.0.euclidean)
    }

    /// `−2 P·Q = |p − q|²`, m².
    #[inline]
    pub fn squared_distance(&self, other: &Self) -> T {
        -(self.0.dot(&other.0) + self.0.dot(&other.0))
    }
}

/// The plane n·x = d: `(n, 0, d)`. Unit: `π·π = 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane<T: Real>(Conformal<T>);

impl<T: Real> Plane<T> {
    /// The plane with this normal at this height over the origin, m.
    pub fn new(normal: &Unit<Vector3<T>>, height: T) -> Self {
        Self(Conformal::new(normal.into_inner(), T::NIL, height))
    }

    /// Its vector.
    #[inline]
    pub fn vector(&self) -> &Conformal<T> {
        &self.0
    }

    /// Its normal.
    pub fn normal(&self) -> Vector3<T> {
        self.0.euclidean
    }

    /// Its height over the origin along its normal, m.
    pub fn height_over_origin(&self) -> T {
        self.0.infinity
    }

    /// `P·π = n·p − d`: a point's height over it, m, above 0 where the normal points.
    #[inline]
    pub fn height(&self, point: &ConformalPoint<T>) -> T {
        self.0.dot(&point.0)
    }

    /// `π·S = n·c − d`: the height of a sphere's centre over it, m. It cuts the sphere where that is less than the radius.
    #[inline]
    pub fn center_height(&self, sphere: &Sphere<T>) -> T {
        self.0.dot(&sphere.0)
    }

    /// `π₁·π₂ = n₁·n₂`: the cosine of the angle between the normals.
    #[inline]
    pub fn cos_angle(&self, other: &Self) -> T {
        self.0.dot(&other.0)
    }
}

/// The sphere about c of squared radius r²: `(c, 1, ½(c² − r²))`. `S·S = r²`, which is negative for an imaginary sphere:
/// one no point lies on, such as the mean of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere<T: Real>(Conformal<T>);

impl<T: Real> Sphere<T> {
    /// The sphere about a centre, m, with a squared radius, m². Below 0: an imaginary one.
    pub fn new(center: &Point3<T>, squared_radius: T) -> Self {
        Self(Conformal::new(center.coords, T::UNIT, T::HALF * (center.coords.norm_squared() - squared_radius)))
    }

    /// The sphere a vector stands for, whatever its scale. `None`: it is a plane's, with no centre.
    pub fn from_vector(vector: &Conformal<T>) -> Option<Self> {
        if vector.origin == T::NIL {
            return None;
        }
        Some(Self(*vector * (T::UNIT / vector.origin)))
    }

    /// Its vector.
    #[inline]
    pub fn vector(&self) -> &Conformal<T> {
        &self.0
    }

    /// Its centre, m.
    pub fn center(&self) -> Point3<T> {
        Point3::from(self.0.euclidean)
    }

    /// `S·S = r²`, m². Below 0: it is imaginary.
    pub fn squared_radius(&self) -> T {
        self.0.dot(&self.0)
    }

    /// `−2 P·S = |p − c|² − r²`: the power of a point, m²; below 0 inside, 0 on it, above 0 outside.
    #[inline]
    pub fn power(&self, point: &ConformalPoint<T>) -> T {
        -(self.0.dot(&point.0) + self.0.dot(&point.0))
    }

    /// `S₁·S₂ = ½(r₁² + r₂² − |c₁ − c₂|²)`, m²: r₁r₂ times the cosine of the angle at which they meet; 0 where they meet
    /// at right angles.
    #[inline]
    pub fn meeting(&self, other: &Self) -> T {
        self.0.dot(&other.0)
    }
}
