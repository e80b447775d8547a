//! Motions from pose to pose, as a scene lists them.

use super::error::SceneError;
use crate::motion::poses::Poses;
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::Span;

/// The most rests of a scene: more than a day of seconds.
const MOST: usize = 100_000;
/// The longest rest and move, s.
const LONGEST_S: f64 = 86_400.0;

/// A pose in a list.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenePose {
    /// Where the target's origin is, rig frame, m.
    pub at_m: [f64; 3],
    /// How it is turned against the motion's `upright` attitude: about this direction (rig axes), by its length in degrees.
    #[serde(default)]
    pub turned_deg: [f64; 3],
}

/// Views of an experiment: at each place, about each axis, so many steps of one angle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneViews {
    /// The places of the target's origin, one after the other, rig frame, m.
    pub places_m: Vec<[f64; 3]>,
    /// The axes at each place, one after the other, rig axes; need not have length 1.
    pub axes: Vec<[f64; 3]>,
    /// The target's attitude at angle 0: a unit quaternion in the order x, y, z, w; left out: the rig's axes.
    #[serde(default = "upright")]
    pub upright_xyzw: [f64; 4],
    /// A step, °: the published experiments have 22.5.
    pub step_deg: f64,
    /// Rests at each place about each axis, the first at angle 0.
    pub views: u32,
    /// A rest, s.
    pub rest_s: f64,
    /// A move, s.
    pub move_s: f64,
}

/// No turn.
pub(super) fn upright() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

/// Rests in listed poses.
pub(super) fn poses(
    upright: UnitQuaternion<f64>,
    list: &[ScenePose],
    rest_s: f64,
    move_s: f64,
) -> Result<Poses, SceneError> {
    let rests: Vec<_> = list.iter().take(MOST + 1).map(|pose| turned(pose.at_m, pose.turned_deg, upright)).collect();
    through(&rests, rest_s, move_s)
}

/// Rests in the views of an experiment.
pub(super) fn views(views: &SceneViews, upright: UnitQuaternion<f64>) -> Result<Poses, SceneError> {
    let mut axes = Vec::with_capacity(views.axes.len().min(MOST));
    for axis in &views.axes {
        let vector = Vector3::from(*axis);
        let expected = "axes of a length above 0";
        let none = SceneError::Number { key: "motion.axes", found: vector.norm(), expected };
        axes.push(Unit::try_new(vector, 0.0).ok_or(none)?.into_inner());
    }
    let angle = |view: u32| views.step_deg * f64::from(view);
    let rests: Vec<_> = views
        .places_m
        .iter()
        .flat_map(|place| axes.iter().map(move |axis| (*place, axis)))
        .flat_map(|(place, axis)| (0..views.views).map(move |view| (place, axis * angle(view))))
        .map(|(place, turn)| turned(place, turn.into(), upright))
        .take(MOST + 1)
        .collect();
    through(&rests, views.rest_s, views.move_s)
}

fn turned(at_m: [f64; 3], turned_deg: [f64; 3], upright: UnitQuaternion<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turned_deg).map(f64::to_radians));
    Isometry3::from_parts(Translation3::from(at_m), turn * upright)
}

fn through(rests: &[Isometry3<f64>], rest_s: f64, move_s: f64) -> Result<Poses, SceneError> {
    if rests.is_empty() || rests.len() > MOST {
        let expected = "1 to 100000";
        return Err(SceneError::Number { key: "number of poses", found: rests.len() as f64, expected });
    }
    for (key, found) in [("motion.rest_s", rest_s), ("motion.move_s", move_s)] {
        if !(0.0..=LONGEST_S).contains(&found) {
            return Err(SceneError::Number { key, found, expected: "0 to 86400 s" });
        }
    }
    if rests.iter().any(|pose| !pose.to_homogeneous().iter().all(|x| x.is_finite())) {
        return Err(SceneError::Number { key: "motion", found: f64::NAN, expected: "finite places and angles" });
    }
    let span = |seconds: f64| Span(libm::round(seconds * 1e9) as i64);
    Ok(Poses::new(rests, span(rest_s), span(move_s)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn experiment() -> SceneViews {
        SceneViews {
            places_m: vec![[2.0, 0.0, 0.0], [3.0, 0.0, 0.0]],
            axes: vec![[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]],
            upright_xyzw: upright(),
            step_deg: 22.5,
            views: 16,
            rest_s: 1.0,
            move_s: 0.5,
        }
    }

    #[test]
    fn an_experiment_rests_in_every_view_of_every_axis_at_every_place() {
        let poses = views(&experiment(), UnitQuaternion::identity()).unwrap();
        // 2 places, 3 axes, 16 views.
        assert_eq!(poses.stops().len(), 96);
        // The 21st: the second axis' fifth, 90° about y, at 20 · 1.5 s.
        let stop = poses.stops()[20];
        assert_eq!((stop.from.0, stop.until.0), (30_000_000_000, 31_000_000_000));
        let turn = stop.pose.rotation.scaled_axis() - Vector3::y() * core::f64::consts::FRAC_PI_2;
        assert!(turn.norm() < 1e-12 && stop.pose.translation.vector.x == 2.0);
        // A whole turn would be the next axis' first view: 337.5° is the last.
        let last = poses.stops()[15].pose.rotation.angle();
        assert!((last - 22.5_f64.to_radians()).abs() < 1e-12);
        assert_eq!(poses.stops()[95].pose.translation.vector.x, 3.0);
    }

    #[test]
    fn a_listed_pose_is_turned_about_the_rigs_axes_from_its_upright_attitude() {
        let upright = UnitQuaternion::from_scaled_axis(Vector3::x() * 1.0);
        let list = [ScenePose { at_m: [1.0, 2.0, 3.0], turned_deg: [0.0, 0.0, 90.0] }];
        let poses = poses(upright, &list, 1.0, 1.0).unwrap();
        let expected = UnitQuaternion::from_scaled_axis(Vector3::z() * core::f64::consts::FRAC_PI_2) * upright;
        assert!(poses.stops()[0].pose.rotation.angle_to(&expected) < 1e-12);
        assert_eq!(poses.stops()[0].pose.translation.vector, Vector3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn numbers_that_mean_nothing_are_refused() {
        let upright = UnitQuaternion::identity();
        assert!(poses(upright, &[], 1.0, 1.0).is_err());
        let one = [ScenePose { at_m: [f64::NAN, 0.0, 0.0], turned_deg: [0.0; 3] }];
        assert!(poses(upright, &one, 1.0, 1.0).is_err());
        for wrong in [
            SceneViews { views: u32::MAX, ..experiment() },
            SceneViews { views: 0, ..experiment() },
            SceneViews { rest_s: f64::NAN, ..experiment() },
            SceneViews { move_s: -1.0, ..experiment() },
            SceneViews { axes: vec![[0.0; 3]], ..experiment() },
            SceneViews { step_deg: f64::INFINITY, ..experiment() },
        ] {
            assert!(views(&wrong, upright).is_err(), "{wrong:?}");
        }
    }
}
