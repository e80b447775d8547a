//! Iterated closest points.

use super::{Ended, IterationOptions, Parts};
use crate::cga::{PointPair, align};
use crate::register::{Cloud, Prior, RegisterError, Registration};
use nalgebra::{Isometry3, Point3};
use tumbled_model::Twist;

/// Point to point (Besl and McKay 1992): every source point with its nearest target point, the closed form, and again.
///
/// # Errors
/// Clouds that are none, a prior that is none.
pub fn icp(
    moving: &Cloud,
    reference: &Cloud,
    prior: Option<&Prior>,
    options: &IterationOptions,
) -> Result<Registration, RegisterError> {
    let parts = Parts::new(moving, reference, options.target)?;
    let start = parts.start(prior)?;
    Ok(iterate(&parts, start, options).registration(&parts))
}

fn iterate(parts: &Parts, start: Isometry3<f64>, options: &IterationOptions) -> Ended {
    let (source, target) = (parts.source(), parts.target());
    let reach = (options.max_distance_m * options.max_distance_m) as f32;
    let mut pairs = Vec::with_capacity(source.points().len());
    let mut nearest = vec![None; source.points().len()];
    let mut pose = start;
    for iteration in 1..=options.max_iterations {
        pairs.clear();
        let motion = pose.to_homogeneous();
        for (point, nearest) in source.points().iter().zip(&mut nearest) {
            let point: Point3<f64> = point.cast();
            let place = motion.transform_point(&point).cast();
            let center = target.nearest(&place, reach, nearest).and_then(|index| target.point(index));
            pairs.extend(center.map(|center| PointPair { point, center, weight: 1.0 }));
        }
        // Too few pairs, or pairs on a line: there is no way on from here.
        let Ok(found) = align(&pairs, &[]) else {
            return Ended { pose, iterations: iteration, converged: false };
        };
        let next = found.motor.isometry();
        let step = Twist::log(&(pose.inverse() * next));
        pose = next;
        if step.rotation.norm() <= options.rotation_epsilon_rad
            && step.translation.norm() <= options.translation_epsilon_m
        {
            return Ended { pose, iterations: iteration, converged: true };
        }
    }
    Ended { pose, iterations: options.max_iterations, converged: false }
}
