//! A calibration's result from a set of poses, whatever the target.

use nalgebra::{Isometry3, SMatrix, SVector, UnitQuaternion, Vector3};
use tumbled_model::se3::log_rotation;

/// Rotation, translation, depth scale.
pub const PARAMETERS: usize = 7;

/// Over (rotation, rad; translation, m; depth scale): the rotation a perturbation from the left in the LiDAR's frame,
/// `R ← Exp(θ) R`, the translation `t ← t + δ`.
pub type Covariance = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// What a solver found.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Camera coordinates into the LiDAR's.
    pub t_lidar_camera: Isometry3<f64>,
    /// True depth over measured depth; `None`: it was not asked for and is taken as 1.
    pub depth_scale: Option<f64>,
    /// Scaled by the largest of 1 and χ²/dof.
    pub covariance: Covariance,
    /// Squared disagreement of the two sensors over all poses, in the points' own noise.
    pub chi_square: f64,
    /// Of how many degrees of freedom.
    pub freedom: usize,
    /// By pose: the two sensors' disagreement, root of its squared size over three degrees of freedom.
    pub misfits: Vec<f64>,
}

impl Fit {
    /// χ²/dof, 1 at least: what the covariance has been scaled by. Quantisation and a warp of the depth make the points'
    /// own noise too small a measure.
    pub fn variance_factor(&self) -> f64 {
        (self.chi_square / self.freedom.max(1) as f64).max(1.0)
    }

    /// This less another: rotation, translation, scale.
    pub fn minus(&self, other: &Self) -> SVector<f64, PARAMETERS> {
        let scale = self.depth_scale.unwrap_or(1.0) - other.depth_scale.unwrap_or(1.0);
        difference(&self.t_lidar_camera, &other.t_lidar_camera, scale)
    }

    /// One standard deviation about and along the three axes of the LiDAR's frame, rad and m, and of the scale.
    pub fn sigma(&self) -> [f64; PARAMETERS] {
        core::array::from_fn(|n| self.covariance.get((n, n)).copied().unwrap_or_default().max(0.0).sqrt())
    }

    /// The largest shift of one parameter in its standard deviations; those that are not known exactly alone count.
    pub fn largest_shift(shift: &SVector<f64, PARAMETERS>, sigma: &[f64; PARAMETERS]) -> f64 {
        let ratio = |(shift, sigma): (&f64, &f64)| if *sigma > 0.0 { shift.abs() / sigma } else { 0.0 };
        shift.iter().zip(sigma).map(ratio).fold(0.0, f64::max)
    }
}

/// `a` less `b` as parameters.
pub fn difference(a: &Isometry3<f64>, b: &Isometry3<f64>, scale: f64) -> SVector<f64, PARAMETERS> {
    let rotation = log_rotation(&(a.rotation * b.rotation.inverse()));
    let translation = a.translation.vector - b.translation.vector;
    let mut difference = SVector::<f64, PARAMETERS>::zeros();
    difference.fixed_rows_mut::<3>(0).copy_from(&rotation);
    difference.fixed_rows_mut::<3>(3).copy_from(&translation);
    difference.fixed_rows_mut::<1>(6).copy_from(&SVector::<f64, 1>::new(scale));
    difference
}

/// The rotation that takes directions to directions best, weights ≥ 0 (Kabsch).
pub(crate) fn rotation_onto<'a>(
    pairs: impl Iterator<Item = (&'a Vector3<f64>, &'a Vector3<f64>, f64)>,
) -> Option<UnitQuaternion<f64>> {
    let products = pairs.fold(nalgebra::Matrix3::zeros(), |sum, (from, to, w)| sum + from * to.transpose() * w);
    let svd = products.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?.transpose());
    let sign = (v * u.transpose()).determinant().signum();
    let middle = nalgebra::Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    let matrix = v * middle * u.transpose();
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(matrix);
    Some(UnitQuaternion::from_rotation_matrix(&rotation))
}

/// A set of poses that no result can be had from.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Unsolved {
    /// Too few.
    #[error("{found} poses, at least {least} are needed")]
    TooFew {
        /// Poses there are.
        found: usize,
        /// Poses there must be.
        least: usize,
    },
    /// What they show does not fix it.
    #[error("the poses do not fix all six parameters: they are too alike")]
    Degenerate,
    /// No three poses agree on one place of the sensors.
    #[error("no three poses agree with each other: the target was taken for something else, or it moved")]
    NoConsensus,
}
