//! Every epoch to a state of the target: nothing is seen, it is acquired, it is tracked, it is lost and found again.

use super::acquire::{Acquiring, Step};
use super::age::Age;
use super::axis::AxisTest;
use super::begin;
use super::company::{Company, Seen};
use super::manoeuvre::Refusals;
use super::mounting::MountingCheck;
use super::orders::{self, Orders, Told};
use super::predictor::{Predictor, Tracked};
use super::reacquire::Missed;
use super::report::EstimateHealth;
use super::sensors::{self, PointSensor};
use super::settings::{EstimateSettings, TargetMotionKind, TargetSearch};
use super::state::{Mode, StateInputs, StateReason, TargetState, Validity};
use super::tracking::Tracking;
use crate::config::CoreConfig;
use crate::epoch::Epoch;
use crate::notice::{Gravity, NoticeKind};
use crate::segment::{Expectation, Search, Segment, Segmenter};
use crate::track::{RigMotion, Surfels, TrackFrame, Tracker};
use crate::ukf::{Motion, PoseMeasurement, SensorPrior};
use crate::workers::Workers;
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_model::{Command, RigNs, SensorId, Span};

/// Points of the target below which nothing is begun.
const FIRST_SIGHT: usize = 60;
/// A sensor that has not measured for so long does not take part.
const TAKES_PART: Span = Span(2_000_000_000);
/// So long after the start of a filter its motion is still settling.
const SETTLING: Span = Span(1_000_000_000);
/// The target reaches this far beyond its model's radius, m.
const BEYOND_M: f64 = 0.10;
/// A tumble's filter begins when a filter of a fixed axis has brought tracking and model so far.
const TUMBLE_AFTER: Span = Span(3_000_000_000);

/// A frame that shows the target and nothing else, and where it lies on the model.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptFrame {
    /// Counts the targets that were begun in the session, from 1: each has a frame of its own.
    pub target: u32,
    /// The frame's points, rig frame, without corrections of beams.
    pub frame: TrackFrame,
    /// The pose at which it fits the model as it then was.
    pub t_rig_target: Isometry3<f64>,
}

/// The estimation: one for a session.
#[derive(Debug)]
pub(crate) struct Estimator {
    settings: EstimateSettings,
    sensors: Vec<PointSensor>,
    segmenter: Segmenter,
    segment: Segment,
    company: Company,
    orders: Orders,
    /// Until when the empty room is learned.
    learning: Option<RigNs>,
    stage: Stage,
    /// Frames that show the target, for whoever asked for them.
    kept: Option<Vec<KeptFrame>>,
    /// Targets begun so far: each has a frame of its own.
    targets: u32,
}

#[derive(Debug)]
enum Stage {
    Empty,
    Acquiring(Box<Acquiring>),
    Tracking(Box<Tracking>),
    Lost(Box<Missed>),
}

impl Stage {
    /// Before anything was seen: a target that is known is looked for, any other is waited for.
    fn at_first(settings: &EstimateSettings, sensors: usize) -> Self {
        settings.known.as_ref().map_or(Self::Empty, |known| {
            Self::Lost(Box::new(Missed::known(Tracker::known(Surfels::clone(known)), sensors)))
        })
    }
}

impl Estimator {
    /// Has seen nothing yet.
    pub(crate) fn new(config: &CoreConfig) -> Self {
        let sensors = sensors::of_config(config);
        Self {
            stage: Stage::at_first(&config.estimate, sensors.len()),
            settings: config.estimate.clone(),
            sensors,
            segmenter: Segmenter::new(match config.estimate.search {
                TargetSearch::Region => Search::Region(config.roi),
                TargetSearch::Nearest => Search::Nearest,
                TargetSearch::Everything => Search::Everything,
            }),
            segment: Segment::default(),
            company: Company::default(),
            orders: Orders::default(),
            learning: None,
            kept: None,
            targets: 0,
        }
    }

    /// Frames that show the target are kept from here on.
    pub(crate) fn keep_frames(&mut self) {
        self.kept = Some(Vec::new());
    }

    /// The frames kept since, handed over.
    pub(crate) fn kept(&mut self) -> impl Iterator<Item = KeptFrame> + '_ {
        self.kept.iter_mut().flat_map(|kept| kept.drain(..))
    }

    /// The model, where there is a target.
    pub(crate) fn tracker(&self) -> Option<&Tracker> {
        match &self.stage {
            Stage::Empty => None,
            Stage::Acquiring(acquiring) => Some(acquiring.tracker()),
            Stage::Tracking(tracking) => Some(&tracking.tracker),
            Stage::Lost(missed) => Some(&missed.tracker),
        }
    }

    /// What the filter believes of the sensors for a target at a place, rig frame; in the frames' numbers.
    pub(crate) fn sensor_priors(&self, center: &Vector3<f64>) -> Vec<SensorPrior> {
        self.sensors.iter().map(|sensor| sensor.prior(center)).collect()
    }

    /// How many targets were begun.
    pub(crate) fn targets(&self) -> u32 {
        self.targets
    }

    /// Takes over a changed config: the target is acquired anew, for its place in the rig may be another one.
    /// What was learned of the empty room stays while the sensors stand where they stood; nothing is learned anew. Returns
    /// whether a room was forgotten.
    pub(crate) fn configure(&mut self, config: &CoreConfig) -> bool {
        let before = core::mem::replace(self, Self::new(config));
        self.settings.background = None;
        (self.orders, self.kept, self.targets) = (before.orders, before.kept, before.targets);
        let stands = |(a, b): (&PointSensor, &PointSensor)| a.id == b.id && a.t_rig_sensor == b.t_rig_sensor;
        if before.sensors.iter().zip(&self.sensors).all(stands) && before.learning.is_none() {
            self.segmenter.take_over(before.segmenter);
            return false;
        }
        before.learning.is_some() || before.segmenter.knows_a_room()
    }

    /// Takes an operator's order, given at a time: it is in force from the first epoch on that is not before it.
    pub(crate) fn order(&mut self, at: RigNs, command: &Command) {
        self.orders.push(at, command);
    }

    /// The target after an epoch; what an operator should know of it is appended to `told`.
    pub(crate) fn take(&mut self, epoch: &Epoch, workers: &Workers, told: &mut Vec<Told>) -> TargetState {
        let Some(number) = self.sensors.iter().position(|sensor| sensor.id == epoch.sensor) else {
            return blank(epoch, false);
        };
        self.obey(epoch.t, told);
        if self.learning.is_some() {
            self.segmenter.learn(epoch);
            let is_kinect = self.sensors.get(number).is_some_and(|sensor| sensor.is_kinect);
            return TargetState { reasons: vec![StateReason::Learning], ..blank(epoch, is_kinect) };
        }
        let (expected, motion) = self.expectation(epoch.t);
        let mut segment = core::mem::take(&mut self.segment);
        self.segmenter.segment(epoch, expected.as_ref(), &mut segment);
        self.part_company(number, epoch, &mut segment, told);
        let is_kinect = self.sensors.get(number).is_some_and(|sensor| sensor.is_kinect);
        let mut state = blank(epoch, is_kinect);
        state.inputs.points = segment.indices.len() as u32;
        let is_part = self.sensors.get_mut(number).is_some_and(|sensor| sensor.saw_a_part(epoch));
        if is_part && matches!(self.stage, Stage::Empty | Stage::Lost(_)) {
            segment.indices.clear();
        }
        if segment.ambiguous {
            state.reasons.push(StateReason::Ambiguous);
        }
        if let Some(sensor) = self.sensors.get(number) {
            let frame = sensor.frame(number, epoch, &segment.indices, &motion);
            self.advance(&frame, &mut state, workers);
        }
        if segment.ambiguous {
            state.validity = state.validity.max(Validity::Degraded);
        }
        self.segment = segment;
        state.reasons.sort_unstable();
        state.reasons.dedup();
        state
    }

    /// Does what an operator has ordered up to a time, and ends the learning that is over.
    fn obey(&mut self, t: RigNs, told: &mut Vec<Told>) {
        if let Some(lasts) = self.settings.background.take() {
            self.learning = Some(t + lasts);
            told.push(orders::begun(lasts));
        }
        while let Some((at, command)) = self.orders.due(t) {
            match command {
                Command::LearnBackground { lasts_ms } => {
                    let lasts = Span(i64::from(lasts_ms) * 1_000_000);
                    (self.learning, self.stage) = (Some(at + lasts), self.at_first());
                    told.push(orders::begun(lasts));
                }
                Command::ForgetBackground => {
                    self.learning = None;
                    self.segmenter.forget();
                    told.push((NoticeKind::Background, Gravity::Info, "the background is forgotten".to_owned()));
                }
                Command::ResetFilter => {
                    self.stage = self.at_first();
                    let message = match self.settings.known {
                        None => "the target is forgotten, and acquired anew in a frame of its own",
                        Some(_) => "the target is forgotten, and acquired anew in its saved frame",
                    };
                    told.push((NoticeKind::Reset, Gravity::Info, message.to_owned()));
                }
                _ => {}
            }
        }
        if self.learning.is_some_and(|until| t >= until) {
            self.learning = None;
            let report = self.segmenter.learned();
            told.extend(orders::learned(&report, self.sensors.iter().map(|sensor| &sensor.id)));
        }
    }

    /// Leaves out of a segment what is not known to move with the target. At first sight, and when it is looked for again, the
    /// target is all that lies together.
    fn part_company(&mut self, number: usize, epoch: &Epoch, segment: &mut Segment, told: &mut Vec<Told>) {
        let target = match &mut self.stage {
            Stage::Empty | Stage::Lost(_) => return,
            Stage::Acquiring(acquiring) => {
                let t_rig_target = acquiring.expected(epoch.t);
                Seen { t_rig_target, tracker: acquiring.tracker_mut(), is_sure: false }
            }
            Stage::Tracking(tracking) => Seen {
                t_rig_target: tracking.filter.predict(epoch.t).t_rig_target,
                is_sure: tracking.is_sure && epoch.t - tracking.began >= SETTLING,
                tracker: &mut tracking.tracker,
            },
        };
        let standing = self.company.part(number, epoch, segment, &mut self.segmenter, target);
        if standing > 0 {
            told.push(orders::stands(&epoch.sensor, standing));
        }
    }

    /// Where the target should be seen, and how it should move.
    fn expectation(&self, t: RigNs) -> (Option<Expectation>, RigMotion) {
        let (pose, motion, tracker) = match &self.stage {
            Stage::Empty | Stage::Lost(_) => return (None, RigMotion::STILL),
            Stage::Acquiring(acquiring) => (acquiring.expected(t), acquiring.motion(), acquiring.tracker()),
            Stage::Tracking(tracking) => {
                let estimate = tracking.filter.predict(t);
                let pose = estimate.t_rig_target;
                let motion = RigMotion {
                    angular_rps: pose.rotation * estimate.angular_velocity_rps,
                    velocity_mps: estimate.velocity_mps,
                    center: Point3::from(pose.translation.vector),
                };
                (pose, motion, &tracking.tracker)
            }
        };
        // Of one side alone the other may be as large.
        let radius_m = 1.3 * reach_m(tracker) + BEYOND_M;
        (Some(Expectation { center: Point3::from(pose.translation.vector), radius_m }), motion)
    }

    /// One frame through the stage.
    fn advance(&mut self, frame: &TrackFrame, state: &mut TargetState, workers: &Workers) {
        self.stage = match core::mem::replace(&mut self.stage, Stage::Empty) {
            Stage::Empty => self.first_sight(frame, state),
            Stage::Acquiring(acquiring) => self.acquire(acquiring, frame, state),
            Stage::Tracking(tracking) => self.track(tracking, frame, state),
            Stage::Lost(missed) => self.search(missed, frame, state, workers),
        };
    }

    fn first_sight(&mut self, frame: &TrackFrame, state: &mut TargetState) -> Stage {
        if let Some(reason) = too_few(frame) {
            state.reasons.push(reason);
            return Stage::Empty;
        }
        state.mode = Mode::Acquiring;
        state.reasons.push(StateReason::Settling);
        self.targets += 1;
        self.company.forget();
        Stage::Acquiring(Box::new(Acquiring::begin(frame)))
    }

    fn acquire(&mut self, mut acquiring: Box<Acquiring>, frame: &TrackFrame, state: &mut TargetState) -> Stage {
        state.mode = Mode::Acquiring;
        state.reasons.push(StateReason::Settling);
        match acquiring.take(frame) {
            Step::Fits => Stage::Acquiring(acquiring),
            Step::Misfit => {
                state.reasons.push(StateReason::PoorFit);
                Stage::Acquiring(acquiring)
            }
            Step::Hopeless if self.settings.known.is_some() => self.at_first(),
            Step::Hopeless => self.first_sight(frame, state),
            Step::Ready => {
                let motion = Motion::FixedAxis;
                let acquired_m = acquiring.acquired_m();
                match begin::filter(&self.settings, &self.sensors, acquiring.window(), motion, acquired_m) {
                    Some(filter) => {
                        let t = frame.shot().t;
                        let poses = acquiring.window().iter().copied().collect();
                        let tracking = Tracking {
                            tracker: acquiring.into_tracker(),
                            filter,
                            motion,
                            acquired_m,
                            began: t,
                            measured: t,
                            poses,
                            axes: self.sensors.iter().map(|sensor| AxisTest::new(sensor.is_kinect)).collect(),
                            mounting: self.mounting_check(acquired_m),
                            tumbles: self.settings.motion == TargetMotionKind::Tumble,
                            refused: Refusals::default(),
                            unsteady: None,
                            most_points: vec![0; self.sensors.len()],
                            accepted: vec![None; self.sensors.len()],
                            is_sure: false,
                        };
                        self.note_measured(frame);
                        state.motion = Some(tracking.filter.estimate().into());
                        state.mode = Mode::Tracking;
                        state.validity = Validity::Degraded;
                        Stage::Tracking(Box::new(tracking))
                    }
                    None => {
                        acquiring.shorten();
                        Stage::Acquiring(acquiring)
                    }
                }
            }
        }
    }

    fn mounting_check(&self, acquired_m: [f64; 3]) -> MountingCheck {
        let sensors = &self.sensors;
        let priors = sensors.iter().map(|sensor| sensor.prior(&acquired_m.into())).collect();
        MountingCheck::new(priors, sensors.iter().map(|sensor| sensor.t_rig_sensor).collect())
    }

    fn track(&mut self, mut tracking: Box<Tracking>, frame: &TrackFrame, state: &mut TargetState) -> Stage {
        let t = frame.shot().t;
        let is_clear = !state.reasons.contains(&StateReason::Ambiguous);
        let measured = tracking.measure(frame, is_clear);
        state.nis = measured.nis;
        if let Some(fit) = &measured.fit {
            state.inputs.inliers = if fit.used > 0 { fit.inliers as f64 / fit.used as f64 } else { 0.0 };
            state.inputs.rmse_m = fit.rmse_m;
        }
        state.reasons.extend(measured.reasons);
        if measured.used {
            self.note_measured(frame);
        }
        if let (Some(kept), Some(fit), true) = (&mut self.kept, &measured.fit, measured.shows_target) {
            kept.push(KeptFrame { target: self.targets, frame: frame.clone(), t_rig_target: fit.t_rig_target });
        }
        self.release(&mut tracking, t);
        let age = Age::of(t - tracking.measured);
        if measured.lost || age == Age::Lost {
            state.mode = Mode::Lost;
            state.reasons.push(StateReason::Stale);
            let last = tracking.poses.back().map_or_else(Isometry3::identity, |pose| pose.pose);
            let Tracking { tracker, most_points, .. } = *tracking;
            return Stage::Lost(Box::new(Missed::new(tracker, last, most_points)));
        }
        state.motion = Some(tracking.filter.predict(t).into());
        state.mode = if measured.used { Mode::Tracking } else { Mode::Predicted };
        let (most, stale) = age.trust();
        state.validity = most;
        state.reasons.extend(stale);
        if t - tracking.began < SETTLING {
            state.reasons.push(StateReason::Settling);
        }
        let takes_part = |sensor: &&PointSensor| sensor.measured.is_some_and(|measured| t - measured < TAKES_PART);
        if self.sensors.len() > 1 && self.sensors.iter().filter(takes_part).count() < 2 {
            state.reasons.push(StateReason::OneSensor);
        }
        if !state.reasons.is_empty() {
            state.validity = state.validity.max(Validity::Degraded);
        }
        Stage::Tracking(tracking)
    }

    /// Goes over to a free motion where the axis does not stay. A filter of a free motion that begins with the first poses
    /// takes their slow errors for inertia: measured 2.4° instead of 0.3°.
    fn release(&self, tracking: &mut Tracking, t: RigNs) {
        let may = self.settings.motion != TargetMotionKind::FixedAxis && tracking.motion == Motion::FixedAxis;
        if !(may && tracking.tumbles && t - tracking.began >= TUMBLE_AFTER) {
            return;
        }
        let poses: Vec<PoseMeasurement> = tracking.poses.iter().copied().collect();
        if let Some(filter) =
            begin::filter(&self.settings, &self.sensors, &poses, Motion::FreeTumble, tracking.acquired_m)
        {
            (tracking.filter, tracking.motion, tracking.began) = (filter, Motion::FreeTumble, t);
        }
    }

    fn search(
        &mut self,
        mut missed: Box<Missed>,
        frame: &TrackFrame,
        state: &mut TargetState,
        workers: &Workers,
    ) -> Stage {
        state.mode = if missed.was_tracked() { Mode::Lost } else { Mode::Acquiring };
        match too_few(frame).map_or_else(|| missed.look(frame, workers), Err) {
            Ok(Some(pose)) => {
                state.mode = Mode::Acquiring;
                state.reasons.push(StateReason::Settling);
                return Stage::Acquiring(Box::new(Acquiring::again(missed.tracker, frame, &pose)));
            }
            Ok(None) => {}
            Err(reason) => {
                if reason == StateReason::NoPoints && !missed.was_tracked() {
                    state.mode = Mode::NoTarget;
                }
                state.reasons.push(reason);
            }
        }
        Stage::Lost(missed)
    }

    fn at_first(&self) -> Stage {
        Stage::at_first(&self.settings, self.sensors.len())
    }

    fn note_measured(&mut self, frame: &TrackFrame) {
        if let Some(sensor) = self.sensors.get_mut(frame.shot().sensor) {
            sensor.measured = Some(frame.shot().t);
        }
    }

    /// What it says of itself after an epoch's state; `since` when it stands so.
    pub(crate) fn health(&self, state: &TargetState, since: RigNs) -> EstimateHealth {
        let tracked = match &self.stage {
            Stage::Tracking(tracking) => Some((&tracking.filter, &tracking.mounting)),
            Stage::Empty | Stage::Acquiring(_) | Stage::Lost(..) => None,
        };
        let names: Vec<&SensorId> = self.sensors.iter().map(|sensor| &sensor.id).collect();
        EstimateHealth::new((state, since), tracked, &names)
    }

    /// What can be said of the times after an epoch's state.
    pub(crate) fn predictor(&self, state: &TargetState) -> Predictor {
        let tracked = match &self.stage {
            Stage::Tracking(tracking) => {
                Some(Tracked { motion: tracking.filter.predictor(), measured: tracking.measured })
            }
            Stage::Empty | Stage::Acquiring(_) | Stage::Lost(..) => None,
        };
        Predictor::new(state, tracked)
    }
}

/// Why nothing can be begun with a frame.
fn too_few(frame: &TrackFrame) -> Option<StateReason> {
    (frame.len() < FIRST_SIGHT).then(|| if frame.is_empty() { StateReason::NoPoints } else { StateReason::FewPoints })
}

/// How far the model reaches from the target's origin, m.
fn reach_m(tracker: &Tracker) -> f64 {
    let squares = tracker.surfels().positions().iter().map(|place| place.coords.norm_squared());
    libm::sqrt(squares.fold(0.0, f64::max))
}

fn blank(epoch: &Epoch, is_kinect: bool) -> TargetState {
    TargetState {
        epoch: epoch.number,
        t: epoch.t,
        sensor: epoch.sensor.clone(),
        mode: Mode::NoTarget,
        validity: Validity::Invalid,
        reasons: Vec::new(),
        motion: None,
        nis: None,
        inputs: StateInputs { is_kinect, ..StateInputs::default() },
        alternatives: 0,
    }
}
