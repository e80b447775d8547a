//! The moment sphere: what the mean of conformal points is.

use super::{Conformal, ConformalPoint, Sphere};
use nalgebra::{Point3, Vector3};

/// The sphere about a neighbourhood's centroid through its root mean square distance.
///
/// The weighted mean of conformal points is `(c̄, 1, ½(c̄² + σ²))`: an *imaginary* sphere about the centroid with
/// r² = −σ², σ² the mean squared distance. With the sign of r² turned round it is a real one; it always exists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentSphere {
    /// The centroid, m.
    pub center: Point3<f64>,
    /// σ: the root mean square distance from it, m.
    pub radius: f64,
}

impl MomentSphere {
    /// The mean of the points as a vector: the imaginary sphere.
    pub fn mean_vector(&self) -> Conformal<f64> {
        *Sphere::new(&self.center, -self.radius * self.radius).vector()
    }

    /// `P·S = ½(σ² − |p − c̄|²)` with the real sphere, m², from differences.
    pub fn product(&self, point: &Point3<f64>) -> f64 {
        0.5 * (self.radius * self.radius - (point - self.center).norm_squared())
    }

    /// The real sphere.
    pub fn sphere(&self) -> Sphere<f64> {
        Sphere::new(&self.center, self.radius * self.radius)
    }
}

/// The moment sphere of points and their weights (≥ 0). `None`: the weights sum to nothing, or a number is not finite.
///
/// The mean of conformal points, taken about the first point, since far from the origin squares of coordinates would
/// swallow the radius.
pub fn moment_sphere(points: impl Iterator<Item = (Point3<f64>, f64)>) -> Option<MomentSphere> {
    let mut about: Option<Vector3<f64>> = None;
    let mut sum = Conformal::new(Vector3::zeros(), 0.0, 0.0);
    for (point, weight) in points {
        let anchor = *about.get_or_insert(point.coords);
        sum = sum + *ConformalPoint::new(&(point - anchor)).vector() * weight;
    }
    let mean = Sphere::from_vector(&sum)?;
    let squared = -mean.squared_radius();
    let center = mean.center() + about?;
    let finite = squared.is_finite() && center.coords.iter().all(|number| number.is_finite());
    finite.then(|| MomentSphere { center, radius: squared.max(0.0).sqrt() })
}
