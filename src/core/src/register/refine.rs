//! The last steps: every probe against the anchored sphere of its nearest patch, in double precision, with the noise of
//! both sensors; and what that says about the pose's uncertainty. Method.md §4.2–4.5.

use crate::cga::AnchoredSphere;
use crate::neighbours::KdTree;
use crate::surface::Surface;
use crate::surface::noise::BEAM_BIAS_M;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, Vector3, Vector6};
use tumbled_model::se3::{adjoint, exp_rotation, log_rotation, skew};

/// Settings of the refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RefineOptions {
    /// The most iterations.
    pub(super) iterations: u32,
    /// The kernel's first scale, m.
    pub(super) from_m: f64,
    /// The kernel's last scale, m: 4.5 cm for a LiDAR's probes, 3 cm for a Kinect's.
    pub(super) to_m: f64,
    /// Whether patches are spheres (else planes).
    pub(super) curvature: bool,
    /// Probes farther than this from their patch, along the surface, have left its rim: they say nothing, m.
    pub(super) rim_m: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self { iterations: 25, from_m: 0.10, to_m: 0.045, curvature: true, rim_m: f64::INFINITY }
    }
}

/// By how much the kernel narrows from iteration to iteration.
const NARROWING: f64 = 0.85;
/// A probe farther than this many kernel scales from its patch belongs to no surface that was seen.
const REJECT: f64 = 1.5;
/// The tangential part's weight: directions that slide along every patch stay bounded.
const TANGENTIAL: f64 = 0.02;
/// Settled: a step shorter than this, rad and m together.
const SETTLED: f64 = 1e-5;
/// Before this many iterations nothing settles: the kernel is still wide.
const EARLIEST: u32 = 8;

/// A probe with its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Probe {
    /// In its sensor's frame, m.
    pub(super) point: Point3<f64>,
    /// Standard deviation along its line of sight, m; a beam's bias apart, where the beam is known.
    pub(super) sigma_m: f64,
    /// Its beam, and its line of sight there: a unit vector in the sensor's frame.
    pub(super) beam: Option<(usize, Vector3<f64>)>,
}

/// What is known beforehand, in the surface's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RefinePrior {
    /// The guess, probes to surface.
    pub(super) transform: Isometry3<f64>,
    /// Standard deviations: rotation, rad; translation at the probes' centroid, m.
    pub(super) sigma: (f64, f64),
}

/// A refined pose.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Refined {
    /// Probes to surface.
    pub(super) transform: Isometry3<f64>,
    /// HᵀWH of the probes alone, for a twist about the image of the probes' centroid, rotation first.
    pub(super) information: Matrix6<f64>,
    /// The prior's, of the same twist.
    pub(super) prior_information: Matrix6<f64>,
    /// The share of the probes that lie on the surface.
    pub(super) inliers: f64,
    /// Their number.
    pub(super) inlier_count: usize,
    /// Root mean square of their distances, m.
    pub(super) rmse_m: f64,
    /// What the noise of both sensors explains, m.
    pub(super) expected_m: f64,
    /// Iterations made.
    pub(super) iterations: u32,
    /// Whether the last step was short enough.
    pub(super) converged: bool,
}

/// Refines a pose.
pub(super) fn refine(
    surface: &Surface,
    probes: &[Probe],
    viewpoint: Option<&Point3<f64>>,
    start: &Isometry3<f64>,
    prior: Option<&RefinePrior>,
    options: &RefineOptions,
) -> Refined {
    let count = probes.len().max(1) as f64;
    let centroid = Point3::from(probes.iter().map(|probe| probe.point.coords).sum::<Vector3<f64>>() / count);
    let mut transform = *start;
    let (mut iterations, mut converged) = (0, false);
    let tree = KdTree::build(surface.points());
    let residuals = Residuals { surface, tree, probes, viewpoint, centroid, options };
    let mut system;
    let beams = probes.iter().filter_map(|probe| probe.beam).map(|(beam, _)| beam + 1).max().unwrap_or(0);
    let mut biases = vec![Bias::default(); beams];
    loop {
        let kernel = (options.from_m * libm::pow(NARROWING, f64::from(iterations))).max(options.to_m);
        system = residuals.system(&transform, kernel, &mut biases);
        if iterations == options.iterations || converged {
            break;
        }
        iterations += 1;
        let (weights, pull) = prior.map_or_else(Default::default, |prior| prior_terms(prior, &transform, &centroid));
        let matrix = system.information + weights + Matrix6::identity() * 1e-9;
        let Some(step) = matrix.cholesky().map(|factor| factor.solve(&-(system.gradient + pull))) else { break };
        transform = stepped(&transform, &centroid, &step);
        converged = iterations > EARLIEST && step.norm() < SETTLED;
    }
    let (weights, _) = prior.map_or_else(Default::default, |prior| prior_terms(prior, &transform, &centroid));
    let inliers = system.inliers.max(1) as f64;
    Refined {
        transform,
        information: system.information,
        prior_information: weights,
        inliers: system.inliers as f64 / count,
        inlier_count: system.inliers,
        rmse_m: libm::sqrt(system.square / inliers),
        expected_m: libm::sqrt(system.variance / inliers),
        iterations,
        converged,
    }
}

/// The transform after a twist about the image of the centroid.
fn stepped(transform: &Isometry3<f64>, centroid: &Point3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let center = transform * centroid;
    let rotation = exp_rotation(&step.fixed_rows::<3>(0).into()) * transform.rotation;
    let moved = center.coords + step.fixed_rows::<3>(3);
    Isometry3::from_parts(Translation3::from(moved - rotation * centroid.coords), rotation)
}

/// The prior's information and gradient.
fn prior_terms(prior: &RefinePrior, at: &Isometry3<f64>, centroid: &Point3<f64>) -> (Matrix6<f64>, Vector6<f64>) {
    let turn = log_rotation(&(at.rotation * prior.transform.rotation.inverse()));
    let shift = at * centroid - prior.transform * centroid;
    let (rotation, translation) = (1.0 / (prior.sigma.0 * prior.sigma.0), 1.0 / (prior.sigma.1 * prior.sigma.1));
    let weights = Vector6::new(rotation, rotation, rotation, translation, translation, translation);
    let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
    (Matrix6::from_diagonal(&weights), weights.component_mul(&error))
}

/// What a scan's residuals say of one beam's bias: its row of the normal equations.
#[derive(Clone, Copy, Default)]
struct Bias {
    own: f64,
    mixed: Vector6<f64>,
    gradient: f64,
}

/// The normal equations at one pose.
#[derive(Default)]
struct System {
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    inliers: usize,
    /// Sum of the inliers' squared distances, m².
    square: f64,
    /// Sum of the variances that the noise explains, m².
    variance: f64,
}

/// Probes, and the surface they are held against.
struct Residuals<'a> {
    surface: &'a Surface,
    tree: KdTree,
    probes: &'a [Probe],
    viewpoint: Option<&'a Point3<f64>>,
    centroid: Point3<f64>,
    options: &'a RefineOptions,
}

impl Residuals<'_> {
    /// The normal equations at a pose.
    fn system(&self, transform: &Isometry3<f64>, kernel: f64, biases: &mut [Bias]) -> System {
        let (surface, options) = (self.surface, self.options);
        let mut system = System::default();
        biases.fill(Bias::default());
        let center = transform * self.centroid;
        let from = self.viewpoint.map(|viewpoint| transform * viewpoint);
        let reach = REJECT * kernel;
        for probe in self.probes {
            let x = transform * probe.point;
            let Some((index, _)) = self.tree.nearest(&x.cast(), reach as f32 * reach as f32) else { continue };
            let Some(patch) = surface.details().get(index as usize) else { continue };
            // Beyond the rim of what was seen the body goes on, out of sight: what lies near there may be of its other side.
            if surface.is_rim(index as usize) {
                continue;
            }
            let offset = x - patch.anchor;
            let height = offset.dot(&patch.normal);
            let along = offset.norm_squared() - height * height;
            if offset.norm_squared() > reach * reach || along > options.rim_m * options.rim_m {
                continue;
            }
            // The sensor that saw the probe saw its surface's front.
            if from.is_some_and(|from| patch.normal.dot(&(from - patch.anchor)) < 0.0) {
                continue;
            }
            let sphere = if options.curvature {
                AnchoredSphere::new(patch.anchor, patch.normal, patch.curvature)
            } else {
                AnchoredSphere::new(patch.mean, patch.normal, 0.0)
            };
            let gradient = sphere.gradient(&x);
            let length = gradient.norm();
            let (residual, normal) = (sphere.product(&x) / length, gradient / length);
            let variance = probe.sigma_m * probe.sigma_m + patch.variance();
            let falloff = 1.0 + (residual / kernel) * (residual / kernel);
            let weight = 1.0 / (falloff * falloff * variance);
            let arm = x - center;
            let row = system.add_row(&arm, &normal, residual, weight);
            if let Some((beam, sight)) = probe.beam
                && let Some(bias) = biases.get_mut(beam)
            {
                let along = normal.dot(&(transform.rotation * sight));
                bias.own += along * along * weight;
                bias.mixed += row * (along * weight);
                bias.gradient += along * residual * weight;
            }
            system.add_tangential(&arm, &normal, &(x - patch.anchor), TANGENTIAL * weight);
            system.inliers += 1;
            system.square += residual * residual;
            system.variance += variance;
        }
        system.without(biases);
        system
    }
}

impl System {
    fn add_row(&mut self, arm: &Vector3<f64>, normal: &Vector3<f64>, residual: f64, weight: f64) -> Vector6<f64> {
        let turn = arm.cross(normal);
        let row = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
        self.information += row * row.transpose() * weight;
        self.gradient += row * (weight * residual);
        row
    }

    /// Every beam's bias may be what it is, about zero: what is left speaks of the pose alone (the Schur complement).
    fn without(&mut self, biases: &[Bias]) {
        let prior = LEAST_FACTOR / (BEAM_BIAS_M * BEAM_BIAS_M);
        for bias in biases {
            let per = 1.0 / (bias.own + prior);
            self.information -= bias.mixed * bias.mixed.transpose() * per;
            self.gradient -= bias.mixed * (bias.gradient * per);
        }
    }

    /// The offset along the surface, all but ignored.
    fn add_tangential(&mut self, arm: &Vector3<f64>, normal: &Vector3<f64>, offset: &Vector3<f64>, weight: f64) {
        let along = Matrix3::identity() - normal * normal.transpose();
        let cross = skew(arm);
        let turn = cross * along;
        let (rotation, mixed) = (turn * cross.transpose() * weight, turn * weight);
        let mut block = self.information.fixed_view_mut::<3, 3>(0, 0);
        block += rotation;
        let mut block = self.information.fixed_view_mut::<3, 3>(0, 3);
        block += mixed;
        let mut block = self.information.fixed_view_mut::<3, 3>(3, 0);
        block += mixed.transpose();
        let mut block = self.information.fixed_view_mut::<3, 3>(3, 3);
        block += along * weight;
        let flat = along * offset * weight;
        let turned = cross * flat;
        self.gradient += Vector6::new(turned.x, turned.y, turned.z, flat.x, flat.y, flat.z);
    }
}

/// Independent residuals a scan of a target of 1.3 m never has more of: neighbours share a surface's roughness, a beam's
/// bias, a pattern's error. Chosen so that the squared errors of right poses have their covariance's mean (method.md §4.5
/// has 90 and 4, for residuals of planes without rims; ours leave out what lies beyond a surface's rim).
const INDEPENDENT: f64 = 250.0;
/// Residuals for each independent one, at least.
const LEAST_FACTOR: f64 = 1.2;
/// What no registration is better than: rotation, rad, and translation, m.
const FLOOR: (f64, f64) = (0.3 / 180.0 * core::f64::consts::PI, 0.003);

impl Refined {
    /// How many residuals count as one.
    pub(super) fn factor(&self) -> f64 {
        (self.inlier_count as f64 / INDEPENDENT).max(LEAST_FACTOR)
    }

    /// Covariance of the twist about the image of the probes' centroid.
    fn about_center(&self, widening: f64) -> Matrix6<f64> {
        let information = self.information / (self.factor() * widening) + self.prior_information;
        let regular = information + Matrix6::identity() * 1e-9;
        let covariance = regular.try_inverse().unwrap_or_else(|| Matrix6::identity() * 1e9);
        let (rotation, translation) = (FLOOR.0 * FLOOR.0, FLOOR.1 * FLOOR.1);
        let floor = Vector6::new(rotation, rotation, rotation, translation, translation, translation);
        covariance + Matrix6::from_diagonal(&floor)
    }

    /// Covariance of the left twist at the surface frame's origin, rotation first.
    pub(super) fn covariance(&self, centroid: &Point3<f64>, widening: f64) -> Matrix6<f64> {
        let center = self.transform * centroid;
        let to_origin = adjoint(&Isometry3::from_parts(Translation3::from(center.coords), Default::default()));
        let covariance = to_origin * self.about_center(widening) * to_origin.transpose();
        (covariance + covariance.transpose()) * 0.5
    }

    /// Standard deviations of the three axes together: rotation, rad, and translation at the centroid, m.
    pub(super) fn sigma(&self, widening: f64) -> (f64, f64) {
        let covariance = self.about_center(widening);
        let trace = |first: usize| covariance.fixed_view::<3, 3>(first, first).trace();
        (libm::sqrt(trace(0)), libm::sqrt(trace(3)))
    }

    /// The direction that the probes say least about, as a unit twist about the centroid with translations in units of
    /// `radius_m`, and its information relative to the median direction's.
    pub(super) fn weakest(&self, radius_m: f64) -> (Vector6<f64>, f64) {
        let unit = Vector6::new(1.0, 1.0, 1.0, radius_m, radius_m, radius_m);
        let scaled = Matrix6::from_diagonal(&unit) * self.information * Matrix6::from_diagonal(&unit);
        let eigen = scaled.symmetric_eigen();
        let mut order: Vec<usize> = (0..6).collect();
        let value = |index: &usize| eigen.eigenvalues.get(*index).copied().unwrap_or(0.0);
        order.sort_by(|a, b| value(a).total_cmp(&value(b)));
        let (least, median) = (order.first().copied().unwrap_or(0), order.get(3).map_or(0.0, value));
        let share = if median > 0.0 { (value(&least) / median).max(0.0) } else { 0.0 };
        (eigen.eigenvectors.column(least).into_owned(), share)
    }
}

#[cfg(test)]
mod tests;
