//! The target between epochs: what a caller with a clock evaluates at any time, as often as it likes.

use super::age::Age;
use super::state::{Mode, TargetMotion, TargetState};
use crate::ukf::MotionPredictor;
use tumbled_model::RigNs;

/// What an epoch lets be said of later times. Does not change; rests on the ledger alone, as the state it follows does.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictor {
    /// The state it follows, without what only the epoch's own time has.
    state: TargetState,
    tracked: Option<Tracked>,
}

/// A target that is tracked.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tracked {
    /// How it goes on.
    pub(super) motion: MotionPredictor,
    /// When it was last measured.
    pub(super) measured: RigNs,
}

impl Predictor {
    /// After an epoch's state.
    pub(super) fn new(state: &TargetState, tracked: Option<Tracked>) -> Self {
        let state = TargetState { motion: None, nis: None, ..state.clone() };
        Self { state, tracked }
    }

    /// The epoch that it follows.
    pub fn epoch(&self) -> u64 {
        self.state.epoch
    }

    /// When the target was last measured; `None`: it is not tracked.
    pub fn measured(&self) -> Option<RigNs> {
        self.tracked.as_ref().map(|tracked| tracked.measured)
    }

    /// The target at a time, by rights not before its epoch's. The mode is `tracking` while the newest measurement is at
    /// most 0.3 s old and `predicted` from then on; after 1 s the state is not valid, after 3 s the target is lost, as for
    /// epochs. `nis` is `None`; `inputs` are the epoch's and say nothing of this time.
    pub fn at(&self, t: RigNs) -> TargetState {
        let mut state = TargetState { t, ..self.state.clone() };
        let Some(tracked) = &self.tracked else { return state };
        let age = Age::of(t - tracked.measured);
        let (most, reason) = age.trust();
        state.validity = state.validity.max(most);
        state.reasons.extend(reason);
        state.reasons.sort_unstable();
        state.reasons.dedup();
        state.mode = match age {
            Age::Fresh => Mode::Tracking,
            Age::Predicted | Age::Stale => Mode::Predicted,
            Age::Lost => Mode::Lost,
        };
        state.motion = (age < Age::Lost).then(|| tracked.motion.at(t).into());
        state
    }

    /// Where a tracked target will be at a time, however long after the newest measurement: the covariance says how well
    /// that is known. `None`: it is not tracked.
    pub fn motion_at(&self, t: RigNs) -> Option<TargetMotion> {
        self.tracked.as_ref().map(|tracked| tracked.motion.at(t).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::state::{StateInputs, StateReason, Validity};
    use crate::ukf::{Filter, FilterOptions, PoseMeasurement, SensorPrior, StatedUncertainty};
    use nalgebra::{Isometry3, Matrix6, Translation3, Vector3};
    use tumbled_model::se3::exp_rotation;
    use tumbled_model::{SensorId, Span};

    /// A filter of a target that turns by 20°/s about z at x = 2 m, a second of a Kinect's poses old.
    fn filter() -> Filter {
        let pose = |n: i64| {
            let angle = 20f64.to_radians() * n as f64 / 30.0;
            Isometry3::from_parts(Translation3::new(2.0, 0.0, 0.0), exp_rotation(&(Vector3::z() * angle)))
        };
        let poses: Vec<PoseMeasurement> = (0..31)
            .map(|n| PoseMeasurement {
                t: RigNs(n * 33_333_333),
                sensor: 0,
                pose: pose(n),
                information: Matrix6::identity() * 1e6,
            })
            .collect();
        let prior = SensorPrior::kinect(Isometry3::translation(2.0, 0.0, 0.0), 2.0, &StatedUncertainty::default());
        Filter::start(FilterOptions::fixed_axis(), vec![prior], &poses).expect("a motion")
    }

    fn predictor(validity: Validity, reasons: &[StateReason]) -> Predictor {
        let motion = filter().predictor();
        let state = TargetState {
            epoch: 30,
            t: motion.t(),
            sensor: SensorId::from("near"),
            mode: Mode::Tracking,
            validity,
            reasons: reasons.to_vec(),
            motion: None,
            nis: Some(6.0),
            inputs: StateInputs::default(),
            alternatives: 0,
        };
        let measured = motion.t();
        Predictor::new(&state, Some(Tracked { motion, measured }))
    }

    #[test]
    fn it_says_what_the_filter_says() {
        let (filter, predictor) = (filter(), predictor(Validity::Ok, &[]));
        for ms in [0, 7, 33, 250, 900] {
            let t = filter.estimate().t + Span(ms * 1_000_000);
            let (own, of_filter) = (predictor.motion_at(t).expect("tracked"), TargetMotion::from(filter.predict(t)));
            assert_eq!(own.t_rig_target, of_filter.t_rig_target, "{ms} ms");
            // The same rows in another triangle: alike but for rounding.
            let off = (own.covariance - of_filter.covariance).norm() / of_filter.covariance.norm();
            assert!(off < 1e-9, "{ms} ms: {off:e}");
        }
    }

    #[test]
    fn a_prediction_turns_on_and_knows_less_the_older_it_is() {
        let predictor = predictor(Validity::Ok, &[]);
        let measured = predictor.measured().expect("tracked");
        let sigma = |ms: i64| {
            let motion = predictor.at(measured + Span(ms * 1_000_000)).motion.expect("a motion");
            motion.covariance.fixed_view::<6, 6>(0, 0).trace()
        };
        assert!(sigma(0) < sigma(100) && sigma(100) < sigma(900));
        let now = predictor.motion_at(measured).expect("tracked").t_rig_target.rotation;
        let later = predictor.motion_at(measured + Span(900_000_000)).expect("tracked").t_rig_target.rotation;
        // 20°/s · 0.9 s = 18°; the poses are exact, the filter's prior is not: to 0.1°.
        assert!((now.angle_to(&later).to_degrees() - 18.0).abs() < 0.1);
    }

    #[test]
    fn mode_and_validity_follow_the_age_as_an_epochs_do() {
        let predictor = predictor(Validity::Degraded, &[StateReason::OneSensor]);
        let measured = predictor.measured().expect("tracked");
        let at = |ms: i64| {
            let state = predictor.at(measured + Span(ms * 1_000_000));
            (state.mode, state.validity, state.reasons, state.motion.is_some())
        };
        let one = vec![StateReason::OneSensor];
        assert_eq!(at(300), (Mode::Tracking, Validity::Degraded, one.clone(), true));
        assert_eq!(at(1_000), (Mode::Predicted, Validity::Degraded, one, true));
        let stale = vec![StateReason::OneSensor, StateReason::Stale];
        assert_eq!(at(1_001), (Mode::Predicted, Validity::Invalid, stale.clone(), true));
        assert_eq!(at(3_001), (Mode::Lost, Validity::Invalid, stale, false));
    }

    #[test]
    fn a_target_that_is_not_tracked_is_not_predicted() {
        let state = TargetState { mode: Mode::Acquiring, ..predictor(Validity::Degraded, &[]).state };
        let untracked = Predictor::new(&state, None);
        let later = untracked.at(state.t + Span(5_000_000_000));
        assert_eq!((later.mode, later.motion, untracked.motion_at(state.t)), (Mode::Acquiring, None, None));
    }
}
