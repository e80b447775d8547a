//! A target that is tracked: each frame is laid on the model, and the filter has the pose.

use super::axis::AxisTest;
use super::manoeuvre::{Refusals, UNSTEADY_FOR, going_on};
use super::mounting::MountingCheck;
use super::state::StateReason;
use crate::track::{Fit, Shot, TrackFrame, Tracker};
use crate::ukf::{Disturbance, Filter, Motion, PoseMeasurement, Used};
use std::collections::VecDeque;
use tumbled_model::{RigNs, Span};

/// Poses that are kept for a filter of another motion.
const KEPT: Span = Span(1_500_000_000);
/// Fits beyond doubt, of which so many in a row are refused, tell of a motion that has changed.
const MANOEUVRE: u32 = 3;
/// Three crossings of a LiDAR.
const LATELY: Span = Span(300_000_000);
/// The least share of points on the model of a fit beyond doubt.
const BEYOND_DOUBT: f64 = 0.7;
/// The least share on the model of a frame that may show something else besides the target, to be taken into the model.
const WHOLLY: f64 = 0.95;
/// A target that is tracked.
#[derive(Debug)]
pub(super) struct Tracking {
    pub(super) tracker: Tracker,
    pub(super) filter: Filter,
    pub(super) motion: Motion,
    /// Where it was acquired, rig frame, m.
    pub(super) acquired_m: [f64; 3],
    pub(super) began: RigNs,
    pub(super) measured: RigNs,
    /// The newest poses.
    pub(super) poses: VecDeque<PoseMeasurement>,
    /// Of each sensor, whether the axis stays.
    pub(super) axes: Vec<AxisTest>,
    /// Whether the sensors are mounted as the config says.
    pub(super) mounting: MountingCheck,
    /// The axis was seen to move.
    pub(super) tumbles: bool,
    /// Fits beyond doubt that were refused, in a row.
    pub(super) refused: Refusals,
    /// Until when the motion may go on changing, and by how much from epoch to epoch.
    pub(super) unsteady: Option<(RigNs, Disturbance)>,
    /// Of each sensor, the most points it was tracked with.
    pub(super) most_points: Vec<usize>,
    /// Of each sensor, when a pose of it was last used.
    pub(super) accepted: Vec<Option<RigNs>>,
    /// Whether the last fit was used and beyond doubt.
    pub(super) is_sure: bool,
}

/// What an epoch meant for a tracked target.
pub(super) struct Measured {
    pub(super) nis: Option<f64>,
    pub(super) fit: Option<Fit>,
    pub(super) reasons: Vec<StateReason>,
    pub(super) used: bool,
    /// It was used, beyond doubt, and shows the target alone: of use to whoever makes a surface of it.
    pub(super) shows_target: bool,
    pub(super) lost: bool,
}

impl Tracking {
    /// Lays a frame on the model and lets the filter have the pose. The model takes the frame in only where `is_clear` that it
    /// shows the target and nothing else: it would grow by a room, and then look for the target in a room.
    pub(super) fn measure(&mut self, frame: &TrackFrame, is_clear: bool) -> Measured {
        let shot = *frame.shot();
        self.is_sure = false;
        let nothing = |reason| Measured {
            nis: None,
            fit: None,
            reasons: vec![reason],
            used: false,
            shows_target: false,
            lost: false,
        };
        if frame.is_empty() {
            return nothing(StateReason::NoPoints);
        }
        let predicted = self.filter.seen_by(shot.t, shot.sensor);
        let fit = self.tracker.fit(frame, &predicted);
        if !fit.is_trusted() {
            return Measured { fit: Some(fit), ..nothing(StateReason::PoorFit) };
        }
        let measurement =
            PoseMeasurement { t: shot.t, sensor: shot.sensor, pose: fit.t_rig_target, information: fit.information };
        let mut reasons = Vec::new();
        self.unsteady = self.unsteady.filter(|(until, _)| shot.t < *until);
        if let Some((_, disturbance)) = self.unsteady {
            self.filter.disturb(&disturbance);
            reasons.push(StateReason::Manoeuvre);
        }
        let mut verdict = self.filter.update(&measurement);
        let is_sure = fit.is_firm() && fit.covers(BEYOND_DOUBT);
        if is_sure && verdict.used == Used::Rejected {
            self.refused.push(shot.sensor, shot.t, &predicted, &fit.t_rig_target);
        } else {
            self.refused.clear();
        }
        if self.refused.count() >= MANOEUVRE && !self.another_agrees(&shot) || is_sure && verdict.lost {
            let disturbance = self.refused.disturbance();
            self.filter.disturb(&disturbance);
            verdict = self.filter.update(&measurement);
            self.unsteady = Some((shot.t + UNSTEADY_FOR, going_on(&disturbance)));
            self.axes.iter_mut().for_each(AxisTest::forget);
            reasons.push(StateReason::Manoeuvre);
        }
        self.poses.push_back(measurement);
        while self.poses.front().is_some_and(|oldest| shot.t - oldest.t > KEPT) {
            self.poses.pop_front();
        }
        let mut shows_target = false;
        let used = matches!(verdict.used, Used::Full | Used::Soft);
        self.is_sure = is_sure && used;
        if is_sure {
            let now = self.filter.pose_at(shot.t);
            self.mounting.take(shot.sensor, shot.t, &now, &fit.t_rig_target);
        }
        if self.mounting.is_alarm() {
            reasons.push(StateReason::Extrinsic);
        }
        if !fit.is_firm() {
            reasons.push(StateReason::Degenerate);
        }
        if used {
            self.measured = shot.t;
            if let Some(accepted) = self.accepted.get_mut(shot.sensor) {
                *accepted = Some(shot.t);
            }
            if let Some(most) = self.most_points.get_mut(shot.sensor) {
                *most = frame.len().max(*most);
            }
            if is_clear || fit.covers(WHOLLY) {
                shows_target = is_sure;
                self.tracker.accept(frame, &fit);
            }
            if let Some(axis) = self.axes.get_mut(shot.sensor) {
                self.tumbles |= axis.moves(&fit.t_rig_target.rotation);
            }
        } else {
            reasons.push(StateReason::Rejected);
        }
        Measured { nis: verdict.nis, fit: Some(fit), reasons, used, shows_target, lost: verdict.lost }
    }

    /// Whether another sensor, that was not refused since, has lately seen the target where it was predicted.
    fn another_agrees(&self, shot: &Shot) -> bool {
        let lately = |accepted: &Option<RigNs>| accepted.is_some_and(|accepted| shot.t - accepted < LATELY);
        let others = (0..).zip(&self.accepted).filter(|(sensor, _)| *sensor != shot.sensor);
        others.filter(|(sensor, _)| !self.refused.has(*sensor)).any(|(_, accepted)| lately(accepted))
    }
}
