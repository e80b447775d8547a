//! A sphere fitted to points, planes included.

use super::{AnchoredSphere, Conformal, ConformalPoint, Real};
use nalgebra::{Matrix3, Matrix5, Point3, SymmetricEigen, Vector3, Vector5};

/// Fewer points fix no sphere and leave no residual.
const LEAST_POINTS: usize = 5;
/// Second largest to largest variance below which points are on a line.
const LINE: f64 = 1e-3;
/// Added to the moments relative to their trace, so that they have a Cholesky factor where points fit exactly.
const RIDGE: f64 = 1e-12;

/// A sphere through points, in the least squares sense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedSphere {
    /// The sphere, held at its point nearest to the points' centroid; the normal's sign is arbitrary.
    pub surface: AnchoredSphere<f64>,
    /// Root mean square of `P·ŝ`, to first order the distance, m.
    pub rms_m: f64,
}

/// Why points fix no sphere.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Too few of them.
    #[error("{found} points: at least {LEAST_POINTS} are needed for a sphere")]
    TooFewPoints {
        /// Points with a weight above 0.
        found: usize,
    },
    /// A coordinate or a weight that is no number, or a weight below 0.
    #[error("a coordinate or weight is not a finite number, or a weight is below 0")]
    NotFinite,
    /// On a line, or all in one place.
    #[error(
        "the points lie on a line: their second largest variance is {ratio:.1e} of the largest, {LINE:.0e} is needed"
    )]
    Collinear {
        /// Second largest to largest variance.
        ratio: f64,
    },
    /// No real sphere comes near them.
    #[error("the points lie about one place in no order: no sphere fits them")]
    NoSphere,
}

/// The sphere or plane for which `Σ w (P·ŝ)²` is least among those with `ŝ·ŝ = 1`, of points and their weights (≥ 0).
///
/// With M the moments of the points' vectors and G the metric it is the generalised eigenproblem `M s = λ G s`, λ the mean
/// squared residual; solved as `L⁻¹ G L⁻ᵀ y = μ y`, μ = 1/λ, with `M = L Lᵀ`, so that a symmetric solver does; about the
/// centroid and at unit scale, so that the five columns have one size. (Pratt 1987 for the constraint.)
///
/// # Errors
/// Fewer than five points, points on a line, numbers that are none.
pub fn fit_sphere(points: impl Iterator<Item = (Point3<f64>, f64)> + Clone) -> Result<FittedSphere, FitError> {
    let (centroid, scale) = place(points.clone())?;
    let mut moments = Matrix5::zeros();
    let mut total = 0.0;
    for (point, weight) in points {
        let row = metric(ConformalPoint::new(&Point3::from((point - centroid) / scale)).vector());
        moments += row * row.transpose() * weight;
        total += weight;
    }
    moments /= total;
    let ridge = Matrix5::identity() * (RIDGE * moments.trace());
    let lower = (moments + ridge).cholesky().ok_or(FitError::NotFinite)?.l();
    let inverse = lower.try_inverse().ok_or(FitError::NotFinite)?;
    let metric = metric_matrix();
    let eigen = SymmetricEigen::new(inverse * metric * inverse.transpose());
    let (best, largest) = eigen.eigenvalues.argmax();
    if largest <= 0.0 {
        return Err(FitError::NoSphere);
    }
    let s: Vector5<f64> = inverse.transpose() * eigen.eigenvectors.column(best);
    // Positive with μ: sᵀ G s = μ yᵀ y.
    let s = s / s.dot(&(metric * s)).sqrt();
    let rms_m = s.dot(&(moments * s)).max(0.0).sqrt() * scale;
    // At unit scale f = n·v + ½a v² − i about the centroid. In metres the curvature shrinks and lengths grow by the scale.
    let (n, a, offset) = (Vector3::new(s.x, s.y, s.z), -s.w / scale, -s.a * scale);
    let surface = held_nearest(&centroid, n, a, offset).ok_or(FitError::NoSphere)?;
    Ok(FittedSphere { surface, rms_m })
}

/// Centroid and root mean square distance from it.
fn place(points: impl Iterator<Item = (Point3<f64>, f64)> + Clone) -> Result<(Point3<f64>, f64), FitError> {
    let (mut sum, mut total, mut found) = (Vector3::zeros(), 0.0, 0);
    for (point, weight) in points.clone() {
        let finite = point.coords.iter().all(|number| number.is_finite()) && weight.is_finite();
        if !(finite && weight >= 0.0) {
            return Err(FitError::NotFinite);
        }
        found += usize::from(weight > 0.0);
        sum += point.coords * weight;
        total += weight;
    }
    if found < LEAST_POINTS {
        return Err(FitError::TooFewPoints { found });
    }
    let centroid = Point3::from(sum / total);
    let mut covariance = Matrix3::zeros();
    for (point, weight) in points {
        let offset = point - centroid;
        covariance += offset * offset.transpose() * (weight / total);
    }
    let mut variances: [f64; 3] = SymmetricEigen::new(covariance).eigenvalues.into();
    variances.sort_by(f64::total_cmp);
    let [_, second, largest] = variances;
    let ratio = if largest > 0.0 { second / largest } else { 0.0 };
    if ratio < LINE {
        return Err(FitError::Collinear { ratio });
    }
    Ok((centroid, covariance.trace().sqrt()))
}

/// The surface `f = n·v + ½a v² + offset`, v from the centroid, `|n|² = 1 + 2a·offset`, held at its point nearest to the
/// centroid. `None`: the centroid is its centre.
fn held_nearest(centroid: &Point3<f64>, n: Vector3<f64>, a: f64, offset: f64) -> Option<AnchoredSphere<f64>> {
    let length = n.norm();
    if length <= f64::EPSILON {
        return None;
    }
    let normal = n / length;
    // The distance of the centroid, where f = offset and |g| = |n|: δ = 2f/(1 + |g|).
    let distance = 2.0 * offset / (1.0 + length);
    Some(AnchoredSphere::new(centroid - normal * distance, normal, a))
}

/// `G X`: the row that gives `X·S` by an ordinary product with S.
fn metric(x: &Conformal<f64>) -> Vector5<f64> {
    let e = x.euclidean;
    Vector5::new(e.x, e.y, e.z, -x.infinity, -x.origin)
}

/// G: the metric over (e1, e2, e3, e0, e∞).
fn metric_matrix() -> Matrix5<f64> {
    let (one, nil) = (f64::UNIT, f64::NIL);
    Matrix5::from_row_slice(&[
        one, nil, nil, nil, nil, //
        nil, one, nil, nil, nil, //
        nil, nil, one, nil, nil, //
        nil, nil, nil, nil, -one, //
        nil, nil, nil, -one, nil,
    ])
}
