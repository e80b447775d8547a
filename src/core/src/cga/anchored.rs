//! A sphere or plane held at a point of its surface.

use super::{Conformal, Real, Sphere};
use nalgebra::{Point3, Vector3};

/// The unit sphere `ŝ = −S/r`, written about a point p₀ of its surface: normal n there, signed curvature a = ±1/r.
///
/// Its product with a point p, v = p − p₀, is `f = P·ŝ = n·v + ½a|v|²`: 0 on it, above 0 on the side n points to, and to
/// first order the distance. Curvature 0 *is* the plane, and everything here is continuous through it: there is no
/// infinite radius. Nothing but small differences is multiplied, so `f32` keeps its digits metres away from the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnchoredSphere<T: Real> {
    /// p₀: a point of the surface, m.
    pub anchor: Point3<T>,
    /// n: the unit normal there, towards the sensor.
    pub normal: Vector3<T>,
    /// a: the signed curvature, 1/m. Above 0: convex seen from where the normal points, centre at `p₀ − n/a`.
    pub curvature: T,
}

impl<T: Real> AnchoredSphere<T> {
    /// Held at an anchor, m, with a unit normal and a signed curvature, 1/m.
    #[inline]
    pub const fn new(anchor: Point3<T>, normal: Vector3<T>, curvature: T) -> Self {
        Self { anchor, normal, curvature }
    }

    /// `f = n·v + ½a|v|²`, m: the inner product with a point.
    #[inline]
    pub fn product(&self, point: &Point3<T>) -> T {
        let v = point - self.anchor;
        self.normal.dot(&v) + T::HALF * self.curvature * v.norm_squared()
    }

    /// `g = n + a v`: the gradient of [`product`](Self::product). `|g|² = 1 + 2af`; along g lies the shortest way to the
    /// surface.
    #[inline]
    pub fn gradient(&self, point: &Point3<T>) -> Vector3<T> {
        self.normal + (point - self.anchor) * self.curvature
    }

    /// The signed distance from the surface, m, exact: `δ = 2f / (1 + √(1 + 2af))`. At the centre it is −1/a.
    #[inline]
    pub fn distance(&self, point: &Point3<T>) -> T {
        let f = self.product(point);
        let square = T::UNIT + (f + f) * self.curvature;
        // Rounding may take the centre's 0 below 0.
        (f + f) / (T::UNIT + square.max(T::NIL).root())
    }

    /// The vector `ŝ = (n − a p₀, −a, n·p₀ − ½a p₀²)`, `ŝ·ŝ = 1`.
    pub fn vector(&self) -> Conformal<T> {
        let (p, n, a) = (self.anchor.coords, self.normal, self.curvature);
        Conformal::new(n - p * a, -a, n.dot(&p) - T::HALF * a * p.norm_squared())
    }

    /// The sphere it is. `None`: it is flat.
    pub fn sphere(&self) -> Option<Sphere<T>> {
        Sphere::from_vector(&self.vector())
    }

    /// The same surface held at the point of it nearest to `point`. `None`: the point is the centre, where every point of
    /// the surface is as near.
    pub fn held_near(&self, point: &Point3<T>) -> Option<Self> {
        let gradient = self.gradient(point);
        let length = gradient.norm();
        if length <= T::default_epsilon() {
            return None;
        }
        let normal = gradient / length;
        Some(Self::new(point - normal * self.distance(point), normal, self.curvature))
    }
}
