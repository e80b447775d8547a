//! From the first sight of a target to a motion: frames are laid on a model that grows, without a filter, until the window
//! of poses is long enough to start one.

use crate::track::{RigMotion, TrackFrame, Tracker};
use crate::ukf::PoseMeasurement;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use tumbled_model::se3::Twist;
use tumbled_model::{RigNs, Span};

/// A motion is fitted to poses of this long, and so many of them at least.
const WINDOW: Span = Span(700_000_000);
const LEAST_POSES: usize = 6;
/// So many frames in a row that do not fit: what was begun with was something else.
const MISFITS: u32 = 6;
/// Without a fit for so long the beginning is forgotten.
const FORGOTTEN: Span = Span(2_000_000_000);
/// How far behind the middle of what is seen the body's own may lie, a share of the spread across the sight.
const DEPTH: f64 = 1.0;
/// A turn within the window beyond which a pair of poses tells no rate, rad.
const HALF_TURN: f64 = 2.6;

/// A target whose motion is not known yet.
#[derive(Debug)]
pub(super) struct Acquiring {
    tracker: Tracker,
    window: Vec<PoseMeasurement>,
    /// Where the target was first seen, rig frame, m.
    acquired_m: [f64; 3],
    /// When the last frame fitted.
    fitted: RigNs,
    misfits: u32,
}

/// What a frame did to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// It fits; the motion is not known yet.
    Fits,
    /// It does not fit.
    Misfit,
    /// The window is long enough for a filter.
    Ready,
    /// Nothing has fitted for too long.
    Hopeless,
}

impl Acquiring {
    /// From a first frame: axes are the rig's, the origin lies behind the middle of what is seen by what a body is deep
    /// (method.md §3.3).
    pub(super) fn begin(frame: &TrackFrame) -> Self {
        let t_rig_target = Isometry3::from_parts(Translation3::from(middle(frame)), UnitQuaternion::identity());
        Self::again(Tracker::begin(frame, &t_rig_target), frame, &t_rig_target)
    }

    /// With a model that is there, seen at a pose.
    pub(super) fn again(tracker: Tracker, frame: &TrackFrame, t_rig_target: &Isometry3<f64>) -> Self {
        let shot = frame.shot();
        // The first pose is where it is by definition.
        let information = nalgebra::Matrix6::identity() * 1e6;
        let first = PoseMeasurement { t: shot.t, sensor: shot.sensor, pose: *t_rig_target, information };
        let acquired_m = t_rig_target.translation.vector.into();
        Self { tracker, window: vec![first], acquired_m, fitted: shot.t, misfits: 0 }
    }

    /// Takes the next frame.
    pub(super) fn take(&mut self, frame: &TrackFrame) -> Step {
        let t = frame.shot().t;
        if t - self.fitted > FORGOTTEN || self.misfits >= MISFITS {
            return Step::Hopeless;
        }
        let fit = self.tracker.fit(frame, &self.expected(t));
        if !fit.is_trusted() {
            self.misfits += 1;
            return Step::Misfit;
        }
        self.misfits = 0;
        self.fitted = t;
        self.window.push(PoseMeasurement {
            t,
            sensor: frame.shot().sensor,
            pose: fit.t_rig_target,
            information: fit.information,
        });
        self.tracker.accept(frame, &fit);
        let oldest = self.window.first().map_or(t, |pose| pose.t);
        if self.window.len() >= LEAST_POSES && t - oldest >= WINDOW { Step::Ready } else { Step::Fits }
    }

    /// The poses so far.
    pub(super) fn window(&self) -> &[PoseMeasurement] {
        &self.window
    }

    /// Where the target was first seen, rig frame, m.
    pub(super) fn acquired_m(&self) -> [f64; 3] {
        self.acquired_m
    }

    /// The newest pose.
    fn pose(&self) -> Option<&Isometry3<f64>> {
        self.window.last().map(|last| &last.pose)
    }

    /// The model.
    pub(super) fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The model, to be asked.
    pub(super) fn tracker_mut(&mut self) -> &mut Tracker {
        &mut self.tracker
    }

    /// The model, which tracking goes on with.
    pub(super) fn into_tracker(self) -> Tracker {
        self.tracker
    }

    /// Forgets the oldest half of the window: its motion was none that a filter begins with.
    pub(super) fn shorten(&mut self) {
        self.window.drain(..self.window.len() / 2);
    }

    /// How the target moves by the longest pair of poses of one sensor, for points that were measured one after another.
    pub(super) fn motion(&self) -> RigMotion {
        let Some((rate, last)) = self.rate() else { return RigMotion::STILL };
        RigMotion {
            angular_rps: last.pose.rotation * rate.rotation,
            velocity_mps: last.pose.rotation * rate.translation,
            center: Point3::from(last.pose.translation.vector),
        }
    }

    /// Where the target should be.
    pub(super) fn expected(&self, t: RigNs) -> Isometry3<f64> {
        match self.rate() {
            None => self.pose().copied().unwrap_or_else(Isometry3::identity),
            Some((rate, last)) => {
                let dt_s = (t - last.t).0 as f64 * 1e-9;
                last.pose * Twist::new(rate.rotation * dt_s, rate.translation * dt_s).exp()
            }
        }
    }

    /// The body twist's rate, 1/s, and the pose it starts from: by poses of one sensor, for two have different errors.
    fn rate(&self) -> Option<(Twist, &PoseMeasurement)> {
        let last = self.window.last()?;
        let first = self.window.iter().find(|pose| {
            pose.sensor == last.sensor && pose.t < last.t && {
                let between = pose.pose.inverse() * last.pose;
                between.rotation.angle() < HALF_TURN
            }
        })?;
        let dt_s = (last.t - first.t).0 as f64 * 1e-9;
        let twist = Twist::log(&(first.pose.inverse() * last.pose));
        Some((Twist::new(twist.rotation / dt_s, twist.translation / dt_s), last))
    }
}

/// The middle of what is seen, moved back along the sight by what a body is deep.
fn middle(frame: &TrackFrame) -> Vector3<f64> {
    let count = frame.len().max(1) as f64;
    let middle = frame.points().iter().map(|point| point.coords).sum::<Vector3<f64>>() / count;
    let sight = middle - frame.shot().viewpoint.coords;
    let Some(along) = sight.try_normalize(1e-6) else { return middle };
    let (mut across, mut depth) = (0.0, 0.0);
    for point in frame.points() {
        let offset = point.coords - middle;
        let deep = offset.dot(&along);
        depth += deep * deep;
        across += 0.5 * (offset.norm_squared() - deep * deep);
    }
    middle + along * (DEPTH * libm::sqrt(across.min(depth.max(0.25 * across)) / count))
}
