//! Once forward and once backward: an extended Kalman filter of pose and twist, and Rauch's, Tung's and Striebel's smoother.
//!
//! The state's error is (ε, δ): `truth = Exp(ε) pose`, `twist + δ`. Over dt: `pose ← Exp(ξ dt) pose`, `ε ← Ad ε + J dt δ`.
//! (Barfoot, State Estimation for Robotics, ch. 3 and 8.)

use super::fixes::{Fix, Fixes};
use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, SVector, Vector3, Vector6};
use tumbled_model::Twist;
use tumbled_model::se3::adjoint;

/// Of the first twist, rad/s and m/s.
const SIGMA_START: (f64, f64) = (3.0, 3.0);
/// A velocity wanders as a rate does at this distance, m.
const ARM_M: f64 = 0.3;
/// The twist to begin with: from a frame so long after the first, s.
const START_S: f64 = 0.25;

type Square = SMatrix<f64, 12, 12>;

/// Pose and twist at a frame.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Rig's axes, origin in the middle of the path.
    pub(super) pose: Isometry3<f64>,
    /// Rotation, rad/s, then translation at the middle, m/s: rig's axes.
    pub(super) twist: Vector6<f64>,
    covariance: Square,
}

impl Node {
    pub(super) fn rate(&self) -> Vector3<f64> {
        self.twist.fixed_rows::<3>(0).into()
    }

    pub(super) fn rate_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(6, 6).into()
    }

    /// Of ε.
    pub(super) fn pose_covariance(&self) -> Matrix6<f64> {
        self.covariance.fixed_view::<6, 6>(0, 0).into()
    }

    fn moved(&self, step: &SVector<f64, 12>) -> Self {
        let pose = Twist::from_vector(&step.fixed_rows::<6>(0).into()).exp() * self.pose;
        Self { pose, twist: self.twist + step.fixed_rows::<6>(6), covariance: self.covariance }
    }

    /// What leads from another to this.
    fn step_from(&self, other: &Self) -> SVector<f64, 12> {
        let mut step = SVector::<f64, 12>::zeros();
        step.fixed_rows_mut::<6>(0).copy_from(&Twist::log(&(self.pose * other.pose.inverse())).vector());
        step.fixed_rows_mut::<6>(6).copy_from(&(self.twist - other.twist));
        step
    }
}

/// What one pass came to.
#[derive(Clone, Debug)]
pub(super) struct Pass {
    /// One for each fix.
    pub(super) nodes: Vec<Node>,
    /// Of the fits, given those before them; up to a constant.
    pub(super) log_likelihood: f64,
}

/// Forward and back, from a twist to begin with. `None`: there is none, or something is not finite.
pub(super) fn run(fixes: &Fixes, liberty: f64, start: Option<Vector6<f64>>) -> Option<Pass> {
    let mut node = begin(fixes, start)?;
    let mut log_likelihood = 0.0;
    let (mut filtered, mut predicted) = (Vec::with_capacity(fixes.all().len()), Vec::new());
    let mut last: Option<&Fix> = None;
    for fix in fixes.all() {
        if let Some(last) = last {
            let (ahead, transition) = predict(&node, fix.t_s - last.t_s, liberty);
            node = ahead.clone();
            predicted.push((ahead, transition));
        }
        if let Some((pose, noise)) = fixes.measured(fix) {
            log_likelihood += update(&mut node, &pose, &noise)?;
        }
        filtered.push(node.clone());
        last = Some(fix);
    }
    Some(Pass { nodes: back(filtered, &predicted)?, log_likelihood })
}

/// At the first fix, with hardly anything known.
fn begin(fixes: &Fixes, start: Option<Vector6<f64>>) -> Option<Node> {
    let mut fitted = fixes.all().iter().filter_map(|fix| Some((fix.t_s, fixes.measured(fix)?.0)));
    let (t_first, pose) = fitted.next()?;
    let twist = start.or_else(|| {
        let (t, later) = fitted.clone().find(|(t, _)| t - t_first >= START_S).or_else(|| fitted.next_back())?;
        let turn = Twist::log(&(later * pose.inverse())).vector();
        (t > t_first).then(|| turn / (t - t_first))
    })?;
    let first_s = fixes.all().first()?.t_s;
    let pose = Twist::from_vector(&(twist * (first_s - t_first))).exp() * pose;
    let (turn, shift) = (SIGMA_START.0 * SIGMA_START.0, SIGMA_START.1 * SIGMA_START.1);
    let twist_covariance = Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    let nothing = Matrix6::zeros();
    let covariance = square(&Matrix6::identity(), &nothing, &nothing, &twist_covariance);
    Some(Node { pose, twist, covariance })
}

/// The state `dt` s later, and how its error came of the one before.
fn predict(node: &Node, dt: f64, liberty: f64) -> (Node, Transition) {
    let step = Twist::from_vector(&(node.twist * dt));
    let motion = step.exp();
    let jacobian = step.left_jacobian();
    let transition = Transition { of_pose: adjoint(&motion), of_twist: jacobian * dt };
    let (turn, shift) = (liberty * liberty, liberty * liberty * ARM_M * ARM_M);
    let wander = Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    let carried = transition.carried(&node.covariance);
    let [pose, across, twist]: [Matrix6<f64>; 3] =
        [(0, 0), (0, 6), (6, 6)].map(|(row, column)| carried.fixed_view::<6, 6>(row, column).into());
    let pose = pose * transition.of_pose.transpose()
        + across * transition.of_twist.transpose()
        + jacobian * wander * jacobian.transpose() * (dt * dt * dt / 3.0);
    let across = across + jacobian * wander * (dt * dt / 2.0);
    let covariance = symmetric(&square(&pose, &across, &across.transpose(), &(twist + wander * dt)));
    (Node { pose: motion * node.pose, twist: node.twist, covariance }, transition)
}

/// Takes a pose in; its log likelihood.
fn update(node: &mut Node, pose: &Isometry3<f64>, noise: &Matrix6<f64>) -> Option<f64> {
    let off = Twist::log(&(pose * node.pose.inverse())).vector();
    let spread = (node.pose_covariance() + noise).cholesky()?;
    let seen: SMatrix<f64, 12, 6> = node.covariance.fixed_view::<12, 6>(0, 0).into();
    let gain = seen * spread.inverse();
    let step = gain * off;
    let covariance = symmetric(&(node.covariance - gain * seen.transpose()));
    *node = Node { covariance, ..node.moved(&step) };
    let log_determinant: f64 = spread.l_dirty().diagonal().iter().map(|entry| 2.0 * libm::log(*entry)).sum();
    Some(-0.5 * (off.dot(&spread.solve(&off)) + log_determinant))
}

/// Every state by what came after it too.
fn back(filtered: Vec<Node>, predicted: &[(Node, Transition)]) -> Option<Vec<Node>> {
    let mut smoothed: Vec<Node> = Vec::with_capacity(filtered.len());
    for (k, node) in filtered.into_iter().enumerate().rev() {
        let Some((next, (ahead, transition))) = smoothed.last().zip(predicted.get(k)) else {
            smoothed.push(node);
            continue;
        };
        let gain = ahead.covariance.cholesky()?.solve(&transition.carried(&node.covariance)).transpose();
        let covariance = symmetric(&(node.covariance + gain * (next.covariance - ahead.covariance) * gain.transpose()));
        let moved = node.moved(&(gain * next.step_from(ahead)));
        smoothed.push(Node { covariance, ..moved });
    }
    smoothed.reverse();
    smoothed.iter().all(|node| node.twist.iter().all(|value| value.is_finite())).then_some(smoothed)
}

/// How the error of a state comes of the one before: `ε ← of_pose ε + of_twist δ`.
struct Transition {
    of_pose: Matrix6<f64>,
    of_twist: Matrix6<f64>,
}

impl Transition {
    /// Times a covariance.
    fn carried(&self, covariance: &Square) -> Square {
        let [pose, across, back, twist]: [Matrix6<f64>; 4] =
            [(0, 0), (0, 6), (6, 0), (6, 6)].map(|(row, column)| covariance.fixed_view::<6, 6>(row, column).into());
        square(
            &(self.of_pose * pose + self.of_twist * back),
            &(self.of_pose * across + self.of_twist * twist),
            &back,
            &twist,
        )
    }
}

fn square(a: &Matrix6<f64>, b: &Matrix6<f64>, c: &Matrix6<f64>, d: &Matrix6<f64>) -> Square {
    let mut square = Square::zeros();
    for (block, row, column) in [(a, 0, 0), (b, 0, 6), (c, 6, 0), (d, 6, 6)] {
        square.fixed_view_mut::<6, 6>(row, column).copy_from(block);
    }
    square
}

fn symmetric(matrix: &Square) -> Square {
    (matrix + matrix.transpose()) * 0.5
}
