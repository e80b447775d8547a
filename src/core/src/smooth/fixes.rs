//! The frames' fits as measurements: about the middle of the path, each with its noise, and each sensor's displacement.

use super::FittedPose;
use super::pass::Pass;
use crate::ukf::SensorPrior;
use core::f64::consts::PI;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};
use tumbled_model::Twist;
use tumbled_model::se3::adjoint;

/// What no frame's pose is better than, one axis: rad and m.
const FLOOR: (f64, f64) = (0.02 / 180.0 * PI, 0.0003);
/// What is known of a pose anyhow: a radian and a metre.
const LEAST_INFORMATION: f64 = 1.0;
/// A sensor's scatter is this share of its noise at least.
const LEAST_SCATTER: f64 = 0.3;
/// Degrees of freedom of Student's distribution that fits scatter by: outliers count little, and none is thrown away.
const STUDENT: f64 = 8.0;

/// One fit, about the middle of the path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fix {
    /// Where it stood among those given.
    pub(super) number: usize,
    /// s from the first one.
    pub(super) t_s: f64,
    /// Its sensor.
    pub(super) sensor: usize,
    /// Rig's axes, origin in the middle of the path.
    pose: Isometry3<f64>,
    /// Covariance of `Log(pose · truth⁻¹)`, by the points' noise. `None`: it did not fit.
    noise: Option<Matrix6<f64>>,
    /// By how much its noise counts more, being an outlier.
    more: f64,
}

/// What is known of a sensor.
#[derive(Clone, Copy, Debug)]
struct Source {
    /// Of its displacement: the inverse of what was stated, about the middle.
    prior: Matrix6<f64>,
    displacement: Isometry3<f64>,
    /// Its scatter over its noise, squared.
    scatter: f64,
}

/// All fits in the order of their times, and the sensors.
#[derive(Clone, Debug)]
pub(super) struct Fixes {
    center: Isometry3<f64>,
    fixes: Vec<Fix>,
    sources: Vec<Source>,
}

impl Fixes {
    /// `None`: no fit, or one of a sensor without a prior.
    pub(super) fn new(poses: &[FittedPose], priors: &[SensorPrior]) -> Option<Self> {
        let mut sum = Vector3::zeros();
        let fitted = poses.iter().filter(|pose| pose.information.is_some());
        let count = fitted.clone().count();
        fitted.for_each(|pose| sum += pose.t_rig_target.translation.vector);
        if count == 0 || poses.iter().any(|pose| pose.sensor >= priors.len()) {
            return None;
        }
        let center = Isometry3::from_parts((sum / count as f64).into(), Default::default());
        let mut order: Vec<usize> = (0..poses.len()).collect();
        order.sort_by_key(|number| poses.get(*number).map(|pose| pose.t));
        let first = poses.get(*order.first()?)?.t;
        let fix = |number: usize| {
            let given = poses.get(number)?;
            let pose = center.inv_mul(&given.t_rig_target);
            let noise = given.information.map(|information| left_noise(&pose, &information)).unwrap_or_default();
            let t_s = (given.t - first).as_secs_f64();
            Some(Fix { number, t_s, sensor: given.sensor, pose, noise, more: 1.0 })
        };
        let source = |prior: &SensorPrior| {
            let stated = Matrix6::from_diagonal(&prior.sigma_e.component_mul(&prior.sigma_e));
            // Its axes turned to the rig's; its origin is about where the middle is.
            let turn = adjoint(&Isometry3::from_parts(Default::default(), prior.nominal.rotation));
            let inverse = (turn * stated * turn.transpose()).try_inverse()?;
            Some(Source { prior: inverse, displacement: Isometry3::identity(), scatter: 1.0 })
        };
        Some(Self {
            center,
            fixes: order.into_iter().map(fix).collect::<Option<_>>()?,
            sources: priors.iter().map(source).collect::<Option<_>>()?,
        })
    }

    pub(super) fn all(&self) -> &[Fix] {
        &self.fixes
    }

    pub(super) fn fitted(&self) -> usize {
        self.fixes.iter().filter(|fix| fix.noise.is_some()).count()
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.fixes.last().map_or(0.0, |last| last.t_s)
    }

    /// The middle of the path, the rig's axes, to the rig.
    pub(super) fn center(&self) -> Isometry3<f64> {
        self.center
    }

    pub(super) fn sensors(&self) -> usize {
        self.sources.len()
    }

    pub(super) fn displacement(&self, sensor: usize) -> Isometry3<f64> {
        self.sources.get(sensor).map_or_else(Isometry3::identity, |source| source.displacement)
    }

    pub(super) fn scatter(&self) -> Vec<f64> {
        self.sources.iter().map(|source| libm::sqrt(source.scatter)).collect()
    }

    /// A fit's pose without its sensor's displacement, and its covariance. `None`: it did not fit.
    pub(super) fn measured(&self, fix: &Fix) -> Option<(Isometry3<f64>, Matrix6<f64>)> {
        let source = self.sources.get(fix.sensor)?;
        Some((source.displacement.inv_mul(&fix.pose), fix.noise? * (source.scatter * fix.more)))
    }

    /// Displacements, scatter and outliers, as a pass shows them: the expectation's maximum of all three.
    pub(super) fn learn(&mut self, pass: &Pass) {
        let mut shown = vec![(Matrix6::zeros(), Vector6::zeros(), 0.0, 0.0); self.sources.len()];
        for (fix, node) in self.fixes.iter_mut().zip(&pass.nodes) {
            let (Some(source), Some(shown)) = (self.sources.get(fix.sensor), shown.get_mut(fix.sensor)) else {
                continue;
            };
            let Some(information) = fix.noise.and_then(|noise| noise.try_inverse()) else { continue };
            let seen = Twist::log(&(fix.pose * node.pose.inverse())).vector();
            let left = Twist::log(&(source.displacement.inv_mul(&fix.pose) * node.pose.inverse())).vector();
            // What the smoothed pose itself does not know is in the expectation.
            let unknown = (information * node.pose_covariance()).trace();
            let square = left.dot(&(information * left)) + unknown;
            fix.more = (STUDENT + square / source.scatter) / (STUDENT + 6.0);
            shown.0 += information / (source.scatter * fix.more);
            shown.1 += information * seen / (source.scatter * fix.more);
            shown.2 += square / fix.more;
            shown.3 += 6.0;
        }
        let found: Vec<_> = self
            .sources
            .iter()
            .zip(&shown)
            .map(|(source, (information, seen, ..))| {
                (information + source.prior).try_inverse().map_or_else(Vector6::zeros, |inverse| inverse * seen)
            })
            .collect();
        let common = self.common(&found, &shown.iter().map(|shown| shown.3 > 0.0).collect::<Vec<_>>());
        for ((source, found), (.., squares, count)) in self.sources.iter_mut().zip(&found).zip(&shown) {
            source.displacement = Twist::from_vector(&(found - common)).exp();
            if *count > 0.0 {
                source.scatter = (squares / count).max(LEAST_SCATTER * LEAST_SCATTER);
            }
        }
    }

    /// What all displacements share would be the target's: the priors' mean of those that were seen.
    fn common(&self, found: &[Vector6<f64>], seen: &[bool]) -> Vector6<f64> {
        let (mut weight, mut sum) = (Matrix6::zeros(), Vector6::zeros());
        for ((source, found), _) in self.sources.iter().zip(found).zip(seen).filter(|(_, seen)| **seen) {
            weight += source.prior;
            sum += source.prior * found;
        }
        weight.try_inverse().map_or_else(Vector6::zeros, |inverse| inverse * sum)
    }

    /// How well all sensors together know directions, rad²: across an axis, one axis.
    pub(super) fn common_tilt_variance(&self, axis: &Vector3<f64>) -> f64 {
        let mut weight = Matrix6::zeros();
        for (number, source) in self.sources.iter().enumerate() {
            if self.fixes.iter().any(|fix| fix.sensor == number && fix.noise.is_some()) {
                weight += source.prior;
            }
        }
        let Some(covariance) = weight.try_inverse() else { return 0.0 };
        let turn: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into();
        (turn.trace() - axis.dot(&(turn * axis))) / 2.0
    }
}

/// The covariance of `Log(pose · truth⁻¹)` of an information in the target's axes.
fn left_noise(pose: &Isometry3<f64>, information: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    let (turn, shift) = (FLOOR.0 * FLOOR.0, FLOOR.1 * FLOOR.1);
    let noise = (information + Matrix6::identity() * LEAST_INFORMATION).try_inverse()?
        + Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    let to_left = adjoint(pose);
    let noise = to_left * noise * to_left.transpose();
    noise.iter().all(|value| value.is_finite()).then_some(noise)
}
