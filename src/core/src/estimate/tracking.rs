//! A target that is tracked: each frame is laid on the model, and the filter has the pose.

use super::axis::AxisTest;
use super::mounting::MountingCheck;
use super::state::StateReason;
use crate::track::{Fit, TrackFrame, Tracker};
use crate::ukf::{Filter, Motion, PoseMeasurement, Used};
use std::collections::VecDeque;
use tumbled_model::{RigNs, Span};

/// Poses that are kept for a filter of another motion.
const KEPT: Span = Span(1_500_000_000);
/// Fits beyond doubt, of which so many in a row are refused, tell of a motion that has changed.
const MANOEUVRE: u32 = 3;
/// The least share of points on the model of a fit beyond doubt.
const BEYOND_DOUBT: f64 = 0.7;
/// The least share on the model of a frame that may show something else besides the target, to be taken into the model.
const WHOLLY: f64 = 0.95;
/// What is then known of the motion, one axis: m/s and rad/s (90°/s).
pub(super) const DISTURBED: (f64, f64) = (0.3, core::f64::consts::FRAC_PI_2);
/// So long it went unnoticed, s: the frames that were refused.
pub(super) const UNNOTICED_S: f64 = 0.1;
/// So long after it the motion may go on changing, by so much from epoch to epoch: m/s and rad/s (10°/s).
const UNSTEADY_FOR: Span = Span(400_000_000);
const UNSTEADY: (f64, f64) = (0.05, 0.17);
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
    pub(super) refused: u32,
    /// Until when the motion may go on changing.
    pub(super) unsteady_until: RigNs,
    /// Of each sensor, the most points it was tracked with.
    pub(super) most_points: Vec<usize>,
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
        let fit = self.tracker.fit(frame, &self.filter.seen_by(shot.t, shot.sensor));
        if !fit.is_trusted() {
            return Measured { fit: Some(fit), ..nothing(StateReason::PoorFit) };
        }
        let measurement =
            PoseMeasurement { t: shot.t, sensor: shot.sensor, pose: fit.t_rig_target, information: fit.information };
        let mut reasons = Vec::new();
        if shot.t < self.unsteady_until {
            self.filter.disturb(UNSTEADY.0, UNSTEADY.1, 0.0);
            reasons.push(StateReason::Manoeuvre);
        }
        let mut verdict = self.filter.update(&measurement);
        let is_sure = fit.is_firm() && fit.covers(BEYOND_DOUBT);
        self.refused = if is_sure && verdict.used == Used::Rejected { self.refused + 1 } else { 0 };
        if self.refused >= MANOEUVRE || is_sure && verdict.lost {
            self.filter.disturb(DISTURBED.0, DISTURBED.1, UNNOTICED_S);
            verdict = self.filter.update(&measurement);
            self.unsteady_until = shot.t + UNSTEADY_FOR;
            self.axes.iter_mut().for_each(AxisTest::forget);
            reasons.push(StateReason::Manoeuvre);
        }
        self.poses.push_back(measurement);
        while self.poses.front().is_some_and(|oldest| shot.t - oldest.t > KEPT) {
            self.poses.pop_front();
        }
        let mut shows_target = false;
        let used = matches!(verdict.used, Used::Full | Used::Soft);
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
}
