//! Where a frame fits the model, and how well that is known.

use super::beams::Evidence;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};
use tumbled_model::se3::skew;

/// A frame's share of points that lie on the model, at least, and their number, for a pose to be believed.
const LEAST_SHARE: f64 = 0.35;
const LEAST_INLIERS: usize = 40;
/// The weakest direction over the median one, at least, for a frame to be inserted. A box seen nearly face-on has 1/200 and
/// must go in, or the next side is never learned; a plane with noise has 1/3000, by the scatter of its normals.
const FIRM: f64 = 1.0 / 300.0;
/// Variance of a surfel's normal, across it, rad²: (3.6°)². With it the roll of a rocket body, which cannot be seen, is known
/// to within what it is off by; with half of it σ is a quarter of that.
const NORMAL_VARIANCE: f64 = 0.004;
/// What is known of any twist beforehand, 1/rad² and 1/m²: the body is in the room. Keeps the information positive.
const ROOM: f64 = 1.0;

/// A frame registered to the model.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The pose at which the frame fits: target's frame to rig.
    pub t_rig_target: Isometry3<f64>,
    /// Of the pose's error ξ = (θ, ρ), rad and m, in the target's axes about the target's origin:
    /// `true pose = t_rig_target · Exp(ξ)`, and ξ scatters by the inverse. From the point-to-plane distances and their
    /// noise alone; directions in which no plane holds have 1/rad² and 1/m². The slow errors of a sensor (calibration,
    /// beams' biases, warp) are not in it.
    pub information: Matrix6<f64>,
    /// Points that found a part of the model within one and a half kernels (or 35 mm).
    pub inliers: usize,
    /// Points there were.
    pub used: usize,
    /// Root mean square of the inliers' distances along the normals, m.
    pub rmse_m: f64,
    /// The least eigenvalue of the information about the inliers' middle over the fourth, rotations measured on their
    /// root mean square arm: 0 where a direction is not seen at all, at most 1.
    pub weakest: f64,
    /// Rounds made.
    pub rounds: u32,
    /// Whether the last step was below 20 µrad and 20 µm.
    pub settled: bool,
    pub(super) evidence: Vec<Evidence>,
}

impl Fit {
    /// Whether the pose is to be believed: enough of the frame lies on the model.
    pub fn is_trusted(&self) -> bool {
        self.inliers >= LEAST_INLIERS && self.covers(LEAST_SHARE)
    }

    /// Whether at least a share of the frame's points, 0..=1, lies on the model.
    pub fn covers(&self, share: f64) -> bool {
        self.inliers as f64 >= share * self.used as f64
    }

    /// Whether every direction of the pose is held well enough to insert the frame into the model.
    pub fn is_firm(&self) -> bool {
        self.weakest >= FIRM
    }
}

/// Sums over the points of a frame at one pose, body axes. Twists here move the points: the pose's own error is their
/// opposite, with the same information.
#[derive(Clone, Copy, Debug)]
pub(super) struct System {
    /// Σ w J Jᵀ of the distances along the normals, J = (x × n, n).
    pub(super) planes: Matrix6<f64>,
    /// Σ w (x × f, f): what pulls, along the normals and, weakly, along the surface.
    pub(super) torque: Vector3<f64>,
    pub(super) force: Vector3<f64>,
    /// Σ w, Σ w x, Σ w x xᵀ.
    pub(super) weight: f64,
    pub(super) moment: Vector3<f64>,
    pub(super) second: Matrix3<f64>,
    /// Σ r².
    pub(super) squares: f64,
    pub(super) inliers: usize,
}

impl System {
    pub(super) fn new() -> Self {
        Self {
            planes: Matrix6::zeros(),
            torque: Vector3::zeros(),
            force: Vector3::zeros(),
            weight: 0.0,
            moment: Vector3::zeros(),
            second: Matrix3::zeros(),
            squares: 0.0,
            inliers: 0,
        }
    }

    /// The matrix of the descent: the planes', and `share` of all weights along the surface. There the whole offset
    /// `K = (−[x]×, I)` less its normal part pulls: Σ w (KᵀK − J Jᵀ).
    pub(super) fn descent(&self, share: f64) -> Matrix6<f64> {
        let mut whole = Matrix6::zeros();
        let turn = Matrix3::identity() * self.second.trace() - self.second;
        let arm = skew(&self.moment);
        whole.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
        whole.fixed_view_mut::<3, 3>(0, 3).copy_from(&arm);
        whole.fixed_view_mut::<3, 3>(3, 0).copy_from(&-arm);
        whole.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * self.weight));
        self.planes * (1.0 - share) + whole * share
    }

    /// What the planes say of the pose, without what the scatter of their normals seems to say: normals n with an error of
    /// variance s across them add s of the tangential part `whole − planes`, most of all where no plane holds, as about the
    /// axis of a body of revolution.
    fn known(&self) -> Matrix6<f64> {
        let known = self.descent(-NORMAL_VARIANCE).symmetric_eigen();
        let floored = Matrix6::from_diagonal(&known.eigenvalues.map(|value| value.max(0.0)));
        known.eigenvectors * floored * known.eigenvectors.transpose()
    }

    /// What the planes say of the pose.
    pub(super) fn information(&self) -> Matrix6<f64> {
        self.known() + Matrix6::identity() * ROOM
    }

    /// See [`Fit::weakest`].
    pub(super) fn weakest(&self) -> f64 {
        if self.weight <= 0.0 {
            return 0.0;
        }
        let middle = Point3::from(self.moment / self.weight);
        let arm_squared = self.second.trace() / self.weight - middle.coords.norm_squared();
        // Not so for what is no number either.
        if !(arm_squared > 0.0 && arm_squared.is_finite()) {
            return 0.0;
        }
        // A twist about the middle c, (θ, ρ'), is (θ, ρ' + c × θ) about the origin; θ in units of one over the arm.
        let scale = 1.0 / arm_squared.sqrt();
        let mut about = Matrix6::identity();
        about.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * scale));
        about.fixed_view_mut::<3, 3>(3, 0).copy_from(&(skew(&middle.coords) * scale));
        let scaled = about.transpose() * self.planes * about;
        let mut eigenvalues: [f64; 6] = scaled.symmetric_eigenvalues().into();
        eigenvalues.sort_by(f64::total_cmp);
        let [least, _, _, fourth, ..] = eigenvalues;
        if least > 0.0 { least / fourth } else { 0.0 }
    }
}
