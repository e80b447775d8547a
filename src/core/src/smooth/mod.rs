//! All frames of a session at once: where the target was at each, how it turned, and how each sensor's cloud is displaced.
//!
//! The filter knows the past only, and one frame's fit scatters by its sensor's noise. Here every frame takes part in every
//! pose (a fixed-interval smoother; design note `method.md` §7.4 and §8):
//!
//! ```text
//!   frames laid on the whole model ─▶ forward and backward over a motion that is nearly steady (pass)
//!                                       ▲                     │
//!                                       └── each sensor's ◀───┤   round by round, for several liberties of the motion;
//!                                           displacement,     ▼   the likeliest one stays
//!                                           scatter, outliers    poses, spin, and how well they are known
//! ```
//!
//! The motion is a twist about the middle of the target's path, in the rig's axes, that wanders: constant for a turntable
//! wherever the target's origin lies, and slowly changing for a body that tumbles.

mod fixes;
mod pass;
#[cfg(test)]
mod tests;

use crate::ukf::SensorPrior;
use fixes::Fixes;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3};
use pass::{Node, Pass};
use tumbled_model::RigNs;

/// How freely the rate may wander, rad/s^1.5: from a turntable's drive to a body that tumbles fast.
const LIBERTIES: [f64; 6] = [1e-6, 3e-5, 3e-4, 3e-3, 3e-2, 3e-1];
/// Rounds of displacements, scatter and outliers: to tell which liberty is the likeliest, and with that one.
const ROUNDS: (usize, usize) = (2, 6);
/// Fewer frames tell nothing of a motion.
const LEAST_FRAMES: usize = 4;

/// Where one frame fits the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedPose {
    /// The frame's time.
    pub t: RigNs,
    /// The sensor's number.
    pub sensor: usize,
    /// Target's frame to rig.
    pub t_rig_target: Isometry3<f64>,
    /// Of its error (θ, ρ) in the target's axes, 1/rad² and 1/m², as of [`Fit`](crate::track::Fit). `None`: the frame did
    /// not fit, and its pose is to come from the others alone.
    pub information: Option<Matrix6<f64>>,
}

/// How the target turned, on the whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanSpin {
    /// Mean angular velocity, rig frame, rad/s.
    pub rate_rps: Vector3<f64>,
    /// One standard deviation of its length, rad/s: the frames' scatter.
    pub sigma_rate_rps: f64,
    /// Of its direction, rad, for one axis across it: the frames' scatter, and how well it is known how the sensors look.
    pub sigma_axis_rad: f64,
    /// How far the direction wandered from the mean, rad: root mean square. 0 for a fixed axis.
    pub wander_rad: f64,
}

/// A session's motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothed {
    /// Of each frame, in the order given: where the target was, in the rig.
    pub t_rig_target: Vec<Isometry3<f64>>,
    /// Where each frame's points lie on the target: the same, displaced as its sensor's cloud is.
    pub placed: Vec<Isometry3<f64>>,
    /// Its turning.
    pub spin: MeanSpin,
    /// How each sensor's cloud is displaced, rig frame: `seen pose = displacement · pose`.
    pub displacements: Vec<Isometry3<f64>>,
    /// By how much each sensor's poses scatter more than their points' noise says.
    pub scatter: Vec<f64>,
    /// How freely the rate wanders, rad/s^1.5: the likeliest of six.
    pub liberty: f64,
}

/// The motion that the fits of one target's frames show; `priors` by sensors' numbers, with the nominal place about where
/// the target is. `None`: fewer than four fits, or of one time, or of a sensor without a prior.
pub fn smooth(poses: &[FittedPose], priors: &[SensorPrior]) -> Option<Smoothed> {
    let fixes = Fixes::new(poses, priors)?;
    if fixes.fitted() < LEAST_FRAMES || fixes.duration_s() <= 0.0 {
        return None;
    }
    let settled = LIBERTIES.iter().filter_map(|liberty| Settled::new(fixes.clone(), *liberty)?.after(ROUNDS.0));
    let best = settled.max_by(|a, b| a.pass.log_likelihood.total_cmp(&b.pass.log_likelihood))?;
    Some(best.after(ROUNDS.1)?.told(poses.len()))
}

/// What the rounds come to with one liberty.
struct Settled {
    fixes: Fixes,
    pass: Pass,
    liberty: f64,
}

impl Settled {
    fn new(fixes: Fixes, liberty: f64) -> Option<Self> {
        let pass = pass::run(&fixes, liberty, None)?;
        Some(Self { fixes, pass, liberty })
    }

    fn after(mut self, rounds: usize) -> Option<Self> {
        for _ in 0..rounds {
            self.fixes.learn(&self.pass);
            let start = self.pass.nodes.first().map(|node| node.twist);
            self.pass = pass::run(&self.fixes, self.liberty, start)?;
        }
        self.pass.log_likelihood.is_finite().then_some(self)
    }

    fn told(&self, count: usize) -> Smoothed {
        let center = self.fixes.center();
        let mut t_rig_target = vec![Isometry3::identity(); count];
        let mut placed = t_rig_target.clone();
        for (fix, node) in self.fixes.all().iter().zip(&self.pass.nodes) {
            let displaced = self.fixes.displacement(fix.sensor) * node.pose;
            if let (Some(pose), Some(place)) = (t_rig_target.get_mut(fix.number), placed.get_mut(fix.number)) {
                (*pose, *place) = (center * node.pose, center * displaced);
            }
        }
        let displacement = |sensor| center * self.fixes.displacement(sensor) * center.inverse();
        Smoothed {
            t_rig_target,
            placed,
            spin: self.spin(),
            displacements: (0..self.fixes.sensors()).map(displacement).collect(),
            scatter: self.fixes.scatter(),
            liberty: self.liberty,
        }
    }

    /// The mean over the time, with the σ of the moment in the middle: a mean is known no worse.
    fn spin(&self) -> MeanSpin {
        let nodes = &self.pass.nodes;
        let mut mean = Vector3::zeros();
        let mut time = 0.0;
        let between = || self.fixes.all().windows(2).zip(nodes.windows(2));
        for (fixes, pair) in between() {
            let ([a, b], [from, to]) = (fixes, pair) else { continue };
            mean += (from.rate() + to.rate()) * (0.5 * (b.t_s - a.t_s));
            time += b.t_s - a.t_s;
        }
        mean /= time;
        let wander = nodes.iter().map(|node| {
            let angle = across(&mean, &node.rate());
            angle * angle
        });
        let speed = mean.norm();
        let axis = mean / speed.max(f64::MIN_POSITIVE);
        let covariance = nodes.get(nodes.len() / 2).map_or_else(Matrix3::zeros, Node::rate_covariance);
        let along = axis.dot(&(covariance * axis)).max(0.0);
        let aside = (covariance.trace() - along).max(0.0) / 2.0;
        let tilt = self.fixes.common_tilt_variance(&axis);
        MeanSpin {
            rate_rps: mean,
            sigma_rate_rps: libm::sqrt(along),
            sigma_axis_rad: libm::sqrt(aside / (speed * speed).max(f64::MIN_POSITIVE) + tilt),
            wander_rad: libm::sqrt(wander.sum::<f64>() / nodes.len() as f64),
        }
    }
}

/// The angle between two directions, rad; 0 where one is none.
fn across(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    libm::atan2(a.cross(b).norm(), a.dot(b))
}
