//! A lost target is looked for where it was, and then everywhere: what is seen against the model of it.

use crate::register::{CgaOptions, Cloud, View, cga};
use crate::track::{Fit, TrackFrame, Tracker};
use crate::workers::Workers;
use nalgebra::Isometry3;

/// The least share of points on the model of a fit that is believed where the target is looked for again.
const SURE: f64 = 0.8;
/// The least probability of the pose among those that were found.
const PROBABLE: f64 = 0.9;

/// The pose at which a frame shows the model; `last`: where the target was seen last. `None`: it does not show it, or
/// several poses are as good.
pub(super) fn found(
    tracker: &mut Tracker,
    last: &Isometry3<f64>,
    frame: &TrackFrame,
    workers: &Workers,
) -> Option<Isometry3<f64>> {
    let here = tracker.fit(frame, last);
    if is_sure(&here) {
        return Some(here.t_rig_target);
    }
    let seen = Cloud {
        sensor: frame.kind(),
        points: frame.points().iter().map(|point| point.cast()).collect(),
        viewpoint: Some(frame.shot().viewpoint.cast()),
        view: View::Bare,
    };
    let model = tracker.surfels().cloud();
    let answer = cga(&model, &seen, None, &CgaOptions::default(), workers).ok()?;
    let there = tracker.fit(frame, &answer.t_reference_moving);
    (answer.accepted || answer.probability >= PROBABLE && is_sure(&there)).then_some(there.t_rig_target)
}

fn is_sure(fit: &Fit) -> bool {
    fit.is_trusted() && fit.is_firm() && fit.covers(SURE)
}
