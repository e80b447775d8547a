//! The methods others use, as they use them, to be compared with.
//!
//! * [`icp`]: point to point, the closed form of [`cga::align`](crate::cga::align()) in every iteration;
//! * [`plane_icp`]: point to plane; [`gicp`]: distribution to distribution, every point a small disc (Segal et al. 2009);
//!   both by Levenberg–Marquardt with the constants of small_gicp;
//! * [`cbd()`]: a curvature-based descriptor (Kleppe et al. 2018), as far as it is public;
//! * `prepare`: what all need of a cloud; `verdict`: how a pose is judged, the same for all.
//!
//! The first three start from a prior, or from the clouds' centroids laid on each other without a turn. None looks for a
//! second mode: `gap` is `None` and `probability` 1.

pub mod cbd;
mod newton;
mod point;
pub(crate) mod prepare;
pub(crate) mod verdict;

pub use cbd::{CbdOptions, cbd};
pub use newton::{gicp, plane_icp};
pub use point::icp;

use super::{Cloud, Prior, RegisterError};
use nalgebra::{Isometry3, Translation3};
use prepare::Prepared;

/// Which cloud's points are looked for: the target stays, each point of the other, the source, finds its nearest there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The reference, whatever it is.
    Reference,
    /// The cloud of fewer points: more pairs, slower.
    Sparser,
    /// The cloud of more points: better normals, fewer pairs.
    Denser,
}

/// How the iterated methods run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IterationOptions {
    /// Which cloud is the target.
    pub target: Target,
    /// Points farther apart than this are no pair, m.
    pub max_distance_m: f64,
    /// A step that turns less than this, rad, and
    pub rotation_epsilon_rad: f64,
    /// moves the source's origin less than this, m, is the last.
    pub translation_epsilon_m: f64,
    /// Iterations at most.
    pub max_iterations: u32,
    /// Points that make a point's plane.
    pub neighbours: usize,
}

impl IterationOptions {
    /// For [`icp`] and [`gicp`]: 15 cm; 0.1° and 1 mm, ten neighbours as small_gicp has them; 50 iterations; the sparser
    /// cloud as target, the better of the two for these on our pairs.
    pub const fn points() -> Self {
        Self {
            target: Target::Sparser,
            max_distance_m: 0.15,
            rotation_epsilon_rad: 0.1 * core::f64::consts::PI / 180.0,
            translation_epsilon_m: 1e-3,
            max_iterations: 50,
            neighbours: 10,
        }
    }

    /// For [`plane_icp`]: the same with the denser cloud as target; a sparse one has no normals to speak of.
    pub const fn planes() -> Self {
        Self { target: Target::Denser, ..Self::points() }
    }
}

/// Two clouds in the parts of source and target.
struct Parts {
    moving: Prepared,
    reference: Prepared,
    /// The target is the moving cloud: what is found is the inverse.
    swapped: bool,
}

impl Parts {
    fn new(moving: &Cloud, reference: &Cloud, target: Target) -> Result<Self, RegisterError> {
        let (moving, reference) = (Prepared::new(moving, "moving")?, Prepared::new(reference, "reference")?);
        let swapped = match target {
            Target::Reference => false,
            Target::Sparser => moving.points().len() < reference.points().len(),
            Target::Denser => moving.points().len() > reference.points().len(),
        };
        Ok(Self { moving, reference, swapped })
    }

    fn source(&self) -> &Prepared {
        if self.swapped { &self.reference } else { &self.moving }
    }

    fn target(&self) -> &Prepared {
        if self.swapped { &self.moving } else { &self.reference }
    }

    /// Source coordinates to target coordinates: the prior, or centroid to centroid.
    fn start(&self, prior: Option<&Prior>) -> Result<Isometry3<f64>, RegisterError> {
        let pose = match prior {
            Some(prior) => {
                super::check::check_prior(prior)?;
                prior.t_reference_moving
            }
            None => Translation3::from(self.reference.centroid() - self.moving.centroid()).into(),
        };
        Ok(self.turned(&pose))
    }

    /// From moving → reference to source → target, and back.
    fn turned(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        if self.swapped { pose.inverse() } else { *pose }
    }
}

/// How an iteration ended.
struct Ended {
    /// Source to target.
    pose: Isometry3<f64>,
    iterations: u32,
    converged: bool,
}

impl Ended {
    /// The answer: judged, with what the iteration itself had to say.
    fn registration(self, parts: &Parts) -> super::Registration {
        let mut doubts = Vec::new();
        if !self.converged {
            doubts.push(super::Doubt::NotConverged { iterations: self.iterations });
        }
        let pose = parts.turned(&self.pose);
        verdict::judge(&pose, &parts.moving, &parts.reference).registration(pose, self.iterations, doubts)
    }
}
