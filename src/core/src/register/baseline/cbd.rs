//! A curvature-based descriptor of Kleppe and others, reconstructed.
//!
//! It is cited as of 2018 and, to our knowledge, was published twice: A. L. Kleppe and O. Egeland, "A curvature-based
//! descriptor for point cloud alignment using conformal geometric algebra", Advances in Applied Clifford Algebras 28, and
//! A. L. Kleppe, L. Tingelstad and O. Egeland, "Coarse alignment for model fitting of point clouds using a curvature-based
//! descriptor", IEEE Transactions on Automation Science and Engineering 16. Neither text was at hand: titles and places are
//! second-hand, and so is which of the two is meant.
//!
//! **Certain** is the outline alone: keypoints are chosen by shape factors, so that they lie where a body has features; a
//! keypoint's descriptor comes from two spheres that are fitted to its surroundings in conformal geometric algebra and
//! describe the local curvature; keypoints with like descriptors are paired, and the pairs give a coarse alignment. No code
//! and no constants are public. **Ours** are therefore: which shape factors (the least planar points first), the distance
//! between keypoints, that the two spheres are those of two concentric balls, the five numbers of the descriptor, which
//! pairs are believed (those that agree in their distances from each other), and every default (among the best of 48 tried
//! on one set of 36 simulated pairs). Take its figures for those of this reconstruction, not of the authors' program.

use super::prepare::{Moments, Prepared};
use super::verdict::{PairFit, judge};
use crate::cga::{PointPair, align, fit_sphere};
use crate::register::{Cloud, Doubt, RegisterError, Registration};
use nalgebra::{Isometry3, Point3, Translation3};

/// The choices of the reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CbdOptions {
    /// Keypoints of a cloud at most.
    pub keypoints: usize,
    /// Radii of the two balls, m, the smaller first. The smaller one decides what a keypoint is.
    pub radii_m: [f64; 2],
    /// Keypoints are at least so far apart, m.
    pub spacing_m: f64,
    /// Paired descriptors differ by less in every entry.
    pub epsilon: f64,
    /// A keypoint is paired with so many of its most alike at most.
    pub alternatives: usize,
    /// Two pairs agree when the distances between their keypoints differ by less, m.
    pub tolerance_m: f64,
    /// Pairs needed.
    pub least_pairs: usize,
}

impl Default for CbdOptions {
    fn default() -> Self {
        Self {
            keypoints: 100,
            radii_m: [0.15, 0.30],
            spacing_m: 0.05,
            epsilon: 0.25,
            alternatives: 12,
            tolerance_m: 0.07,
            least_pairs: 4,
        }
    }
}

/// A keypoint and its descriptor.
#[derive(Clone, Copy, Debug)]
struct Keypoint {
    point: Point3<f64>,
    /// Curvature × radius of either sphere, the cosine between their normals, linear and planar shape factor.
    entries: [f64; 5],
}

/// A pair of keypoints that are alike.
#[derive(Clone, Copy, Debug)]
struct Match {
    moving: Point3<f64>,
    reference: Point3<f64>,
}

/// Registers by curvature-based descriptors. It takes no prior.
///
/// # Errors
/// Clouds that are none.
pub fn cbd(moving: &Cloud, reference: &Cloud, options: &CbdOptions) -> Result<Registration, RegisterError> {
    let (moving, reference) = (Prepared::new(moving, "moving")?, Prepared::new(reference, "reference")?);
    let matches = matches(&keypoints(&moving, options), &keypoints(&reference, options), options);
    let group = largest_group(&matches, options);
    let solved = (group.len() >= options.least_pairs).then(|| motion(&group, options)).flatten();
    let mut doubts = Vec::new();
    let pose = solved.unwrap_or_else(|| {
        doubts.push(Doubt::Pairs { found: group.len(), needed: options.least_pairs });
        Translation3::from(reference.centroid() - moving.centroid()).into()
    });
    let mut registration = judge(&pose, &moving, &reference).registration(pose, 1, doubts);
    if solved.is_some() {
        // The pose makes the pairs fit, not the surfaces: it is as good as they are.
        let fit = PairFit::of(group.iter().map(|pair| (pose * pair.moving, pair.reference, 1.0)));
        registration.covariance = fit.covariance(reference.noise_m(&reference.centroid()), reference.radius_m());
    }
    Ok(registration)
}

/// The least planar points, not too near to each other, with their descriptors.
fn keypoints(cloud: &Prepared, options: &CbdOptions) -> Vec<Keypoint> {
    let [small, _] = options.radii_m;
    let flatness = |point: &Point3<f32>| {
        let moments = cloud.ball_moments(point, small)?;
        let [_, planar] = moments.shape();
        Some((planar, moments))
    };
    let numbered = cloud.points().iter().zip(0u32..);
    let mut ranked: Vec<(f64, u32, Moments)> = numbered
        .filter_map(|(point, index)| flatness(point).map(|(planar, moments)| (planar, index, moments)))
        .collect();
    ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut chosen: Vec<Keypoint> = Vec::with_capacity(options.keypoints);
    for (_, index, moments) in &ranked {
        if chosen.len() >= options.keypoints {
            break;
        }
        let Some(point) = cloud.point(*index) else { continue };
        if chosen.iter().all(|other| (other.point - point).norm() >= options.spacing_m) {
            chosen.extend(describe(cloud, &point, moments, options));
        }
    }
    chosen
}

/// A keypoint's descriptor. `None`: one of the spheres does not exist.
fn describe(cloud: &Prepared, point: &Point3<f64>, moments: &Moments, options: &CbdOptions) -> Option<Keypoint> {
    let query: Point3<f32> = point.cast();
    let sphere = |radius_m: f64| {
        let mut members = Vec::new();
        cloud.tree().within(&query, (radius_m * radius_m) as f32, |index, _| {
            members.extend(cloud.point(index).map(|member| (member, 1.0)));
        });
        let surface = fit_sphere(members.into_iter()).ok()?.surface;
        // Convex or hollow is known where it is known which side is outside.
        let outside = cloud.viewpoint().map(|viewpoint| surface.normal.dot(&(viewpoint - point)).signum());
        let curvature = outside.map_or(surface.curvature.abs(), |side| side * surface.curvature);
        Some((surface.normal, (curvature * radius_m).clamp(-2.0, 2.0)))
    };
    let [small, large] = options.radii_m;
    let ((near, near_curvature), (far, far_curvature)) = (sphere(small)?, sphere(large)?);
    let [linear, planar] = moments.shape();
    Some(Keypoint { point: *point, entries: [near_curvature, far_curvature, near.dot(&far).abs(), linear, planar] })
}

/// Each moving keypoint with the reference keypoints most like it.
fn matches(moving: &[Keypoint], reference: &[Keypoint], options: &CbdOptions) -> Vec<Match> {
    let mut matches = Vec::new();
    for keypoint in moving {
        let difference = |other: &Keypoint| {
            keypoint.entries.iter().zip(&other.entries).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let mut alike: Vec<(f64, u32, &Keypoint)> =
            reference.iter().zip(0..).map(|(other, index)| (difference(other), index, other)).collect();
        alike.retain(|candidate| candidate.0 < options.epsilon);
        alike.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let taken = alike.iter().take(options.alternatives);
        matches.extend(taken.map(|(_, _, other)| Match { moving: keypoint.point, reference: other.point }));
    }
    matches
}

/// Whether one rigid motion can make both pairs, as far as their distances say.
fn agree(a: &Match, b: &Match, options: &CbdOptions) -> bool {
    let (moving, reference) = ((a.moving - b.moving).norm(), (a.reference - b.reference).norm());
    // Pairs that share a keypoint, or nearly, say nothing about a rotation.
    moving.min(reference) > options.spacing_m && (moving - reference).abs() < options.tolerance_m
}

/// The largest set of pairs that all agree, as far as growing one from each pair, the most agreed with first, finds it.
fn largest_group(matches: &[Match], options: &CbdOptions) -> Vec<Match> {
    let friends = |of: &Match| matches.iter().filter(|other| agree(of, other, options)).count();
    let mut order: Vec<(usize, &Match)> = matches.iter().map(|of| (friends(of), of)).collect();
    // Stable: of equals the first.
    order.sort_by_key(|ranked| core::cmp::Reverse(ranked.0));
    let mut largest: Vec<Match> = Vec::new();
    for (seed_friends, seed) in &order {
        // A group holds its seed and friends of it.
        if *seed_friends < largest.len() {
            break;
        }
        let mut group = vec![**seed];
        for (_, candidate) in &order {
            if group.iter().all(|member| agree(member, candidate, options)) {
                group.push(**candidate);
            }
        }
        if group.len() > largest.len() && motion(&group, options).is_some() {
            largest = group;
        }
    }
    largest
}

/// The motion a group stands for. `None`: it fixes none, or it is a mirror image (distances cannot tell), which leaves
/// residuals.
fn motion(group: &[Match], options: &CbdOptions) -> Option<Isometry3<f64>> {
    let pairs: Vec<PointPair> = group
        .iter()
        .map(|pair| PointPair { point: pair.moving, center: pair.reference, weight: 1.0 / group.len() as f64 })
        .collect();
    let found = align(&pairs, &[]).ok()?;
    // The cost is the mean square: pairs that agree lie within the keypoints' spacing.
    (found.cost.sqrt() < options.spacing_m).then(|| found.motor.isometry())
}
