//! The tangent sphere: curvature along a given normal.

use super::{AnchoredSphere, Real};
use nalgebra::{Point3, Vector3};

/// Curvatures are kept within this, 1/m: a radius of 12.5 cm is the smallest a patch of 5 cm radius tells from a crease.
pub const LARGEST_CURVATURE: f64 = 8.0;
/// A curvature is believed beyond so many of its standard deviations.
pub const SIGNIFICANT: f64 = 3.0;

/// A sphere that touches a neighbourhood with a given normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentSphere<T: Real> {
    /// The sphere, held where the normal through the neighbourhood's mean meets it.
    pub surface: AnchoredSphere<T>,
    /// Standard deviation of its curvature, 1/m, from the points' noise.
    pub sigma_curvature: T,
}

/// The sphere with unit normal `normal` at a neighbourhood with mean `mean`, from its points (the mean is theirs, the
/// normal that of their plane), when heights have standard deviation `noise`, m.
///
/// A convex patch has heights `h = h₀ − ½aρ²` over the tangent plane, ρ the tangential distance: a is the slope of a
/// straight line through (½ρ², −h). The mean lies below a convex surface by `½aρ̄²`: the anchor is put back on it. Curvature
/// within [`SIGNIFICANT`] standard deviations of 0 is 0, beyond [`LARGEST_CURVATURE`] it is that. Two passes over the
/// points, no memory.
pub fn tangent_sphere<T: Real>(
    points: impl Iterator<Item = Point3<T>> + Clone,
    mean: &Point3<T>,
    normal: &Vector3<T>,
    noise: T,
) -> TangentSphere<T> {
    let local = points.map(|point| {
        let v = point - mean;
        let height = normal.dot(&v);
        (height, v.norm_squared() - height * height)
    });
    let (mut count, mut sum) = (T::NIL, T::NIL);
    for (_, rho) in local.clone() {
        count += T::UNIT;
        sum += rho;
    }
    let mean_rho = if count > T::NIL { sum / count } else { T::NIL };
    let (mut covariance, mut variance) = (T::NIL, T::NIL);
    for (height, rho) in local {
        let centered = rho - mean_rho;
        covariance += height * centered;
        variance += centered * centered;
    }
    // All at one distance: nothing to see curvature by.
    let least = T::nearest_to(1e-12) * mean_rho * mean_rho * count;
    if variance <= least {
        let flat = AnchoredSphere::new(*mean, *normal, T::NIL);
        return TangentSphere { surface: flat, sigma_curvature: T::nearest_to(f64::INFINITY) };
    }
    let two = T::UNIT + T::UNIT;
    let slope = -(two * covariance / variance);
    let sigma_curvature = two * noise / variance.root();
    let largest = T::nearest_to(LARGEST_CURVATURE);
    let significant = slope.abs() > T::nearest_to(SIGNIFICANT) * sigma_curvature;
    let curvature = if significant { slope.max(-largest).min(largest) } else { T::NIL };
    let anchor = mean + normal * (T::HALF * curvature * mean_rho);
    TangentSphere { surface: AnchoredSphere::new(anchor, *normal, curvature), sigma_curvature }
}
