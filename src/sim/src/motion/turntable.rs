//! A target on a stage that turns about a fixed axis.

use super::profile::{Profile, Turn};
use super::{BodyState, Motion};
use crate::turntable::{ScriptedStage, StageState};
use core::f64::consts::TAU;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use tumbled_model::RigNs;

/// A body on a turning stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turntable {
    /// The axis, rig axes; angles count right-handed about it.
    pub axis: Unit<Vector3<f64>>,
    /// A point on the axis, rig frame, m.
    pub centre: Point3<f64>,
    /// The body's frame into the stage's. The stage's frame has its origin at `centre`, and at angle 0 the rig's axes.
    pub mount: Isometry3<f64>,
    /// The stage's angle at the session's start, rad.
    pub start_rad: f64,
    /// How it turns from there.
    pub profile: Profile,
}

impl Turntable {
    /// The stage's angle (not wrapped) and rate.
    pub fn stage(&self, t: RigNs) -> Turn {
        let turn = self.profile.at(t);
        Turn { angle_rad: self.start_rad + turn.angle_rad, ..turn }
    }

    /// What an encoder of so many counts per turn shows: the nearest count, not wrapped.
    pub fn counts(&self, t: RigNs, counts_per_turn: u32) -> i64 {
        (self.stage(t).angle_rad / TAU * f64::from(counts_per_turn)).round() as i64
    }
}

impl Motion for Turntable {
    fn state(&self, t: RigNs) -> BodyState {
        self.turned(self.stage(t))
    }
}

/// A body on a stage whose table does not always go where it is told.
#[derive(Clone, Debug)]
pub struct FaultyTurntable {
    /// The stage as it is told to turn.
    pub turntable: Turntable,
    /// What its table does.
    pub stage: ScriptedStage,
}

impl Motion for FaultyTurntable {
    fn state(&self, t: RigNs) -> BodyState {
        let StageState { angle_rad, rate_rps } = self.stage.table(t);
        self.turntable.turned(Turn { angle_rad, rate_rps })
    }
}

impl Turntable {
    /// The body where the stage has turned so far.
    fn turned(&self, turn: Turn) -> BodyState {
        let (sin, cos) = libm::sincos(turn.angle_rad / 2.0);
        let turned = UnitQuaternion::new_unchecked(nalgebra::Quaternion::from_parts(cos, self.axis.scale(sin)));
        let t_rig_body = Isometry3::from_parts(Translation3::from(self.centre), turned) * self.mount;
        let angular_velocity_rps = self.axis.scale(turn.rate_rps);
        let arm = t_rig_body.translation.vector - self.centre.coords;
        BodyState { t_rig_body, velocity_mps: angular_velocity_rps.cross(&arm), angular_velocity_rps }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::turntable::StageFault;
    use std::sync::Arc;

    #[test]
    fn a_quarter_turn_moves_the_body_a_quarter_circle() {
        let table = Turntable {
            axis: Vector3::z_axis(),
            centre: Point3::new(2.0, 0.0, -0.5),
            mount: Isometry3::translation(0.3, 0.0, 0.5),
            start_rad: 0.0,
            profile: Profile::Constant { rate_rps: TAU / 4.0 },
        };
        let state = table.state(RigNs(1_000_000_000));
        let placed = state.t_rig_body * Point3::new(0.1, 0.0, 0.0);
        // x of the stage has become y of the rig; the origin runs toward −x at 0.3 m times the rate.
        assert!((placed - Point3::new(2.0, 0.4, 0.0)).norm() < 1e-15);
        assert!((state.velocity_mps - Vector3::new(-0.3 * TAU / 4.0, 0.0, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn a_body_on_a_faulty_stage_is_where_the_table_is() {
        let profile = Profile::Constant { rate_rps: 0.5 };
        let (axis, centre) = (Vector3::z_axis(), Point3::origin());
        let turntable =
            Turntable { axis, centre, mount: Isometry3::translation(1.0, 0.0, 0.0), start_rad: 0.0, profile };
        let told = move |t| {
            let Turn { angle_rad, rate_rps } = turntable.stage(t);
            StageState { angle_rad, rate_rps }
        };
        let (from, until) = (RigNs(1_000_000_000), RigNs(2_000_000_000));
        let stage = ScriptedStage::new(Arc::new(told), vec![StageFault::Stall { from, until }]);
        let body = FaultyTurntable { turntable, stage };
        // Held at 0.5 rad for a second; at 3 s behind by the 0.5 rad of it.
        let angles = [1_500_000_000, 3_000_000_000].map(|ns| body.state(RigNs(ns)).t_rig_body.rotation.angle());
        assert!((angles[0] - 0.5).abs() < 1e-12 && (angles[1] - 1.0).abs() < 1e-12, "{angles:?}");
        assert_eq!(body.state(RigNs(1_500_000_000)).velocity_mps, Vector3::zeros());
    }

    #[test]
    fn counts_go_on_past_a_turn_and_below_zero() {
        let at = |start_deg: f64| Turntable {
            axis: Vector3::z_axis(),
            centre: Point3::origin(),
            mount: Isometry3::identity(),
            start_rad: start_deg.to_radians(),
            profile: Profile::Constant { rate_rps: 0.0 },
        };
        // 500° of 768,000 counts per turn: 1,066,666.7.
        assert_eq!(at(500.0).counts(RigNs(0), 768_000), 1_066_667);
        assert_eq!(at(-90.0).counts(RigNs(0), 768_000), -192_000);
    }
}
