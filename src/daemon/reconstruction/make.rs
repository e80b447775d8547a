//! Frames to a model.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::KeptFrame;
use tumbled_core::recon::{Fused, ReconSettings, Reconstruction, RegisteredFrame, fuse, reconstruct, robust_sigma};
use tumbled_core::register::SensorKind;
use tumbled_core::track::Tracker;

/// Where a frame lies on the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Where it fitted the model as it was when the frame came.
    Online,
    /// Where it fits the model as it was at the end, with what was known of the beams then.
    Refined,
}

/// A model and what it was made of.
#[derive(Clone, Debug)]
pub struct Made {
    /// The target's number in the session.
    pub target: u32,
    /// The frames it was made of.
    pub frames: Vec<RegisteredFrame>,
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

/// A model of the target that most of the frames show; `tracker`: the model at the session's end, if it is that target's.
/// `None`: there are no frames.
pub fn make(frames: &[KeptFrame], tracker: Option<(u32, &Tracker)>, settings: &ReconSettings) -> Option<Made> {
    let count = |target: u32| frames.iter().filter(|kept| kept.target == target).count();
    let last = frames.iter().map(|kept| kept.target).max()?;
    // Of as many the later one.
    let target = (0..=last).max_by_key(|target| (count(*target), *target))?;
    let of_it = || frames.iter().filter(|kept| kept.target == target);
    let registered: Vec<RegisteredFrame> = match tracker.filter(|(of, _)| *of == target) {
        Some((_, tracker)) => {
            let mut tracker = tracker.clone();
            of_it().map(|kept| refined(kept, &mut tracker)).collect()
        }
        None => of_it().map(|kept| RegisteredFrame::new(&kept.frame, &kept.t_rig_target, None)).collect(),
    };
    let fused = fuse(&registered);
    let model = reconstruct(&fused.points, &registered, settings);
    let others = frames.len() - registered.len();
    Some(Made { target, frames: registered, others, fused, model, settings: *settings })
}

/// A frame laid on the whole model.
fn refined(kept: &KeptFrame, tracker: &mut Tracker) -> RegisteredFrame {
    let fit = tracker.fit(&kept.frame, &kept.t_rig_target);
    let pose = if fit.is_trusted() { fit.t_rig_target } else { kept.t_rig_target };
    RegisteredFrame::new(&kept.frame, &pose, tracker.beams(kept.frame.shot().sensor))
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
