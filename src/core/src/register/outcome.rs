//! What a registration answers.

use nalgebra::{Isometry3, Matrix6, Vector6};

/// A registration of a moving cloud onto a reference cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Registration {
    /// Coordinates of the moving cloud to coordinates of the reference.
    pub t_reference_moving: Isometry3<f64>,
    /// Covariance of the twist ξ in `Exp(ξ) T` (left perturbation, the reference's frame), rotation first: rad², m².
    pub covariance: Matrix6<f64>,
    /// Whether it may be used as a measurement. If not, it is the best candidate all the same, and `doubts` say why.
    pub accepted: bool,
    /// Why it was not accepted; empty: it was.
    pub doubts: Vec<Doubt>,
    /// How well it explains what both sensors saw: 1 and more is very well.
    pub score: f64,
    /// By how much the best other mode scores less; `None`: no other was looked for, or none was found.
    pub gap: Option<f64>,
    /// The probability of this mode among those found, 0..=1; 1 where no other was looked for.
    pub probability: f64,
    /// The share of the sparse cloud's points that lie on the dense surface.
    pub inliers: f64,
    /// Root mean square distance of the inliers from the surface, m.
    pub rmse_m: f64,
    /// The direction the clouds say least about, as a unit twist (translation in units of the cloud's radius), and its
    /// information relative to the median direction's, 0..=1.
    pub weakest: (Vector6<f64>, f64),
    /// Iterations of the final refinement.
    pub iterations: u32,
    /// The other modes, best first.
    pub alternatives: Vec<Mode>,
}

/// Another pose that explains the clouds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// The pose.
    pub t_reference_moving: Isometry3<f64>,
    /// Its score.
    pub score: f64,
    /// Its probability among the modes found.
    pub probability: f64,
}

/// Why a registration is no measurement.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Doubt {
    /// Little of the sparse cloud lies on the surface.
    #[error("only {found:.2} of the points lie on the surface: {needed:.2} needed")]
    Support {
        /// The share found.
        found: f64,
        /// The share needed.
        needed: f64,
    },
    /// Too few pairs of features were matched.
    #[error("only {found} pairs of points were matched: {needed} needed")]
    Pairs {
        /// Pairs found.
        found: usize,
        /// Pairs needed.
        needed: usize,
    },
    /// Another pose explains the clouds nearly as well.
    #[error("ambiguous: another pose explains the clouds nearly as well (probability {probability:.2} of this one)")]
    Ambiguous {
        /// Of the winner.
        probability: f64,
    },
    /// The pose is not held in every direction.
    #[error("degenerate: the clouds leave a direction open (information {information:.1e} of the median)")]
    Degenerate {
        /// Of the weakest direction, relative to the median.
        information: f64,
    },
    /// The best pose's neighbourhood is flat.
    #[error("vague: poses within {spread_deg:.1} degrees explain the clouds as well")]
    Vague {
        /// Root mean square angle, degrees.
        spread_deg: f64,
    },
    /// The noise of both sensors leaves too much open.
    #[error("uncertain: one standard deviation is {rotation_deg:.1} degrees and {translation_m:.3} m")]
    Uncertain {
        /// Of the three axes together, degrees.
        rotation_deg: f64,
        /// At the sparse cloud's centroid, m.
        translation_m: f64,
    },
    /// The residuals are larger than the noise explains.
    #[error("residuals of {found_m:.4} m where the noise explains {expected_m:.4} m")]
    Residuals {
        /// Found, m.
        found_m: f64,
        /// Expected, m.
        expected_m: f64,
    },
    /// A pose is forbidden by lines of sight: points float where the other sensor looked through.
    #[error("lines of sight forbid it: {violated:.2} of the points lie where the other sensor saw through")]
    LinesOfSight {
        /// The share of such points.
        violated: f64,
    },
    /// The refinement did not settle.
    #[error("did not converge in {iterations} iterations")]
    NotConverged {
        /// How many.
        iterations: u32,
    },
    /// One line of sight is so far from the other that one pair of frames is no proof.
    #[error("the lines of sight are {angle_deg:.0} degrees apart: one pair of frames proves nothing there")]
    FarSights {
        /// Between the two sensors' sights of the target, degrees.
        angle_deg: f64,
    },
}

/// Why there is nothing to register.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// A cloud with too few points.
    #[error("the {cloud} cloud has {found} finite points: at least {needed} are needed")]
    TooFewPoints {
        /// `moving` or `reference`.
        cloud: &'static str,
        /// Finite points found.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// A cloud that fixes no rotation.
    #[error("the {cloud} cloud lies on a line: nothing fixes a rotation about it")]
    Collinear {
        /// `moving` or `reference`.
        cloud: &'static str,
    },
    /// A cloud of an impossible size.
    #[error(
        "the {cloud} cloud is {size_m:.3e} m large: clouds are in metres, 0.05 to 50 m large (millimetres? scale by 0.001)"
    )]
    Size {
        /// `moving` or `reference`.
        cloud: &'static str,
        /// Its largest extent, m.
        size_m: f64,
    },
    /// A prior that is none.
    #[error("the initial guess holds {what}")]
    Prior {
        /// What is wrong with it.
        what: &'static str,
    },
}
