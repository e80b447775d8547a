//! Pairs with a weight matrix each, minimised by Levenberg–Marquardt: point to plane, and distribution to distribution.
//!
//! Both minimise `½ Σ rᵀ M r`, r = q − T p, over T: point to plane with `M = n nᵀ`, distribution to distribution with
//! `M = (C_q + R C_p Rᵀ)⁻¹`, every covariance a disc: variances 1, 1 and ε along the normal. Pairs and weights are found
//! anew for every step, and kept while its damping is sought. Damping, order and end of the iteration are small_gicp's
//! (its point-to-plane residual is not: there each component of r is weighted by the same component of n; here it is n·r).

use super::{Ended, IterationOptions, Parts};
use crate::register::{Cloud, Prior, RegisterError, Registration};
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Rotation3, Vector3, Vector6};
use tumbled_model::{Twist, se3::skew};

/// ε: the variance of a disc along its normal, its own plane's being 1.
const DISC_EPSILON: f64 = 1e-3;
/// Damping at the beginning, what it is multiplied with after a bad step (and divided by after a good one), and tries.
const DAMPING: f64 = 1e-3;
const DAMPING_FACTOR: f64 = 10.0;
const DAMPING_TRIES: u32 = 10;

/// Point to plane (Chen and Medioni 1992): the planes are the target's.
///
/// # Errors
/// Clouds that are none, a prior that is none.
pub fn plane_icp(
    moving: &Cloud,
    reference: &Cloud,
    prior: Option<&Prior>,
    options: &IterationOptions,
) -> Result<Registration, RegisterError> {
    let parts = Parts::new(moving, reference, options.target)?;
    let start = parts.start(prior)?;
    let normals = parts.target().normals(options.neighbours);
    let ended = iterate(&parts, start, options, |_, target, _| {
        let normal = normals.get(target as usize).copied().flatten()?;
        Some(normal * normal.transpose())
    });
    Ok(ended.registration(&parts))
}

/// Generalised ICP (Segal et al. 2009): every point of either cloud is a disc in its neighbours' plane.
///
/// # Errors
/// Clouds that are none, a prior that is none.
pub fn gicp(
    moving: &Cloud,
    reference: &Cloud,
    prior: Option<&Prior>,
    options: &IterationOptions,
) -> Result<Registration, RegisterError> {
    let parts = Parts::new(moving, reference, options.target)?;
    let start = parts.start(prior)?;
    let sources = parts.source().normals(options.neighbours);
    let targets = parts.target().normals(options.neighbours);
    let ended = iterate(&parts, start, options, |source, target, rotation| {
        let turned = sources.get(source).copied().flatten().map(|normal| rotation * normal);
        let target = targets.get(target as usize).copied().flatten();
        (disc(turned) + disc(target)).try_inverse()
    });
    Ok(ended.registration(&parts))
}

/// A disc's covariance: `I − (1 − ε) n nᵀ`; without a normal that of a ball.
fn disc(normal: Option<Vector3<f64>>) -> Matrix3<f64> {
    normal.map_or(Matrix3::identity(), |n| Matrix3::identity() - n * n.transpose() * (1.0 - DISC_EPSILON))
}

/// A source point, its target point, and how their difference is weighed.
struct Factor {
    point: Point3<f64>,
    target: Point3<f64>,
    weight: Matrix3<f64>,
}

fn iterate(
    parts: &Parts,
    start: Isometry3<f64>,
    options: &IterationOptions,
    weigh: impl Fn(usize, u32, &Rotation3<f64>) -> Option<Matrix3<f64>>,
) -> Ended {
    let (source, target) = (parts.source(), parts.target());
    let reach = (options.max_distance_m * options.max_distance_m) as f32;
    let mut factors = Vec::with_capacity(source.points().len());
    let mut nearest = vec![None; source.points().len()];
    let (mut pose, mut damping) = (start, DAMPING);
    for iteration in 1..=options.max_iterations {
        factors.clear();
        let rotation = pose.rotation.to_rotation_matrix();
        for (index, (point, nearest)) in source.points().iter().zip(&mut nearest).enumerate() {
            let point: Point3<f64> = point.cast();
            let at = rotation * point + pose.translation.vector;
            let factor = target.nearest(&at.cast(), reach, nearest).and_then(|nearest| {
                Some(Factor { point, target: target.point(nearest)?, weight: weigh(index, nearest, &rotation)? })
            });
            factors.extend(factor);
        }
        match step(&factors, &pose, &mut damping, options) {
            Step::Taken(next) => pose = next,
            Step::Last(next) => return Ended { pose: next, iterations: iteration, converged: true },
            Step::None => return Ended { pose, iterations: iteration, converged: false },
        }
    }
    Ended { pose, iterations: options.max_iterations, converged: false }
}

enum Step {
    /// Better by more than the end's bounds.
    Taken(Isometry3<f64>),
    /// Within the end's bounds.
    Last(Isometry3<f64>),
    /// Nothing better was found.
    None,
}

/// One step `T ← T Exp(ξ)`, damped until it is a better one.
fn step(factors: &[Factor], pose: &Isometry3<f64>, damping: &mut f64, options: &IterationOptions) -> Step {
    if factors.is_empty() {
        return Step::None;
    }
    let (h, b, error) = linearize(factors, pose);
    for _ in 0..DAMPING_TRIES {
        let Some(factor) = (h + Matrix6::identity() * *damping).cholesky() else {
            *damping *= DAMPING_FACTOR;
            continue;
        };
        let twist = Twist::from_vector(&-factor.solve(&b));
        let next = pose * twist.exp();
        let small = twist.rotation.norm() <= options.rotation_epsilon_rad
            && twist.translation.norm() <= options.translation_epsilon_m;
        if error_at(factors, &next) < error {
            *damping /= DAMPING_FACTOR;
            return if small { Step::Last(next) } else { Step::Taken(next) };
        }
        if small {
            // Where the error is as low as numbers go, no step lowers it.
            return Step::Last(*pose);
        }
        *damping *= DAMPING_FACTOR;
    }
    Step::None
}

/// `½ Σ rᵀ M r`.
fn error_at(factors: &[Factor], pose: &Isometry3<f64>) -> f64 {
    let rotation = pose.rotation.to_rotation_matrix();
    let mut error = 0.0;
    for factor in factors {
        let r = factor.target - (rotation * factor.point + pose.translation.vector);
        error += 0.5 * r.dot(&(factor.weight * r));
    }
    error
}

/// H, b and the error for the right perturbation. In the source's frame, with r′ = Rᵀr and M′ = RᵀMR, the derivative of
/// r′ is `([p]×, −I)`.
fn linearize(factors: &[Factor], pose: &Isometry3<f64>) -> (Matrix6<f64>, Vector6<f64>, f64) {
    let rotation = *pose.rotation.to_rotation_matrix().matrix();
    let back = rotation.transpose();
    let (mut turn, mut cross, mut shift) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
    let (mut b_turn, mut b_shift) = (Vector3::zeros(), Vector3::zeros());
    let mut error = 0.0;
    for factor in factors {
        let r = back * (factor.target - pose.translation.vector).coords - factor.point.coords;
        let weight = back * factor.weight * rotation;
        let k = skew(&factor.point.coords);
        let weighted = weight * r;
        // Kᵀ = −K.
        let km = k * weight;
        turn -= km * k;
        cross += km;
        shift += weight;
        b_turn -= k * weighted;
        b_shift -= weighted;
        error += 0.5 * r.dot(&weighted);
    }
    let mut h = Matrix6::zeros();
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    h.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
    h.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
    h.fixed_view_mut::<3, 3>(3, 3).copy_from(&shift);
    let mut b = Vector6::zeros();
    b.fixed_rows_mut::<3>(0).copy_from(&b_turn);
    b.fixed_rows_mut::<3>(3).copy_from(&b_shift);
    (h, b, error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_and_the_curvature_are_those_of_the_error() {
        let pose = Twist::new(Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.1, 2.0, -1.0)).exp();
        let factors: Vec<Factor> = (0..12)
            .map(|n| {
                let s = f64::from(n);
                let point = Point3::new(libm::sin(s), libm::cos(2.0 * s), 3.0 + libm::sin(3.0 * s));
                let normal = Vector3::new(libm::cos(s), 0.4, libm::sin(5.0 * s)).normalize();
                let target = pose * point + Vector3::new(0.01, -0.02, 0.01) * libm::cos(s);
                Factor { point, target, weight: disc(Some(normal)).try_inverse().expect("a disc") }
            })
            .collect();
        let (h, b, error) = linearize(&factors, &pose);
        assert!((error - error_at(&factors, &pose)).abs() < 1e-12);
        let at = |twist: Vector6<f64>| error_at(&factors, &(pose * Twist::from_vector(&twist).exp()));
        for axis in 0..6 {
            let mut along = Vector6::zeros();
            along[axis] = 1e-5;
            // Central difference of a function of curvature 1e5 and third derivatives alike: 1e-10 · 1e5.
            let slope = (at(along) - at(-along)) / 2e-5;
            assert!((slope - b[axis]).abs() < 1e-4 * (1.0 + b.norm()), "{axis}: {slope} {}", b[axis]);
            // The residuals' own curvature, left out of H, is of the residuals' size: 2 cm against 3 m.
            let bend = (at(along) + at(-along) - 2.0 * error) / 1e-10;
            assert!((bend / h[(axis, axis)] - 1.0).abs() < 0.02, "{axis}: {bend} {}", h[(axis, axis)]);
        }
    }
}
