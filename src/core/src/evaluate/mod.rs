//! How good estimates are, held against the truth.
//!
//! * [`evaluate`]: against full poses ([`Trajectory`]); [`evaluate_turntable`]: against a turntable's encoder;
//! * `gauge`: the body frame is the estimate's own choice, and no error;
//! * `consistency`, [`chi_square_quantile`]: whether the stated covariances hold;
//! * `pose`, `turntable`: the figures.
//!
//! Everything in SI: rad, m, s. Errors of rotation and of the pose are body twists, `ξ = Log(T̂⁻¹ T G)`; G the gauge.

mod chi_square;
mod consistency;
mod gauge;
#[cfg(test)]
mod made_up;
mod pose;
#[cfg(test)]
mod tests;
mod trajectory;
mod turntable;

pub use chi_square::{chi_square_quantile, mean_bounds};
pub use consistency::{Consistency, NormalisedMean};
pub use pose::{Aligned, Alignment, ErrorSample, Evaluation, MotionErrors, PoseErrors, ScalarErrors, evaluate};
pub use trajectory::{Trajectory, TruthSample};
pub use turntable::{EncoderSample, TurntableError, TurntableEvaluation, angle_at, evaluate_turntable};

use nalgebra::{Isometry3, SMatrix, Vector3};
use tumbled_model::RigNs;

/// Covariance of an estimate: θ, ρ (body twist of the pose: rad, m), δv, δω (rig axes: m/s, rad/s), truth less estimate. δω
/// is the whole error of ω in rig axes: where ω is known in body axes, the attitude's error × ω is in it.
pub type Covariance = SMatrix<f64, 12, 12>;

/// What was estimated for one time.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimateSample {
    /// When.
    pub t: RigNs,
    /// Target coordinates, of the estimate's own target frame, to rig coordinates.
    pub t_rig_target: Isometry3<f64>,
    /// Of the target frame's origin, rig axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Rig axes, rad/s.
    pub angular_velocity_rps: Vector3<f64>,
    /// See [`Covariance`].
    pub covariance: Option<Covariance>,
    /// The measurement's normalised innovation square, of six degrees of freedom.
    pub nis: Option<f64>,
    /// The direction of the angular momentum, rig axes, any length above 0.
    pub momentum: Option<Vector3<f64>>,
}

/// What is scored, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EvaluateOptions {
    /// Estimates before this are not scored: the filter settles. `None`: all are.
    pub from: Option<RigNs>,
    /// The gauge where it is known: truth's target frame to the estimate's, so that estimate ≈ truth · gauge.
    pub gauge: Option<Isometry3<f64>>,
    /// The true direction of the angular momentum, rig axes, any length above 0; it stays where no torque acts.
    pub momentum: Option<Vector3<f64>>,
}

/// Why nothing can be scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EvaluateError {
    /// Too little truth.
    #[error("the truth has {found} samples, and two are the least: give one that covers the estimates")]
    FewTruth {
        /// How many there are.
        found: usize,
    },
    /// The truth goes back in time.
    #[error("sample {sample} of the truth is not later than the one before: sort it by time and leave out doubles")]
    TruthOutOfOrder {
        /// Its number, from 0.
        sample: usize,
    },
    /// The estimates go back in time.
    #[error("estimate {estimate} is earlier than the one before: sort them by time")]
    EstimatesOutOfOrder {
        /// Its number, from 0.
        estimate: usize,
    },
    /// Nothing to score.
    #[error(
        "{found} of {estimates} estimates are in the scored interval with truth at their time, and two are the least: \
         do the clocks of both agree, and does the interval begin before the end?"
    )]
    FewEstimates {
        /// How many can be scored.
        found: usize,
        /// Of how many.
        estimates: usize,
    },
    /// The estimates do not turn, so that there is no axis.
    #[error("the estimates turn by {travel_deg}° in all, and 5° are the least for an axis: score a longer interval")]
    NoTurn {
        /// Whole degrees turned.
        travel_deg: u32,
    },
}

/// Estimates may share a time, and never go back.
fn check_order(estimates: &[EstimateSample]) -> Result<(), EvaluateError> {
    let pairs = estimates.iter().zip(estimates.iter().skip(1));
    match pairs.zip(1..).find(|((before, after), _)| before.t > after.t) {
        Some((_, estimate)) => Err(EvaluateError::EstimatesOutOfOrder { estimate }),
        None => Ok(()),
    }
}

/// The angle between two directions, rad, 0..=π; 0 where one has no length.
pub(crate) fn angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    libm::atan2(a.cross(b).norm(), a.dot(b))
}
