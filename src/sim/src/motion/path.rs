//! Straight ways: a drift, and a person's walk.

use super::{BodyState, Motion};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use tumbled_model::RigNs;

/// A body that moves evenly along a line and does not turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drifting {
    /// Its frame into the rig's at the session's start.
    pub start: Isometry3<f64>,
    /// Rig axes, m/s.
    pub velocity_mps: Vector3<f64>,
}

impl Motion for Drifting {
    fn state(&self, t: RigNs) -> BodyState {
        let moved = Translation3::from(self.velocity_mps * super::seconds(t));
        BodyState {
            t_rig_body: moved * self.start,
            velocity_mps: self.velocity_mps,
            angular_velocity_rps: Vector3::zeros(),
        }
    }
}

/// A walk along straight legs at one speed, upright (z of the rig), x ahead; standing at the first point before it
/// begins, and at the last after. It turns at once from leg to leg.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    start: Point3<f64>,
    legs: Vec<Leg>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    begins: RigNs,
    ends: RigNs,
    from: Point3<f64>,
    velocity_mps: Vector3<f64>,
    heading: UnitQuaternion<f64>,
}

impl Walk {
    /// A walk along these points (rig frame, m) that begins at `begins`. Without a second point, or at no speed, it
    /// stands at the first.
    pub fn new(points: &[Point3<f64>], speed_mps: f64, begins: RigNs) -> Self {
        let start = points.first().copied().unwrap_or_else(Point3::origin);
        let mut walk = Self { start, legs: Vec::new() };
        let (mut from, mut at) = (start, begins);
        for point in points.iter().skip(1) {
            let way = point - from;
            let length = way.norm();
            if length == 0.0 || speed_mps <= 0.0 {
                continue;
            }
            let ends = RigNs(at.0.saturating_add((length / speed_mps * 1e9) as i64));
            let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), libm::atan2(way.y, way.x));
            let velocity_mps = way / length * speed_mps;
            walk.legs.push(Leg { begins: at, ends, from, velocity_mps, heading });
            (from, at) = (*point, ends);
        }
        walk
    }

    /// When it comes to its last point; `None`: it never goes.
    pub fn ends(&self) -> Option<RigNs> {
        self.legs.last().map(|leg| leg.ends)
    }
}

impl Motion for Walk {
    fn state(&self, t: RigNs) -> BodyState {
        let leg = self.legs.iter().find(|leg| t < leg.ends).or(self.legs.last());
        let Some(leg) = leg else {
            let t_rig_body = Isometry3::from_parts(Translation3::from(self.start), UnitQuaternion::identity());
            return BodyState { t_rig_body, velocity_mps: Vector3::zeros(), angular_velocity_rps: Vector3::zeros() };
        };
        let walking = leg.begins <= t && t < leg.ends;
        let within = t.clamp(leg.begins, leg.ends);
        let at = leg.from + leg.velocity_mps * (within - leg.begins).as_secs_f64();
        BodyState {
            t_rig_body: Isometry3::from_parts(Translation3::from(at), leg.heading),
            velocity_mps: if walking { leg.velocity_mps } else { Vector3::zeros() },
            angular_velocity_rps: Vector3::zeros(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(walk: &Walk, seconds: f64) -> (Point3<f64>, Vector3<f64>, Vector3<f64>) {
        let state = walk.state(RigNs((seconds * 1e9) as i64));
        let ahead = state.t_rig_body * Vector3::x();
        (state.t_rig_body.translation.vector.into(), state.velocity_mps, ahead)
    }

    #[test]
    fn a_walk_goes_along_its_legs_facing_ahead_and_stands_before_and_after() {
        let points = [Point3::new(0.0, 0.0, -1.0), Point3::new(3.0, 0.0, -1.0), Point3::new(3.0, 4.0, -1.0)];
        // 3 m and 4 m at 1 m/s from 2 s on: at the corner at 5 s, at the end at 9 s.
        let walk = Walk::new(&points, 1.0, RigNs(2_000_000_000));
        assert_eq!(walk.ends(), Some(RigNs(9_000_000_000)));
        let near = |found: (Point3<f64>, Vector3<f64>, Vector3<f64>),
                    place: Point3<f64>,
                    velocity: Vector3<f64>,
                    ahead: Vector3<f64>| {
            let off = (found.0 - place).norm() + (found.1 - velocity).norm() + (found.2 - ahead).norm();
            assert!(off < 1e-9, "{found:?}");
        };
        near(at(&walk, 0.0), points[0], Vector3::zeros(), Vector3::x());
        near(at(&walk, 3.5), Point3::new(1.5, 0.0, -1.0), Vector3::x(), Vector3::x());
        near(at(&walk, 7.0), Point3::new(3.0, 2.0, -1.0), Vector3::y(), Vector3::y());
        near(at(&walk, 60.0), points[2], Vector3::zeros(), Vector3::y());
    }

    #[test]
    fn a_walk_of_one_point_or_no_speed_stands_there() {
        let (a, b) = (Point3::new(1.0, 2.0, 3.0), Point3::new(2.0, 2.0, 3.0));
        for walk in
            [Walk::new(&[a], 1.0, RigNs(0)), Walk::new(&[a, b], 0.0, RigNs(0)), Walk::new(&[a, a], 1.0, RigNs(0))]
        {
            assert_eq!((at(&walk, 5.0).0, walk.ends()), (a, None));
        }
    }
}
