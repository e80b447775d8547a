//! Where the target really was.

use super::EvaluateError;
use nalgebra::{Isometry3, Vector3};
use tumbled_model::{RigNs, Span, Twist};

/// Samples farther apart say nothing of what was between them.
const LONGEST_GAP: Span = Span(500_000_000);
/// Nor do those between which the target turned farther than this, rad: the way round is not known.
const FARTHEST_TURN: f64 = 2.0;
/// Velocity is the difference over twice this: at 20 °/s and 1 m from the axis 0.7 µm/s off.
const STEP: Span = Span(10_000_000);

/// The true pose at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthSample {
    /// When.
    pub t: RigNs,
    /// Target coordinates, of the truth's own target frame, to rig coordinates.
    pub t_rig_target: Isometry3<f64>,
    /// Rig axes, rad/s.
    pub angular_velocity_rps: Vector3<f64>,
}

/// The true motion: samples, and between two of them the screw from one to the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    samples: Vec<TruthSample>,
}

/// The truth at a time, of the truth's own target frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TruthAt {
    pub(super) pose: Isometry3<f64>,
    /// Rig axes, rad/s.
    pub(super) angular_velocity: Vector3<f64>,
    /// Of the frame's origin, rig axes, m/s.
    pub(super) velocity: Vector3<f64>,
}

impl Trajectory {
    /// From samples in the order of their times.
    ///
    /// # Errors
    /// [`EvaluateError::FewTruth`], [`EvaluateError::TruthOutOfOrder`].
    pub fn new(samples: Vec<TruthSample>) -> Result<Self, EvaluateError> {
        if samples.len() < 2 {
            return Err(EvaluateError::FewTruth { found: samples.len() });
        }
        let pairs = samples.iter().zip(samples.iter().skip(1));
        match pairs.zip(1..).find(|((before, after), _)| before.t >= after.t) {
            Some((_, sample)) => Err(EvaluateError::TruthOutOfOrder { sample }),
            None => Ok(Self { samples }),
        }
    }

    /// The first and the last time.
    pub fn span(&self) -> (RigNs, RigNs) {
        let t = |sample: Option<&TruthSample>| sample.map_or(RigNs(0), |sample| sample.t);
        (t(self.samples.first()), t(self.samples.last()))
    }

    /// `None`: outside the samples, or in a gap of half a second or of 115° between them.
    pub(super) fn at(&self, t: RigNs) -> Option<TruthAt> {
        let (pose, angular_velocity) = self.between(t)?;
        let here = |t: RigNs| Some((t, self.between(t)?.0));
        // At the ends the difference is one-sided.
        let (from, before) = here(t - STEP).unwrap_or((t, pose));
        let (to, after) = here(t + STEP).unwrap_or((t, pose));
        let seconds = (to - from).as_secs_f64();
        let way = after.translation.vector - before.translation.vector;
        let velocity = if seconds > 0.0 { way / seconds } else { return None };
        Some(TruthAt { pose, angular_velocity, velocity })
    }

    fn between(&self, t: RigNs) -> Option<(Isometry3<f64>, Vector3<f64>)> {
        let next = self.samples.partition_point(|sample| sample.t <= t);
        let before = self.samples.get(next.checked_sub(1)?)?;
        let Some(after) = self.samples.get(next) else {
            // The last sample's own time is the truth's too.
            return (before.t == t).then_some((before.t_rig_target, before.angular_velocity_rps));
        };
        let gap = after.t - before.t;
        let twist = Twist::log(&(before.t_rig_target.inverse() * after.t_rig_target));
        if before.t != t && (gap > LONGEST_GAP || twist.rotation.norm() > FARTHEST_TURN) {
            return None;
        }
        let share = (t - before.t).as_secs_f64() / gap.as_secs_f64();
        let pose = before.t_rig_target * Twist::from_vector(&(twist.vector() * share)).exp();
        Some((pose, before.angular_velocity_rps.lerp(&after.angular_velocity_rps, share)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::made_up::{RATE, turntable_pose, turntable_truth};

    #[test]
    fn between_samples_a_turntable_turns_on() {
        // 20 °/s, samples 100 ms apart: the screw between two is the motion itself.
        let truth = turntable_truth(100_000_000);
        for t in [0, 30_000_000, 1_234_567_890] {
            let at = truth.at(RigNs(t)).expect("truth");
            let expected = turntable_pose(t as f64 * 1e-9);
            assert!((at.pose.translation.vector - expected.translation.vector).norm() < 1e-12);
            assert!(at.pose.rotation.angle_to(&expected.rotation) < 1e-7);
            assert!((at.angular_velocity - Vector3::z() * RATE).norm() < 1e-12);
            // v = ω × r about the turntable's middle, to v ω² h²/6 in the middle and v ω h/2 at the ends.
            let v = Vector3::z()
                .cross(&(expected.translation.vector - turntable_pose(0.0).translation.vector + Vector3::x() * 0.3))
                * RATE;
            let tolerance = if t == 0 { v.norm() * RATE * 0.005 * 1.01 } else { 1e-6 };
            assert!((at.velocity - v).norm() < tolerance, "{t}: {}", (at.velocity - v).norm());
        }
    }

    #[test]
    fn there_is_no_truth_outside_the_samples_or_in_a_gap() {
        let truth = turntable_truth(100_000_000);
        let (from, to) = truth.span();
        assert!(truth.at(from).is_some() && truth.at(to).is_some());
        assert_eq!((truth.at(from - Span(1)), truth.at(to + Span(1))), (None, None));
        let truth = turntable_truth(600_000_000);
        assert_eq!(truth.at(RigNs(300_000_000)), None);
        // Turned by 2.1 rad within 0.4 s.
        let sample = |t: i64, turn: f64| TruthSample {
            t: RigNs(t),
            t_rig_target: Twist::new(Vector3::z() * turn, Vector3::zeros()).exp(),
            angular_velocity_rps: Vector3::zeros(),
        };
        let truth = Trajectory::new(vec![sample(0, 0.0), sample(400_000_000, 2.1)]).expect("in order");
        assert_eq!(truth.at(RigNs(200_000_000)), None);
    }

    #[test]
    fn samples_are_two_and_in_order() {
        let sample = |t: i64| TruthSample {
            t: RigNs(t),
            t_rig_target: Isometry3::identity(),
            angular_velocity_rps: Vector3::zeros(),
        };
        assert_eq!(Trajectory::new(vec![sample(0)]), Err(EvaluateError::FewTruth { found: 1 }));
        let out_of_order = Trajectory::new(vec![sample(0), sample(2), sample(2)]);
        assert_eq!(out_of_order, Err(EvaluateError::TruthOutOfOrder { sample: 2 }));
    }
}
