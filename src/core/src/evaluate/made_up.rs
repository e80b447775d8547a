//! A turntable and estimates of it, for the tests of this module.

use super::{EstimateSample, Trajectory, TruthSample};
use nalgebra::{Isometry3, Vector3};
use tumbled_model::{RigNs, Twist};

/// 20 °/s: a revolution in 18 s.
pub(super) const RATE: f64 = 20.0 / 180.0 * core::f64::consts::PI;
/// Estimates are a hundredth of a revolution apart: 180 ms.
pub(super) const STEP_NS: i64 = 180_000_000;

/// A turntable about z through (2.5, 0, 0); the target's origin 0.3 m off its axis, along x at time 0.
pub(super) fn turntable_pose(seconds: f64) -> Isometry3<f64> {
    let turn = Twist::new(Vector3::z() * (RATE * seconds), Vector3::zeros()).exp();
    Isometry3::translation(2.5, 0.0, 0.0) * turn * Isometry3::translation(0.3, 0.0, 0.0)
}

/// 20 s of it, a sample every `step_ns`.
pub(super) fn turntable_truth(step_ns: i64) -> Trajectory {
    let sample = |t: i64| TruthSample {
        t: RigNs(t),
        t_rig_target: turntable_pose(t as f64 * 1e-9),
        angular_velocity_rps: Vector3::z() * RATE,
    };
    Trajectory::new((0..=20_000_000_000 / step_ns).map(|n| sample(n * step_ns)).collect()).expect("in order")
}

/// Another body frame: 120° about (1, 1, 1), and a few centimetres away.
pub(super) fn other_frame() -> Isometry3<f64> {
    let axis = Vector3::repeat(1.0 / libm::sqrt(3.0));
    Twist::new(axis * (core::f64::consts::TAU / 3.0), Vector3::new(0.02, -0.03, 0.05)).exp()
}

/// Right estimates of one revolution, in another body frame: 100 of them.
pub(super) fn right() -> Vec<EstimateSample> {
    (0..100)
        .map(|n| {
            let t = n * STEP_NS;
            let pose = turntable_pose(t as f64 * 1e-9) * other_frame();
            let arm = pose.translation.vector - Vector3::new(2.5, 0.0, 0.0);
            EstimateSample {
                t: RigNs(t),
                t_rig_target: pose,
                velocity_mps: (Vector3::z() * RATE).cross(&arm),
                angular_velocity_rps: Vector3::z() * RATE,
                covariance: None,
                nis: None,
                momentum: None,
            }
        })
        .collect()
}

/// +1 and −1 in turn, two by two: uncorrelated with [`in_turn`].
pub(super) fn by_pairs(n: usize) -> f64 {
    if n % 4 < 2 { 1.0 } else { -1.0 }
}

/// +1 and −1 in turn.
pub(super) fn in_turn(n: usize) -> f64 {
    if n.is_multiple_of(2) { 1.0 } else { -1.0 }
}
