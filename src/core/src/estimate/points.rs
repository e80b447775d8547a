//! Points of the target: where they are and how they move, and how well that is known.
//!
//! A point `p` of the target is at `x = o + R p` and moves by `ẋ = v + ω × R p`. With the pose's error as a body twist,
//! `T = T̂ Exp(ξ)`, the rotation is `R̂ (1 + [θ]×)` and the origin `ô + R̂ ρ`; velocity and rate err in rig axes:
//!
//! ```text
//!   δx = −R̂ [p]× θ + R̂ ρ
//!   δẋ = −[ω]× R̂ [p]× θ + δv − [R̂ p]× δω
//! ```

use super::state::TargetMotion;
use nalgebra::{Matrix6, SMatrix, Vector3};
use tumbled_model::se3::skew;

/// A point of the target that somebody wants to know the motion of.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedPoint {
    /// Its name.
    pub name: String,
    /// Target frame, m.
    pub position_m: Vector3<f64>,
}

/// Where a point is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMotion {
    /// Rig frame, m.
    pub position_m: Vector3<f64>,
    /// Rig axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Of position, m², then velocity, (m/s)²; rig axes.
    pub covariance: Matrix6<f64>,
}

impl TargetMotion {
    /// Of a point, target frame, m.
    pub fn point(&self, point: &Vector3<f64>) -> PointMotion {
        let rotation = self.t_rig_target.rotation.to_rotation_matrix().into_inner();
        let (arm, rate) = (rotation * point, self.angular_velocity_rps);
        let swing = -(rotation * skew(point));
        let mut slope = SMatrix::<f64, 6, 12>::zeros();
        slope.fixed_view_mut::<3, 3>(0, 0).copy_from(&swing);
        slope.fixed_view_mut::<3, 3>(0, 3).copy_from(&rotation);
        slope.fixed_view_mut::<3, 3>(3, 0).copy_from(&(skew(&rate) * swing));
        slope.fixed_view_mut::<3, 3>(3, 6).fill_with_identity();
        slope.fixed_view_mut::<3, 3>(3, 9).copy_from(&-skew(&arm));
        let covariance = slope * self.covariance * slope.transpose();
        PointMotion {
            position_m: self.t_rig_target.translation.vector + arm,
            velocity_mps: self.velocity_mps + rate.cross(&arm),
            // Symmetric to the bit, as whoever factors it expects.
            covariance: (covariance + covariance.transpose()) * 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, SVector, Translation3, Vector6};
    use tumbled_model::Twist;
    use tumbled_model::se3::exp_rotation;

    fn motion() -> TargetMotion {
        // Any positive definite covariance with all its correlations: a product of a full matrix with itself.
        let root = SMatrix::<f64, 12, 12>::from_fn(|row, column| {
            0.01 * libm::sin(1.0 + (row * 12 + column) as f64 * 0.7) + if row == column { 0.02 } else { 0.0 }
        });
        TargetMotion {
            t_rig_target: Isometry3::from_parts(
                Translation3::new(2.0, -0.3, 0.4),
                exp_rotation(&Vector3::new(0.4, -0.9, 0.3)),
            ),
            velocity_mps: Vector3::new(0.02, -0.05, 0.01),
            angular_velocity_rps: Vector3::new(0.1, -0.2, 0.35),
            covariance: root * root.transpose(),
            spin: None,
            momentum: None,
        }
    }

    /// A motion with an error of all twelve: θ, ρ, δv, δω.
    fn displaced(motion: &TargetMotion, by: &SVector<f64, 12>) -> TargetMotion {
        let twist: Vector6<f64> = by.fixed_rows::<6>(0).into();
        TargetMotion {
            t_rig_target: motion.t_rig_target * Twist::from_vector(&twist).exp(),
            velocity_mps: motion.velocity_mps + by.fixed_rows::<3>(6),
            angular_velocity_rps: motion.angular_velocity_rps + by.fixed_rows::<3>(9),
            ..motion.clone()
        }
    }

    #[test]
    fn a_points_covariance_is_that_of_finite_differences() {
        const STEP: f64 = 1e-6;
        let (motion, point) = (motion(), Vector3::new(0.3, -0.2, 0.7));
        let mut slope = SMatrix::<f64, 6, 12>::zeros();
        for state in 0..12 {
            let by = SVector::<f64, 12>::ith(state, STEP);
            let (after, before) = (displaced(&motion, &by).point(&point), displaced(&motion, &-by).point(&point));
            let column = &mut slope.column_mut(state);
            column.fixed_rows_mut::<3>(0).copy_from(&((after.position_m - before.position_m) / (2.0 * STEP)));
            column.fixed_rows_mut::<3>(3).copy_from(&((after.velocity_mps - before.velocity_mps) / (2.0 * STEP)));
        }
        let expected = slope * motion.covariance * slope.transpose();
        let off = (motion.point(&point).covariance - expected).abs().max() / expected.abs().max();
        // Central differences of 1e-6: 1e-12 by the third derivative, 1e-10 by rounding.
        assert!(off < 1e-8, "{off:e}");
    }

    #[test]
    fn a_points_velocity_is_how_its_position_changes() {
        const STEP_S: f64 = 1e-6;
        let (motion, point) = (motion(), Vector3::new(0.3, -0.2, 0.7));
        let after = TargetMotion {
            t_rig_target: Isometry3::from_parts(
                Translation3::from(motion.t_rig_target.translation.vector + motion.velocity_mps * STEP_S),
                exp_rotation(&(motion.angular_velocity_rps * STEP_S)) * motion.t_rig_target.rotation,
            ),
            ..motion.clone()
        };
        let moved = (after.point(&point).position_m - motion.point(&point).position_m) / STEP_S;
        assert!((moved - motion.point(&point).velocity_mps).norm() < 1e-6);
    }

    #[test]
    fn the_lever_arm_turns_attitude_into_position() {
        // σ of θ 1 mrad an axis and nothing else; the point 2 m along x: 2 mm across the arm, nothing along it.
        let mut covariance = SMatrix::<f64, 12, 12>::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(1e-6);
        let motion = TargetMotion {
            t_rig_target: Isometry3::identity(),
            velocity_mps: Vector3::zeros(),
            angular_velocity_rps: Vector3::zeros(),
            covariance,
            spin: None,
            momentum: None,
        };
        let variance = motion.point(&Vector3::new(2.0, 0.0, 0.0)).covariance.diagonal();
        let expected = Vector6::new(0.0, 4e-6, 4e-6, 0.0, 0.0, 0.0);
        assert!((variance - expected).norm() < 1e-18, "{variance}");
    }
}
