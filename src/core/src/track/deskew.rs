//! Points measured one after another, moved to where they were at one time.

use nalgebra::{Point3, Vector3};
use tumbled_model::se3::exp_rotation;

/// How a body moves over a short while: a steady turn about its centre of mass, and a steady drift of that. All in the rig's
/// frame, at the epoch's time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigMotion {
    /// Angular velocity, rad/s, rig axes.
    pub angular_rps: Vector3<f64>,
    /// Velocity of the centre of mass, m/s, rig axes.
    pub velocity_mps: Vector3<f64>,
    /// The centre of mass, m.
    pub center: Point3<f64>,
}

impl RigMotion {
    /// No motion, or none that is known.
    pub const STILL: Self = Self {
        angular_rps: Vector3::new(0.0, 0.0, 0.0),
        velocity_mps: Vector3::new(0.0, 0.0, 0.0),
        center: Point3::new(0.0, 0.0, 0.0),
    };

    /// Where a point of the body is at the epoch's time that was measured at `point` (rig frame, m) `dt_s` seconds after it.
    pub fn to_epoch(&self, point: &Point3<f64>, dt_s: f64) -> Point3<f64> {
        if dt_s == 0.0 || *self == Self::STILL {
            return *point;
        }
        let arm = point - self.center - self.velocity_mps * dt_s;
        self.center + exp_rotation(&(self.angular_rps * -dt_s)) * arm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(reach: f64) -> impl Strategy<Value = Vector3<f64>> {
        (-reach..reach, -reach..reach, -reach..reach).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn a_body_s_points_come_together_at_the_epoch(
            angular in vector(1.0), velocity in vector(0.2), center in vector(3.0), arm in vector(1.0), dt in -0.1..0.1f64,
        ) {
            let motion = RigMotion { angular_rps: angular, velocity_mps: velocity, center: center.into() };
            // The body's own motion: the arm turns by ω dt, its centre drifts by v dt.
            let later = Point3::from(center + velocity * dt + exp_rotation(&(angular * dt)) * arm);
            prop_assert!((motion.to_epoch(&later, dt) - Point3::from(center + arm)).norm() < 1e-13);
        }
    }

    #[test]
    fn without_the_motion_a_metre_s_arm_at_20_degrees_a_second_is_2_9_mm_off_after_8_3_ms() {
        let motion = RigMotion { angular_rps: Vector3::z() * 20f64.to_radians(), ..RigMotion::STILL };
        let moved = motion.to_epoch(&Point3::new(1.0, 0.0, 0.0), 1.0 / 120.0);
        // 0.349 rad/s · 8.33 ms · 1 m = 2.909 mm, back against the turn.
        assert!((moved.y + 2.909e-3).abs() < 1e-6, "{moved}");
    }
}
