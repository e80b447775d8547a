//! From pose to pose with rests between: boards held before a rig, targets turned by hand, views of an experiment.

use super::{BodyState, Motion};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use tumbled_model::{RigNs, Span};

/// A place where a body rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The body's frame into the rig's.
    pub pose: Isometry3<f64>,
    /// When it has arrived.
    pub from: RigNs,
    /// When it leaves for the next; the last one it never leaves.
    pub until: RigNs,
}

impl Stop {
    /// The middle of the rest.
    pub fn middle(&self) -> RigNs {
        self.from + Span((self.until - self.from).0 / 2)
    }
}

/// A motion through poses: at rest in each, and from one to the next smoothly, in a straight line and about one axis,
/// velocity and acceleration 0 at both ends.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Poses {
    stops: Vec<Stop>,
}

impl Poses {
    /// A motion that begins at rest in the first pose. Every rest lasts `rest`, and every move `moving`; less than 0 is 0.
    /// Without a pose the body stays where the rig is.
    pub fn new(poses: &[Isometry3<f64>], rest: Span, moving: Span) -> Self {
        let (rest, moving) = (rest.0.max(0), moving.0.max(0));
        let period = rest.saturating_add(moving);
        let stop = |(n, pose): (usize, &Isometry3<f64>)| {
            let from = period.saturating_mul(n as i64);
            Stop { pose: *pose, from: RigNs(from), until: RigNs(from.saturating_add(rest)) }
        };
        Self { stops: poses.iter().enumerate().map(stop).collect() }
    }

    /// The rests, in the order of time.
    pub fn stops(&self) -> &[Stop] {
        &self.stops
    }
}

impl Motion for Poses {
    fn state(&self, t: RigNs) -> BodyState {
        let resting = |pose| BodyState {
            t_rig_body: pose,
            velocity_mps: Vector3::zeros(),
            angular_velocity_rps: Vector3::zeros(),
        };
        // The stop it is in, or has left.
        let at = self.stops.partition_point(|stop| stop.from <= t).saturating_sub(1);
        let Some(here) = self.stops.get(at) else { return resting(Isometry3::identity()) };
        let Some(next) = self.stops.get(at + 1).filter(|_| here.until < t) else { return resting(here.pose) };
        let seconds = (next.from - here.until).as_secs_f64();
        let (share, rate) = smooth((t - here.until).as_secs_f64() / seconds);
        let (from, to) = (here.pose, next.pose);
        let way = to.translation.vector - from.translation.vector;
        let turn = (from.rotation.inverse() * to.rotation).scaled_axis();
        let rotation = from.rotation * UnitQuaternion::from_scaled_axis(turn * share);
        BodyState {
            t_rig_body: Isometry3::from_parts(Translation3::from(from.translation.vector + way * share), rotation),
            velocity_mps: way * (rate / seconds),
            // The axis stays where it is while the body turns about it.
            angular_velocity_rps: from.rotation * turn * (rate / seconds),
        }
    }
}

/// A way from 0 to 1 and its slope: the polynomial of least degree whose first and second derivatives are 0 at both ends.
fn smooth(s: f64) -> (f64, f64) {
    (s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 - s) * (1.0 - s))
}

#[cfg(test)]
mod tests {
    use super::*;

    const REST: Span = Span(2_000_000_000);
    const MOVE: Span = Span(1_000_000_000);

    fn pose(x: f64, turn: [f64; 3]) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::from(turn))
    }

    fn at(motion: &Poses, seconds: f64) -> BodyState {
        motion.state(RigNs(libm::round(seconds * 1e9) as i64))
    }

    #[test]
    fn it_rests_in_each_pose_and_is_half_way_in_the_middle_of_a_move() {
        let motion = Poses::new(&[pose(1.0, [0.0; 3]), pose(2.0, [0.0, 0.0, 0.8])], REST, MOVE);
        for seconds in [-1.0, 0.0, 1.0, 2.0] {
            let state = at(&motion, seconds);
            assert_eq!((state.t_rig_body, state.velocity_mps.norm()), (pose(1.0, [0.0; 3]), 0.0), "{seconds}");
        }
        // In the middle the polynomial is 1/2 and its slope 30/16.
        let state = at(&motion, 2.5);
        let (turn, place) = (state.t_rig_body.rotation.scaled_axis(), state.t_rig_body.translation.vector);
        assert!((turn - Vector3::z() * 0.4).norm() < 1e-12 && (place.x - 1.5).abs() < 1e-12);
        assert!((state.velocity_mps.x - 1.875).abs() < 1e-12);
        assert!((state.angular_velocity_rps - Vector3::z() * 0.8 * 1.875).norm() < 1e-12);
        for seconds in [3.0, 4.0, 1e6] {
            let state = at(&motion, seconds);
            assert_eq!((state.t_rig_body, state.angular_velocity_rps.norm()), (pose(2.0, [0.0, 0.0, 0.8]), 0.0));
        }
    }

    #[test]
    fn velocities_are_those_of_the_poses() {
        let poses = [pose(1.0, [0.3, -0.2, 0.1]), pose(2.0, [-0.9, 0.4, 1.2]), pose(1.4, [0.0, 2.0, 0.0])];
        let motion = Poses::new(&poses, REST, MOVE);
        let h = 1e-4;
        for n in 0..90 {
            let t = 0.05 + f64::from(n) * 0.1;
            let (before, now, after) = (at(&motion, t - h), at(&motion, t), at(&motion, t + h));
            let way = after.t_rig_body.translation.vector - before.t_rig_body.translation.vector;
            assert!((way / (2.0 * h) - now.velocity_mps).norm() < 1e-5, "{t}");
            let turned = (after.t_rig_body.rotation * before.t_rig_body.rotation.inverse()).scaled_axis();
            assert!((turned / (2.0 * h) - now.angular_velocity_rps).norm() < 1e-5, "{t}");
        }
    }

    #[test]
    fn no_pose_one_pose_and_moves_without_time_are_motions_too() {
        assert_eq!(at(&Poses::new(&[], REST, MOVE), 5.0).t_rig_body, Isometry3::identity());
        assert_eq!(at(&Poses::new(&[pose(1.0, [0.0; 3])], REST, MOVE), 5.0).t_rig_body, pose(1.0, [0.0; 3]));
        let jump = Poses::new(&[pose(1.0, [0.0; 3]), pose(2.0, [0.0; 3])], REST, Span(0));
        assert_eq!(at(&jump, 1.999).t_rig_body.translation.x, 1.0);
        assert_eq!(at(&jump, 2.0).t_rig_body.translation.x, 2.0);
        assert!(at(&jump, 2.0).velocity_mps.norm() == 0.0);
    }
}
