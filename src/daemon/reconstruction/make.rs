//! Frames to a model.

use nalgebra::{Isometry3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::KeptFrame;
use tumbled_core::recon::{Fused, ReconSettings, Reconstruction, RegisteredFrame, fuse, reconstruct, robust_sigma};
use tumbled_core::register::SensorKind;
use tumbled_core::smooth::{FittedPose, Smoothed, smooth};
use tumbled_core::track::Tracker;
use tumbled_model::RigNs;

use crate::session::Engine;

/// Where a frame lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laid {
    /// Its sensor's number.
    pub sensor: usize,
    /// Its time.
    pub t: RigNs,
    /// Target's frame to rig, as the sensor sees it.
    pub t_rig_target: Isometry3<f64>,
}

/// A model and what it was made of.
#[derive(Clone, Debug)]
pub struct Made {
    /// The target's number in the session.
    pub target: u32,
    /// The frames it was made of.
    pub frames: Vec<RegisteredFrame>,
    /// Where they lie, in the same order.
    pub laid: Vec<Laid>,
    /// How the target moved; `None`: too few frames, or the session ended with another target.
    pub motion: Option<Smoothed>,
    /// Frames of other targets of the session, left out.
    pub others: usize,
    /// What was fused.
    pub fused: Fused,
    /// The model.
    pub model: Reconstruction,
    /// How it was made.
    pub settings: ReconSettings,
}

/// How thick a sensor's points lie about the planes, and how thick once what of it is noise is taken away.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Thickness {
    /// Points on planes.
    pub points: u64,
    /// 1.4826 times the median distance, mm, as measured.
    pub before_mm: f64,
    /// On the model.
    pub after_mm: f64,
}

/// A model of the target that most of the frames show; `engine` as it is at the session's end. `None`: there are no frames.
pub fn make(frames: &[KeptFrame], engine: &Engine, settings: &ReconSettings) -> Option<Made> {
    let count = |target: u32| frames.iter().filter(|kept| kept.target == target).count();
    let last = frames.iter().map(|kept| kept.target).max()?;
    // Of as many the later one.
    let target = (0..=last).max_by_key(|target| (count(*target), *target))?;
    let of_it: Vec<&KeptFrame> = frames.iter().filter(|kept| kept.target == target).collect();
    let tracker = engine.model().filter(|(of, _)| *of == target).map(|(_, tracker)| tracker);
    let fitted: Vec<FittedPose> = match tracker {
        Some(tracker) => fitted(&of_it, tracker),
        None => Vec::new(),
    };
    let motion = smooth(&fitted, &engine.sensor_priors(&middle(of_it.iter().map(|kept| &kept.t_rig_target))));
    let place = |number: usize| motion.as_ref().and_then(|motion| motion.placed.get(number));
    let mut registered = Vec::with_capacity(of_it.len());
    let mut laid = Vec::with_capacity(of_it.len());
    for (number, kept) in of_it.iter().enumerate() {
        let shot = kept.frame.shot();
        let t_rig_target =
            *place(number).or(fitted.get(number).map(|fit| &fit.t_rig_target)).unwrap_or(&kept.t_rig_target);
        let beams = tracker.and_then(|tracker| tracker.beams(shot.sensor));
        registered.push(RegisteredFrame::new(&kept.frame, &t_rig_target, beams));
        laid.push(Laid { sensor: shot.sensor, t: shot.t, t_rig_target });
    }
    let fused = fuse(&registered);
    let model = reconstruct(&fused.points, &registered, settings);
    let others = frames.len() - registered.len();
    Some(Made { target, frames: registered, laid, motion, others, fused, model, settings: *settings })
}

/// The frames laid on the whole model, each from where it fitted the model of its time.
fn fitted(frames: &[&KeptFrame], tracker: &Tracker) -> Vec<FittedPose> {
    let mut tracker = tracker.clone();
    let lay = |kept: &&KeptFrame| {
        let fit = tracker.fit(&kept.frame, &kept.t_rig_target);
        let trusted = fit.is_trusted();
        FittedPose {
            t: kept.frame.shot().t,
            sensor: kept.frame.shot().sensor,
            t_rig_target: if trusted { fit.t_rig_target } else { kept.t_rig_target },
            information: trusted.then_some(fit.information),
        }
    };
    frames.iter().map(lay).collect()
}

/// Where the target was on the whole, by its poses: rig frame, m.
pub(super) fn middle<'a>(poses: impl ExactSizeIterator<Item = &'a Isometry3<f64>>) -> Vector3<f64> {
    let count = poses.len().max(1) as f64;
    poses.map(|pose| pose.translation.vector).sum::<Vector3<f64>>() / count
}

impl Made {
    /// The same fused points with no planes looked for.
    pub fn without_planes(self) -> Self {
        let settings = ReconSettings { planes: false, ..self.settings };
        Self { model: reconstruct(&self.fused.points, &self.frames, &settings), settings, ..self }
    }

    /// How thick the points of a kind of sensor lie about the planes they are on. `None`: it has none on a plane.
    pub fn thickness(&self, kind: SensorKind) -> Option<Thickness> {
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for point in self.frames.iter().filter(|frame| frame.kind == kind).flat_map(|frame| &frame.points) {
            let flat = self.model.flatten(&point.place, &point.normal, point.sigma_m, &self.settings);
            let Some((number, place)) = flat else { continue };
            let Some(plane) = self.model.planes.get(number as usize) else { continue };
            before.push(plane.height(&point.place).abs());
            after.push(plane.height(&place).abs());
        }
        let points = before.len() as u64;
        Some(Thickness { points, before_mm: 1e3 * robust_sigma(before)?, after_mm: 1e3 * robust_sigma(after)? })
    }
}
