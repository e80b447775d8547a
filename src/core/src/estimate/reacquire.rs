//! A lost target is looked for where it was, and then everywhere: what is seen against the model of it.

use super::state::StateReason;
use crate::register::{CgaOptions, Cloud, Registration, View, cga};
use crate::track::{Fit, TrackFrame, Tracker};
use crate::workers::Workers;
use nalgebra::Isometry3;

/// The least share of points on the model of a fit that is believed where the target is looked for again.
const SURE: f64 = 0.8;
/// The least probability of the pose among those that were found.
const PROBABLE: f64 = 0.9;

/// Of a model of another session: the least share of points on it, and of what should be seen of it that is. Another body of
/// its size was measured to have 0.42 to 0.91 and 0.25 to 0.65 in a camera's frames, 0.70 to 0.93 and 0.41 to 0.80 in a
/// LiDAR's, never much of both; the target itself 0.91 to 1.00 and, in 98 of 100 frames, above 0.66.
const ON_IT: f64 = 0.9;
const SHOWN: f64 = 0.65;

/// Epochs between two tries to find a lost target again.
const TRY_EVERY: u32 = 5;
/// It is looked for in frames with this share of the most points it was tracked with: a corner of it that comes into the
/// region fits the model in many places.
const LEAST_RETURNED: f64 = 0.4;
/// A frame with so much more points than the sensor's one before sees it come in.
const STEADY: f64 = 1.15;
/// Two frames in a row have to show it, so little turned and moved between them, rad and m: a sixth of a second.
const TURNED_RAD: f64 = 0.2;
const MOVED_M: f64 = 0.1;

/// A target that was tracked and is looked for.
#[derive(Debug)]
pub(super) struct Missed {
    /// Its model.
    pub(super) tracker: Tracker,
    /// Where it was last; `None`: it was never seen in this session.
    last: Option<Isometry3<f64>>,
    /// Frames since in which it could have been.
    frames: u32,
    /// Of each sensor, the most points it was tracked with, and those of its newest frame since.
    points: Vec<(usize, usize)>,
    /// Where the frame before showed it.
    seen: Option<Isometry3<f64>>,
}

impl Missed {
    /// Lost just now.
    pub(super) fn new(tracker: Tracker, last: Isometry3<f64>, most_points: Vec<usize>) -> Self {
        let points = most_points.into_iter().map(|most| (most, 0)).collect();
        Self { tracker, last: Some(last), frames: 0, points, seen: None }
    }

    /// Of another session, and not seen in this one yet; of a rig with so many sensors.
    pub(super) fn known(tracker: Tracker, sensors: usize) -> Self {
        Self { tracker, last: None, frames: 0, points: vec![(0, 0); sensors], seen: None }
    }

    /// Whether it was tracked in this session.
    pub(super) fn was_tracked(&self) -> bool {
        self.last.is_some()
    }

    /// The pose at which a frame shows it; `None`: this frame was not looked at.
    ///
    /// # Errors
    /// Why it is not found in it.
    pub(super) fn look(
        &mut self,
        frame: &TrackFrame,
        workers: &Workers,
    ) -> Result<Option<Isometry3<f64>>, StateReason> {
        let points = frame.len() as f64;
        if let Some((most, newest)) = self.points.get_mut(frame.shot().sensor) {
            let is_steady = points <= STEADY * *newest as f64;
            *newest = frame.len();
            if points < LEAST_RETURNED * *most as f64 || !is_steady {
                self.seen = None;
                return Err(StateReason::FewPoints);
            }
        }
        self.frames += 1;
        if !(self.frames - 1).is_multiple_of(TRY_EVERY) {
            return Ok(None);
        }
        let before = self.seen.take();
        let found = match &self.last {
            Some(last) => found_again(&mut self.tracker, last, frame, workers),
            None => recognised(&mut self.tracker, frame, workers),
        };
        let Some(pose) = found else {
            return Err(if self.was_tracked() { StateReason::Ambiguous } else { StateReason::Unrecognised });
        };
        let is_same = |before: Isometry3<f64>| {
            let way = before.translation.vector - pose.translation.vector;
            before.rotation.angle_to(&pose.rotation) < TURNED_RAD && way.norm() < MOVED_M
        };
        if before.is_some_and(is_same) {
            return Ok(Some(pose));
        }
        self.seen = Some(pose);
        Ok(None)
    }
}

/// The pose at which a frame shows the model; `last`: where the target was seen last. `None`: it does not show it, or
/// several poses are as good.
fn found_again(
    tracker: &mut Tracker,
    last: &Isometry3<f64>,
    frame: &TrackFrame,
    workers: &Workers,
) -> Option<Isometry3<f64>> {
    let here = tracker.fit(frame, last);
    if is_sure(&here) {
        return Some(here.t_rig_target);
    }
    let (answer, there) = anywhere(tracker, frame, workers)?;
    (answer.accepted || answer.probability >= PROBABLE && is_sure(&there)).then_some(there.t_rig_target)
}

/// The pose at which a frame shows a model of another session. `None`: it shows something else, or several poses are as
/// good. What is another body may fit somewhere: it has to lie on the model, and nowhere else as well.
fn recognised(tracker: &mut Tracker, frame: &TrackFrame, workers: &Workers) -> Option<Isometry3<f64>> {
    let (answer, there) = anywhere(tracker, frame, workers)?;
    let is_it = is_sure(&there) && there.covers(ON_IT) && tracker.shown(frame, &there.t_rig_target) >= SHOWN;
    (is_it && (answer.accepted || answer.probability >= PROBABLE)).then_some(there.t_rig_target)
}

/// The best pose of all, and the fit that is reached from it.
fn anywhere(tracker: &mut Tracker, frame: &TrackFrame, workers: &Workers) -> Option<(Registration, Fit)> {
    let seen = Cloud {
        sensor: frame.kind(),
        points: frame.points().iter().map(|point| point.cast()).collect(),
        viewpoint: Some(frame.shot().viewpoint.cast()),
        view: View::Bare,
    };
    let model = tracker.surfels().cloud();
    let answer = cga(&model, &seen, None, &CgaOptions::default(), workers).ok()?;
    let there = tracker.fit(frame, &answer.t_reference_moving);
    Some((answer, there))
}

fn is_sure(fit: &Fit) -> bool {
    fit.is_trusted() && fit.is_firm() && fit.covers(SURE)
}
