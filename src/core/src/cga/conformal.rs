//! A vector of G(4,1): five numbers and one inner product.

use core::ops::{Add, Mul, Neg, Sub};
use nalgebra::Vector3;

/// The two precisions: `f32` where millions of points are tried, `f64` where one result is refined.
pub trait Real: nalgebra::RealField + Copy {
    /// ½.
    const HALF: Self;
    /// Nothing.
    const NIL: Self;
    /// The unit.
    const UNIT: Self;

    /// The square root, correctly rounded (so it has the same bits on every machine).
    fn root(self) -> Self;

    /// The nearest number of this precision.
    fn nearest_to(value: f64) -> Self;
}

impl Real for f32 {
    const HALF: Self = 0.5;
    const NIL: Self = 0.0;
    const UNIT: Self = 1.0;

    #[inline]
    fn root(self) -> Self {
        self.sqrt()
    }

    #[inline]
    fn nearest_to(value: f64) -> Self {
        value as Self
    }
}

impl Real for f64 {
    const HALF: Self = 0.5;
    const NIL: Self = 0.0;
    const UNIT: Self = 1.0;

    #[inline]
    fn root(self) -> Self {
        self.sqrt()
    }

    #[inline]
    fn nearest_to(value: f64) -> Self {
        value
    }
}

/// `X = x e1 + y e2 + z e3 + o e0 + i e∞`.
///
/// Lengths are in metres: `i` holds squares of lengths where `o` is 1, lengths where `o` is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conformal<T: Real> {
    /// The Euclidean part: coefficients of e1, e2, e3.
    pub euclidean: Vector3<T>,
    /// Coefficient of e0, the origin: 0 for planes and directions.
    pub origin: T,
    /// Coefficient of e∞.
    pub infinity: T,
}

impl<T: Real> Conformal<T> {
    /// From its parts.
    #[inline]
    pub const fn new(euclidean: Vector3<T>, origin: T, infinity: T) -> Self {
        Self { euclidean, origin, infinity }
    }

    /// The inner product `X·Y = x·y − o_X i_Y − i_X o_Y`. Of signature (4,1): `X·X` may be negative.
    #[inline]
    pub fn dot(&self, other: &Self) -> T {
        self.euclidean.dot(&other.euclidean) - self.origin * other.infinity - self.infinity * other.origin
    }
}

impl<T: Real> Add for Conformal<T> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.euclidean + other.euclidean, self.origin + other.origin, self.infinity + other.infinity)
    }
}

impl<T: Real> Sub for Conformal<T> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.euclidean - other.euclidean, self.origin - other.origin, self.infinity - other.infinity)
    }
}

impl<T: Real> Mul<T> for Conformal<T> {
    type Output = Self;

    fn mul(self, factor: T) -> Self {
        Self::new(self.euclidean * factor, self.origin * factor, self.infinity * factor)
    }
}

impl<T: Real> Neg for Conformal<T> {
    type Output = Self;

    fn neg(self) -> Self {
        Self::new(-self.euclidean, -self.origin, -self.infinity)
    }
}
