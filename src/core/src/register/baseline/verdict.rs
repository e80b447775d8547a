//! How a pose found by whatever method is judged: by the distances of the sparse cloud's points from the dense cloud's
//! surface, and by nothing the method itself believes.

use super::prepare::Prepared;
use crate::neighbours::Neighbours;
use crate::register::{Doubt, Registration};
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, SymmetricEigen, Translation3, Vector3, Vector6};
use tumbled_model::se3::{adjoint, skew};

/// A point with no surface point within this, m, is off the surface.
const ON_SURFACE_M: f64 = 0.06;
/// Support falls to e^−½ at this distance from the surface, m.
const SUPPORT_SIGMA_M: f64 = 0.02;
/// Neighbours that make the surface's plane.
const NEIGHBOURS: usize = 20;
/// Share of points needed on the surface, and support needed (method.md §4.6).
const LEAST_INLIERS: f64 = 0.35;
const LEAST_SUPPORT: f64 = 0.6;
/// Residuals may be so many times what noise explains.
const MOST_RESIDUAL: f64 = 2.0;
/// Information of the weakest direction relative to the median's below which a pose is not held.
pub(crate) const LEAST_INFORMATION: f64 = 0.02;
/// Residuals of neighbouring points are alike: so many are worth one, and all together never more than
const POINTS_PER_SAMPLE: f64 = 4.0;
/// this many.
const MOST_SAMPLES: f64 = 90.0;
/// What no number of points takes away: 0.3° and 3 mm, about the target's centre.
const FLOOR: [f64; 2] = [5.236e-3, 3e-3];

/// How well a pose fits.
#[derive(Clone, Debug)]
pub(crate) struct Verdict {
    /// Mean of exp(−δ²/2σ²) over the sparse points, δ their distances from the surface.
    pub(crate) support: f64,
    /// Share of sparse points on the surface.
    pub(crate) inliers: f64,
    /// Root mean square of their distances from it, m.
    pub(crate) rmse_m: f64,
    /// What noise explains of it, m.
    pub(crate) expected_m: f64,
    /// Of the left perturbation in the reference's frame, from the residuals found.
    pub(crate) covariance: Matrix6<f64>,
    /// The weakest direction and its information over the median's.
    pub(crate) weakest: (Vector6<f64>, f64),
}

/// Judges a pose (moving → reference).
///
/// The residual of a sparse point is its height over the plane of the dense points nearest to it; its derivative by a left
/// twist in the reference's frame is ±(x × n, n), whichever of the clouds is the dense one.
pub(crate) fn judge(pose: &Isometry3<f64>, moving: &Prepared, reference: &Prepared) -> Verdict {
    let moving_is_dense = moving.points().len() > reference.points().len();
    let (dense, sparse) = if moving_is_dense { (moving, reference) } else { (reference, moving) };
    let t_dense_sparse = if moving_is_dense { pose.inverse() } else { *pose };
    // Everything that goes into the information is in the reference's frame.
    let t_reference_dense = if moving_is_dense { *pose } else { Isometry3::identity() };
    let center = t_reference_dense * dense.centroid();
    let mut scratch = Neighbours::with_capacity(NEIGHBOURS);
    let (mut support, mut count, mut squares, mut noise) = (0.0, 0.0, 0.0, 0.0);
    let mut information = Matrix6::zeros();
    for point in sparse.points() {
        let at = t_dense_sparse * point.cast::<f64>();
        let query: Point3<f32> = at.cast();
        let Some((nearest, _)) = dense.tree().nearest(&query, (ON_SURFACE_M * ON_SURFACE_M) as f32) else { continue };
        let plane =
            dense.points().get(nearest as usize).and_then(|p| dense.nearest_moments(p, NEIGHBOURS, &mut scratch));
        let Some(plane) = plane else { continue };
        let height = plane.normal.dot(&(at - plane.mean));
        let (sigma_sparse, sigma_dense) = (sparse.noise_m(&point.cast()), dense.noise_m(&plane.mean));
        let variance = sigma_sparse * sigma_sparse + sigma_dense * sigma_dense;
        let normal = t_reference_dense.rotation * plane.normal;
        let jacobian = twist_row(&(t_reference_dense * at - center), &normal);
        information += jacobian * jacobian.transpose() / variance;
        support += libm::exp(-0.5 * height * height / (SUPPORT_SIGMA_M * SUPPORT_SIGMA_M));
        count += 1.0;
        squares += height * height;
        noise += variance;
    }
    let all = sparse.points().len() as f64;
    let mean = |sum: f64| if count > 0.0 { sum / count } else { 0.0 };
    let (rmse_m, expected_m) = (mean(squares).sqrt(), mean(noise).sqrt());
    let excess = if expected_m > 0.0 { (rmse_m / expected_m).max(1.0) } else { 1.0 };
    let radius = dense.radius_m();
    let worth = POINTS_PER_SAMPLE.max(count / MOST_SAMPLES) * excess * excess;
    Verdict {
        support: support / all,
        inliers: count / all,
        rmse_m,
        expected_m,
        covariance: covariance(&(information / worth), &center, radius),
        weakest: weakest(&information, radius),
    }
}

impl Verdict {
    /// What is wrong with the pose.
    pub(crate) fn doubts(&self) -> Vec<Doubt> {
        let mut doubts = Vec::new();
        if self.inliers < LEAST_INLIERS {
            doubts.push(Doubt::Support { found: self.inliers, needed: LEAST_INLIERS });
        } else if self.support < LEAST_SUPPORT {
            doubts.push(Doubt::Support { found: self.support, needed: LEAST_SUPPORT });
        }
        if self.weakest.1 < LEAST_INFORMATION {
            doubts.push(Doubt::Degenerate { information: self.weakest.1 });
        }
        doubts.extend(residuals(self.rmse_m, self.expected_m));
        doubts
    }

    /// The answer with this verdict, after the doubts the method has itself.
    pub(crate) fn registration(self, pose: Isometry3<f64>, iterations: u32, mut doubts: Vec<Doubt>) -> Registration {
        doubts.extend(self.doubts());
        Registration {
            t_reference_moving: pose,
            covariance: self.covariance,
            accepted: doubts.is_empty(),
            doubts,
            score: self.support,
            gap: None,
            probability: 1.0,
            inliers: self.inliers,
            rmse_m: self.rmse_m,
            weakest: self.weakest,
            iterations,
            alternatives: Vec::new(),
        }
    }
}

/// The doubt that residuals raise.
pub(crate) fn residuals(found_m: f64, expected_m: f64) -> Option<Doubt> {
    (found_m > MOST_RESIDUAL * expected_m).then_some(Doubt::Residuals { found_m, expected_m })
}

/// `(x × n, n)`: how far a point at x moves along n with a twist.
fn twist_row(x: &Vector3<f64>, n: &Vector3<f64>) -> Vector6<f64> {
    let turn = x.cross(n);
    Vector6::new(turn.x, turn.y, turn.z, n.x, n.y, n.z)
}

/// How pairs of points fit a motion found from them.
pub(crate) struct PairFit {
    /// Of a left twist about `center`, as of pairs with unit variance.
    pub(crate) information: Matrix6<f64>,
    /// Their weighted centroid, m.
    pub(crate) center: Point3<f64>,
    /// Root mean square distance of a pair, m.
    pub(crate) rms_m: f64,
    /// Variance of one coordinate of a pair, m².
    pub(crate) variance: f64,
}

impl PairFit {
    /// Of moved points, where they should be, and weights; at least three.
    pub(crate) fn of(pairs: impl Iterator<Item = (Point3<f64>, Point3<f64>, f64)> + Clone) -> Self {
        let (mut count, mut total, mut sum) = (0.0, 0.0, Vector3::zeros());
        for (moved, _, weight) in pairs.clone() {
            count += 1.0;
            total += weight;
            sum += moved.coords * weight;
        }
        let center = Point3::from(sum / total);
        let (mut turn, mut cross) = (Matrix3::zeros(), Matrix3::zeros());
        let mut squares = 0.0;
        for (moved, target, weight) in pairs {
            let weight = weight * count / total;
            // A left twist moves y by (−[y]×, I).
            let y = skew(&(moved - center));
            turn -= y * y * weight;
            cross += y * weight;
            squares += weight * (moved - target).norm_squared();
        }
        let mut information = Matrix6::zeros();
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
        information.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        information.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * count));
        // Three residuals a pair, six of them used up.
        let freedom = (3.0 * count - 6.0).max(1.0);
        Self { information, center, rms_m: (squares / count).sqrt(), variance: squares / freedom }
    }

    /// The covariance about the origin that their residuals give. A perfect fit is no certainty: their variance is at least
    /// that of the points' noise, m.
    pub(crate) fn covariance(&self, noise_m: f64, radius_m: f64) -> Matrix6<f64> {
        let worth = self.variance.max(noise_m * noise_m) * POINTS_PER_SAMPLE;
        covariance(&(self.information / worth), &self.center, radius_m)
    }
}

/// The covariance of a left twist about the origin from the information about `center`, the floor added there: about the
/// origin 0.3° would be another 1.6 cm at 3 m. Directions without information get what is known of any pose: within half
/// a turn, and within the target's radius.
pub(crate) fn covariance(information: &Matrix6<f64>, center: &Point3<f64>, radius_m: f64) -> Matrix6<f64> {
    let [rotation, translation] = FLOOR;
    let anything = core::f64::consts::PI;
    let diagonal = |angle: f64, length: f64| {
        let (a, l) = (angle * angle, length * length);
        Matrix6::from_diagonal(&Vector6::new(a, a, a, l, l, l))
    };
    let least = diagonal(1.0 / anything, 1.0 / radius_m);
    let about_center = (information + least).cholesky().map_or(diagonal(anything, radius_m), |factor| factor.inverse());
    let there = adjoint(&Isometry3::from(Translation3::from(center.coords)));
    let moved = there * (about_center + diagonal(rotation, translation)) * there.transpose();
    // Symmetric to the last bit, which the products are not.
    (moved + moved.transpose()) * 0.5
}

/// The direction of least information about the target's centre, lengths in units of the radius, and its share of the
/// median direction's.
pub(crate) fn weakest(information: &Matrix6<f64>, radius_m: f64) -> (Vector6<f64>, f64) {
    // A turn by 1 moves the rim by the radius: so much does a step by one radius.
    let mut scale = Matrix6::identity();
    scale.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * radius_m));
    let eigen = SymmetricEigen::new(scale * information * scale);
    let (least, value) = eigen.eigenvalues.argmin();
    let mut values: [f64; 6] = eigen.eigenvalues.into();
    values.sort_by(f64::total_cmp);
    let [_, _, low, high, _, _] = values;
    let median = 0.5 * (low + high);
    let share = if median > 0.0 { (value / median).clamp(0.0, 1.0) } else { 0.0 };
    (eigen.eigenvectors.column(least).into_owned(), share)
}
