//! The filter's beginning: from several poses of which some may be wrong.
//!
//! Every pair of a sensor's first poses makes a motion at constant rate; the one that most others agree with wins. Least
//! squares over those gives rates with their covariance. The filter then starts at the first of them with a wide prior and
//! takes every pose as an update, the first included: what is wrong with it is e and b, and the filter has to know that.

use super::dynamics::{Deviation, Kinematics};
use super::options::{PoseMeasurement, SensorPrior};
use super::root::{Root, add_mapped};
use super::state::{CENTER, INERTIA, RATE, SensorState, Setup, State, VELOCITY};
use core::f64::consts::PI;
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, SMatrix, SVector, Translation3, Vector3};
use tumbled_model::se3::{exp_rotation, left_jacobian, log_rotation, skew};
use tumbled_model::{RigNs, Twist};

/// Poses within this of a sensor's first make the consensus, s; six of a slower sensor.
const WINDOW_S: f64 = 1.0;
const LEAST_WINDOW: usize = 6;
/// The most poses in the consensus: the evenly spaced ones of more.
const MOST: usize = 32;
/// A turn between two poses beyond this could as well be the other way round, rad.
const MOST_TURN: f64 = 150.0 / 180.0 * PI;
/// A pose agrees within so many standard deviations.
const AGREES: f64 = 4.0;
/// What agrees with fewer poses is no motion.
const LEAST_POSES: usize = 3;
/// A motion made from less than this share of the window predicts too little of it.
const LEAST_BASELINE: f64 = 1.0 / 3.0;
/// Rounds of least squares.
const ROUNDS: u32 = 8;
/// The prior of the pose: rotation, rad, and translation, m.
const POSE_PRIOR: (f64, f64) = (2.0 / 180.0 * PI, 0.03);
/// The narrowest priors of velocity, m/s, and angular velocity, rad/s.
const RATE_PRIOR: (f64, f64) = (0.02, 1.0 / 180.0 * PI);
/// The window's poses are used again as updates: their own covariance is made so much wider that they count once.
const WIDER: f64 = 5.0;

/// A constant motion: of the frame's origin, rig axes, and of the attitude, body axes.
#[derive(Clone, Copy, Debug)]
struct Steady {
    t: RigNs,
    pose: Isometry3<f64>,
    velocity: Vector3<f64>,
    rate: Vector3<f64>,
}

impl Steady {
    fn at(&self, t: RigNs) -> Isometry3<f64> {
        let dt = (t - self.t).as_secs_f64();
        let place = self.pose.translation.vector + self.velocity * dt;
        Isometry3::from_parts(Translation3::from(place), self.pose.rotation * exp_rotation(&(self.rate * dt)))
    }

    /// Between two poses; none where they are of one time or too far apart.
    fn between(first: &PoseMeasurement, second: &PoseMeasurement) -> Option<Self> {
        let dt = (second.t - first.t).as_secs_f64();
        let turn = log_rotation(&(first.pose.rotation.inverse() * second.pose.rotation));
        let shift = second.pose.translation.vector - first.pose.translation.vector;
        (dt > 0.0 && turn.norm() < MOST_TURN).then(|| Self {
            t: first.t,
            pose: first.pose,
            velocity: shift / dt,
            rate: turn / dt,
        })
    }

    /// Whether a pose lies where it should, the errors of the two that made the motion carried to it.
    fn agrees(&self, z: &Weighed, baseline_s: f64) -> bool {
        let reach = AGREES * (1.0 + ((z.pose.t - self.t).as_secs_f64() / baseline_s).abs());
        let off = Twist::log(&self.at(z.pose.t).inv_mul(&z.pose.pose));
        off.rotation.norm() < reach * z.sigma.0 && off.translation.norm() < reach * z.sigma.1
    }
}

/// A pose with its covariance and its standard deviations, three axes together.
#[derive(Clone, Copy)]
struct Weighed {
    pose: PoseMeasurement,
    information: Matrix6<f64>,
    sigma: (f64, f64),
}

impl Weighed {
    /// With the sensor's slow error as noise: over the window it may have changed.
    fn new(pose: &PoseMeasurement, prior: &SensorPrior) -> Option<Self> {
        let finite =
            pose.pose.translation.vector.iter().chain(pose.pose.rotation.coords.iter()).chain(&pose.information);
        if !finite.into_iter().all(|value| value.is_finite()) {
            return None;
        }
        let formal = (pose.information + Matrix6::identity()).cholesky()?.inverse();
        let covariance = formal + Matrix6::from_diagonal(&prior.sigma_b.map(|sigma| sigma * sigma + 1e-12));
        let trace = |first: usize| libm::sqrt(covariance.fixed_view::<3, 3>(first, first).trace());
        Some(Self { pose: *pose, information: covariance.cholesky()?.inverse(), sigma: (trace(0), trace(3)) })
    }
}

/// Where a filter begins, and the poses it then takes.
pub(super) struct Start {
    pub(super) state: State,
    pub(super) poses: Vec<PoseMeasurement>,
}

/// A start from poses of any sensors in any order; none where no three of one sensor make a motion.
pub(super) fn start(setup: &Setup, window: &[PoseMeasurement]) -> Option<Start> {
    let mut poses = window.to_vec();
    poses.sort_by_key(|pose| (pose.t, pose.sensor));
    let best = (0..setup.priors.len())
        .filter_map(|sensor| consensus(setup, &poses, sensor))
        .reduce(|best, other| if other.1.len() > best.1.len() { other } else { best })?;
    let (motion, agreed, refused) = best;
    let (motion, covariance) = least_squares(motion, &agreed)?;
    let first = agreed.first()?.pose;
    let poses = poses.into_iter().filter(|pose| pose.t >= first.t && !refused.contains(pose)).collect();
    Some(Start { state: prior(setup, &first, &motion, &covariance)?, poses })
}

type Agreed = (Steady, Vec<Weighed>, Vec<PoseMeasurement>);

/// The motion that most of a sensor's first poses agree with, those that do, and those that do not.
fn consensus(setup: &Setup, poses: &[PoseMeasurement], sensor: usize) -> Option<Agreed> {
    let prior = setup.priors.get(sensor)?;
    let own: Vec<Weighed> =
        poses.iter().filter(|pose| pose.sensor == sensor).filter_map(|pose| Weighed::new(pose, prior)).collect();
    let first = own.first()?.pose.t;
    let early = own.iter().filter(|z| (z.pose.t - first).as_secs_f64() <= WINDOW_S).count().max(LEAST_WINDOW);
    let early = own.get(..early.min(own.len()))?;
    let stride = early.len().div_ceil(MOST);
    let window: Vec<Weighed> = early.iter().step_by(stride).copied().collect();
    let span = (window.last()?.pose.t - first).as_secs_f64();
    let mut best: Option<(usize, f64, Steady)> = None;
    for (index, from) in window.iter().enumerate() {
        for to in window.iter().skip(index + 1) {
            let baseline = (to.pose.t - from.pose.t).as_secs_f64();
            let Some(motion) = Steady::between(&from.pose, &to.pose).filter(|_| baseline >= LEAST_BASELINE * span)
            else {
                continue;
            };
            let agreeing = window.iter().filter(|z| motion.agrees(z, baseline)).count();
            // Of equals the longer baseline; of those the earlier pair.
            if best.is_none_or(|(most, longest, _)| (agreeing, baseline) > (most, longest)) {
                best = Some((agreeing, baseline, motion));
            }
        }
    }
    let (_, baseline, motion) = best?;
    let (agreed, refused): (Vec<Weighed>, Vec<Weighed>) =
        early.iter().copied().partition(|z| motion.agrees(z, baseline));
    (agreed.len() >= LEAST_POSES).then(|| (motion, agreed, refused.iter().map(|z| z.pose).collect()))
}

type Covariance = SMatrix<f64, 12, 12>;

/// The constant motion nearest all poses, and its covariance: body twist of the first pose, velocity, rate.
fn least_squares(mut motion: Steady, poses: &[Weighed]) -> Option<(Steady, Covariance)> {
    let mut normal = Covariance::zeros();
    for _ in 0..ROUNDS {
        normal = Covariance::zeros();
        let mut pull = SVector::<f64, 12>::zeros();
        for z in poses {
            let dt = (z.pose.t - motion.t).as_secs_f64();
            let expected = motion.at(z.pose.t);
            let off = Twist::log(&expected.inv_mul(&z.pose.pose)).vector();
            let turn = motion.rate * dt;
            let back = exp_rotation(&turn).inverse().to_rotation_matrix().into_inner();
            let mut row = SMatrix::<f64, 6, 12>::zeros();
            row.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
            row.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
            let to_body = expected.rotation.inverse().to_rotation_matrix().into_inner();
            row.fixed_view_mut::<3, 3>(3, 6).copy_from(&(to_body * dt));
            // The right Jacobian is the left one of the opposite.
            row.fixed_view_mut::<3, 3>(0, 9).copy_from(&(left_jacobian(&-turn) * dt));
            let weighed = row.transpose() * z.information;
            normal += weighed * row;
            pull += weighed * off;
        }
        let step = normal.cholesky()?.solve(&pull);
        let twist: Vector3<f64> = step.fixed_rows::<3>(0).into();
        motion.pose.translation.vector += motion.pose.rotation * step.fixed_rows::<3>(3);
        motion.pose.rotation *= exp_rotation(&twist);
        motion.velocity += step.fixed_rows::<3>(6);
        motion.rate += step.fixed_rows::<3>(9);
    }
    let is_finite = motion.rate.iter().chain(motion.velocity.iter()).all(|value| value.is_finite());
    Some((motion, normal.cholesky()?.inverse())).filter(|_| is_finite)
}

/// The state before the first pose: at that pose, moving as found, everything wide.
fn prior(setup: &Setup, first: &PoseMeasurement, motion: &Steady, covariance: &Covariance) -> Option<State> {
    let width = |at: usize, least: f64| {
        let trace: f64 = covariance.fixed_view::<3, 3>(at, at).trace();
        (WIDER * libm::sqrt(trace / 3.0)).max(least)
    };
    let mut sigmas = Deviation::zeros();
    sigmas.fixed_rows_mut::<3>(0).fill(POSE_PRIOR.0);
    sigmas.fixed_rows_mut::<3>(3).fill(POSE_PRIOR.1);
    sigmas.fixed_rows_mut::<3>(VELOCITY).fill(width(VELOCITY, RATE_PRIOR.0));
    sigmas.fixed_rows_mut::<3>(RATE).fill(width(RATE, RATE_PRIOR.1));
    sigmas.fixed_rows_mut::<3>(CENTER).fill(setup.options.sigma_center_of_mass_m);
    sigmas.fixed_rows_mut::<5>(INERTIA).fill(setup.options.sigma_inertia);
    let mut root = Root::diagonal(&setup.sigmas(&sigmas));
    if setup.layout.core > CENTER {
        root = with_center(&root, &first.pose, &motion.rate);
    }
    let target = Kinematics {
        pose: first.pose,
        velocity: motion.velocity,
        rate: motion.rate,
        center: Vector3::zeros(),
        inertia: SVector::zeros(),
    };
    let sensors = vec![SensorState::default(); setup.priors.len()];
    Some(State { t: first.t, target: target.normalized(), sensors, root, refused: 0 })
        .filter(|state| state.is_sound(setup))
}

/// What was seen to move is the origin: where the centre of mass lies says how that itself moves, `v = v_o + R (ω × c)`.
fn with_center(root: &Root, pose: &Isometry3<f64>, rate: &Vector3<f64>) -> Root {
    let map: Matrix3<f64> = pose.rotation.to_rotation_matrix().into_inner() * skew(rate);
    let mut rows: DMatrix<f64> = root.rows().clone();
    add_mapped(&mut rows, VELOCITY, root.rows(), CENTER, &map);
    Root::of(rows)
}

#[cfg(test)]
mod tests;
