//! A seed of a scene with a config, scored over an interval.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::evaluate::{Aligned, Alignment, Evaluation};
use tumbled_model::{RigNs, Span, Twist};
use tumbled_sim::scene::{Scene, SceneMotion, Transform};

use super::file::IntervalEntry;
use super::watch::Watch;
use crate::cli::Failure;
use crate::evaluation::report::Scored;
use crate::evaluation::score::{self, From, Outcome, Series, Truth, Wanted};
use crate::experiment::bounds::Share;
use crate::simulation::rig::View;

/// The first estimates, by which the target's frame is known.
const FIRST: Span = Span(1_000_000_000);

/// A trial, as a line of trials.jsonl.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseTrial {
    /// The scene of the campaign.
    pub scene: String,
    /// The config.
    pub config: String,
    /// The interval.
    pub interval: String,
    /// The seed.
    pub seed: u64,
    /// One hash over everything that came out, as `tumbled replay --digest` prints it.
    pub digest: String,
    /// Epochs of the whole session.
    pub epochs: u64,
    /// From the first epoch to the first that is tracked, s; null: none is.
    pub acquired_s: Option<f64>,
    /// From the target's return to the first epoch that is tracked again, s; null: it was not away, or was not found again.
    pub returned_s: Option<f64>,
    /// Epochs of the interval that were tracked.
    pub tracked: Share,
    /// States of mode `tracking` and validity `ok` with an attitude error above 10°, the time before the interval included.
    pub wrong: Share,
    /// The errors; null: nothing could be scored.
    pub errors: Option<PoseErrors>,
    /// Why nothing could be scored.
    pub unscored: Option<String>,
}

/// The errors of a trial: of each the r.m.s. over the interval, poses gauge-free if nothing else is said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseErrors {
    /// States scored.
    pub states: u64,
    /// Attitude, degrees.
    pub attitude_deg: f64,
    /// The largest, degrees.
    pub attitude_max_deg: f64,
    /// Attitude with the frames aligned in the first second of tracking, degrees; null: no truth then.
    pub drift_deg: Option<f64>,
    /// Position about its mean offset, mm.
    pub position_mm: f64,
    /// Velocity, mm/s.
    pub velocity_mmps: f64,
    /// Spin axis, degrees.
    pub axis_deg: f64,
    /// Spin rate, °/s.
    pub rate_dps: f64,
    /// Direction of the angular momentum, degrees; null: nobody estimates it.
    pub momentum_deg: Option<f64>,
    /// Stated σ of the attitude, the whole angle, degrees.
    pub sigma_deg: f64,
    /// Stated σ of the position, the whole length, mm.
    pub sigma_mm: f64,
    /// Mean of the innovations' normalised squares.
    pub nis: Option<f64>,
    /// Errors in units of their covariance, gauge-free.
    pub gauge_free: Option<Squares>,
    /// The same with the target's frame known, so that the error of the calibration is kept in.
    pub known_frame: Option<Squares>,
}

/// Errors beside their covariances: pose, velocity, angular velocity, three axes each; SI.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Squares {
    /// Mean NEES of all twelve.
    pub nees12: f64,
    /// Mean NEES of the pose's six.
    pub nees6: f64,
    /// Mean of the stated variances, by axis.
    pub variance: [f64; 12],
    /// Mean of the squared errors, by axis.
    pub square: [f64; 12],
}

/// What a trial is of.
#[derive(Clone, Copy, Debug)]
pub struct Names<'a> {
    /// The scene's name in the campaign.
    pub scene: &'a str,
    /// The config's.
    pub config: &'a str,
    /// The interval's.
    pub interval: &'a str,
}

impl PoseTrial {
    /// Scores what was watched of a scene over an interval. `returns`: when a target that was away is back.
    ///
    /// # Errors
    /// A time without truth: exit code 2.
    pub fn of(
        names: Names<'_>,
        (scene, view, truth): (&Scene, View, &Truth),
        (watch, digest): (&Watch, &str),
        interval: &IntervalEntry,
        returns: Option<RigNs>,
    ) -> Result<Self, Failure> {
        let wanted = Wanted { from: interval.from(), until: interval.until(), gauge: None, momentum: momentum(scene) };
        // What `evaluate` would warn of is in the figures: a short interval has few states.
        let score = |wanted: &Wanted| match score::score(&watch.gathered, truth, wanted, &mut Vec::new()) {
            // Nothing was tracked in this interval.
            Err(failure @ Failure::Input { .. }) => Ok(Outcome::Unscored(failure.to_string())),
            found => found,
        };
        let mut outcome = score(&wanted)?;
        if let Outcome::Scored(_, Series::Poses(found)) = &outcome {
            // Once more, the frame now known as well as it can be.
            outcome = score(&Wanted { gauge: known_frame(scene, view, watch, found), ..wanted })?;
        }
        let mut trial = Self {
            scene: names.scene.to_owned(),
            config: names.config.to_owned(),
            interval: names.interval.to_owned(),
            seed: scene.config.seed,
            digest: digest.to_owned(),
            epochs: watch.modes.len() as u64,
            acquired_s: watch.acquired_s(),
            returned_s: returns.and_then(|returns| watch.tracked_after(returns)),
            tracked: Share::new(0, watch.modes.len()),
            wrong: Share::new(0, 0),
            errors: None,
            unscored: None,
        };
        match outcome {
            Outcome::Scored(scored, Series::Poses(found)) => {
                let (from, until) = span(&scored, interval, watch);
                let (tracked, epochs) = watch.tracked_between(from, until);
                trial.tracked = Share::new(tracked, epochs);
                trial.wrong = scored.wrong;
                trial.errors = Some(errors(&found, watch));
            }
            Outcome::Scored(_, Series::Encoder(_)) => trial.unscored = Some("no truth".to_owned()),
            Outcome::Unscored(reason) => trial.unscored = Some(reason),
        }
        Ok(trial)
    }
}

/// The interval's ends: those it names, else those of what was scored, to the session's end.
fn span(scored: &Scored, interval: &IntervalEntry, watch: &Watch) -> (RigNs, RigNs) {
    let at = |seconds: f64| RigNs((seconds * 1e9) as i64);
    let from = match interval.from() {
        From::At(t) => t,
        From::Turns(_) => at(scored.from_s),
    };
    let until = match interval.until() {
        Some(From::At(t)) => t,
        Some(From::Turns(_)) => at(scored.to_s),
        None => watch.modes.last().map_or(from, |(t, _)| *t),
    };
    (from, until)
}

fn errors(found: &Evaluation, watch: &Watch) -> PoseErrors {
    let aligned = |wanted: Alignment| found.aligned.iter().find(|aligned| aligned.alignment == wanted);
    let squares = |aligned: Option<&Aligned>| {
        let of = aligned?.consistency.as_ref()?;
        Some(Squares { nees12: of.nees12.mean, nees6: of.nees6.mean, variance: of.variance, square: of.square })
    };
    let gauge_free = aligned(Alignment::MeanTwist);
    let pose = |value: &dyn Fn(&Aligned) -> f64| gauge_free.map_or(f64::NAN, value);
    let (from, until) = found.span;
    let stated = watch.gathered.estimates.iter().filter(|estimate| estimate.t >= from && estimate.t <= until);
    let stated: Vec<(f64, f64)> = stated
        .filter_map(|estimate| estimate.covariance.as_ref())
        .map(|covariance| {
            let trace = |first: usize| (first..first + 3).map(|axis| covariance[(axis, axis)]).sum::<f64>();
            (trace(0), trace(3))
        })
        .collect();
    let sigma = |of: &dyn Fn(&(f64, f64)) -> f64| (stated.iter().map(of).sum::<f64>() / stated.len() as f64).sqrt();
    PoseErrors {
        states: found.scored.into(),
        attitude_deg: pose(&|aligned| aligned.pose.attitude_rms_rad.to_degrees()),
        attitude_max_deg: pose(&|aligned| aligned.pose.attitude_max_rad.to_degrees()),
        drift_deg: aligned(Alignment::FirstSecond).map(|first| first.pose.attitude_rms_rad.to_degrees()),
        position_mm: pose(&|aligned| 1e3 * aligned.pose.position_rms_m),
        velocity_mmps: pose(&|aligned| 1e3 * aligned.pose.velocity_rms_mps),
        axis_deg: found.motion.axis_rad.rms.to_degrees(),
        rate_dps: found.motion.rate_rps.rms.to_degrees(),
        momentum_deg: found.motion.momentum_rad.as_ref().map(|errors| errors.rms.to_degrees()),
        sigma_deg: sigma(&|(rotation, _)| *rotation).to_degrees(),
        sigma_mm: 1e3 * sigma(&|(_, translation)| *translation),
        nis: found.nis.as_ref().map(|nis| nis.mean),
        gauge_free: squares(gauge_free),
        known_frame: squares(aligned(Alignment::Given)),
    }
}

/// What stays in a free tumble: R J ω; only its direction counts.
fn momentum(scene: &Scene) -> Option<Vector3<f64>> {
    let SceneMotion::Tumble { inertia, .. } = &scene.config.motion else { return None };
    let state = scene.world.target(RigNs(0))?;
    let rotation = state.t_rig_body.rotation;
    Some(rotation * (rotation.inverse() * state.angular_velocity_rps).component_mul(&Vector3::from(*inertia)))
}

/// Truth's target frame to the estimate's, with the error of the calibration kept in the estimates. What is constant in the
/// rig goes round in a target that turns: over whole turns the mean twist, which gauge-free figures remove, holds of it only
/// what is about and along the spin axis. This part is taken from the first sight instead.
fn known_frame(scene: &Scene, view: View, watch: &Watch, found: &Evaluation) -> Option<Isometry3<f64>> {
    let mean = found.aligned.iter().find(|aligned| aligned.alignment == Alignment::MeanTwist)?.gauge;
    let first = frame_of_first_sight(scene, view, watch)?;
    let (from, until) = found.span;
    let scored = watch.gathered.estimates.iter().filter(|estimate| estimate.t >= from && estimate.t <= until);
    let rate: Vector3<f64> =
        scored.map(|estimate| estimate.t_rig_target.rotation.inverse() * estimate.angular_velocity_rps).sum();
    let axis = rate.try_normalize(1e-9)?;
    let off = Twist::log(&(mean.inverse() * first));
    let along = |vector: Vector3<f64>| axis * axis.dot(&vector);
    Some(mean * Twist::new(along(off.rotation), along(off.translation)).exp())
}

/// Truth's target frame to the estimate's, from how that one is made: at the first sight its axes are the rig's, as the
/// mounting and the time offset of that sensor in the config have them (`estimate::acquire`). They are off by what is known
/// of a scene. The origin is that of the first second's estimates, corrected by the same and by the depth scale. The warp of
/// an image and the beams' biases are not corrected: nobody knows what they come to.
fn frame_of_first_sight(scene: &Scene, view: View, watch: &Watch) -> Option<Isometry3<f64>> {
    let (first_sight, sensor) = watch.first_sight.as_ref()?;
    let correction = Correction::of(scene, view, sensor.as_str())?;
    let truth = |t: RigNs| Some(scene.world.target(t + correction.later)?.t_rig_body);
    let rotation = truth(*first_sight)?.rotation.inverse() * correction.rotation();
    let estimates = &watch.gathered.estimates;
    let begin = estimates.first()?.t;
    let early = estimates.iter().take_while(|estimate| estimate.t - begin <= FIRST);
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for estimate in early {
        sum += truth(estimate.t)?.inverse_transform_point(&correction.of_point(&estimate.t_rig_target)).coords;
        count += 1.0;
    }
    Some(Isometry3::from_parts(Translation3::from(sum / count), rotation))
}

/// From what a sensor's calibration says to what is.
struct Correction {
    nominal: Isometry3<f64>,
    truth: Isometry3<f64>,
    /// True depth over nominal depth.
    scale: f64,
    /// True time less nominal time.
    later: Span,
}

impl Correction {
    fn of(scene: &Scene, view: View, sensor: &str) -> Option<Self> {
        let lidars = scene.config.lidar.iter().zip(&scene.lidars);
        let lidars = lidars.map(|(lidar, unit)| (lidar.id.as_str(), lidar.t_rig_lidar, unit.late(), None));
        let kinects = scene.config.kinect.iter().zip(&scene.kinects).map(|(kinect, unit)| {
            (kinect.id.as_str(), kinect.t_rig_kinect, unit.late(), Some(1.0 / kinect.parameters.depth_scale))
        });
        let (_, mounting, late, scale): (_, Transform, Span, Option<f64>) =
            lidars.chain(kinects).find(|(id, ..)| *id == sensor)?;
        let truth = mounting.isometry();
        if view == View::Truth {
            return Some(Self { nominal: truth, truth, scale: 1.0, later: Span(0) });
        }
        let late_s = late.as_secs_f64();
        Some(Self {
            nominal: scene.operators_mounting(sensor, &mounting).isometry(),
            truth,
            scale: scale.map_or(1.0, |scale| scale / scene.operators_depth_scale(sensor, scale)),
            later: Span(((scene.operators_time_s(sensor, late_s) - late_s) * 1e9) as i64),
        })
    }

    fn rotation(&self) -> UnitQuaternion<f64> {
        self.truth.rotation * self.nominal.rotation.inverse()
    }

    /// Where a pose's origin truly is.
    fn of_point(&self, pose: &Isometry3<f64>) -> Point3<f64> {
        let seen = self.nominal.inverse_transform_point(&Point3::from(pose.translation.vector));
        self.truth * Point3::from(seen.coords * self.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::scenes;

    #[test]
    fn what_is_known_of_a_sensors_calibration_tells_where_the_target_truly_is() {
        let scene = scenes::load("turntable-20dps").expect("a scene");
        let correction = Correction::of(&scene, View::Operator, "near").expect("a Kinect");
        // A point that the camera sees at (0.1, −0.2, 2.0) m, once with the operator's calibration and once with the truth:
        // its depth is nominal · s_true / s_nominal, and the mounting the true one.
        let scale = scene.operators_depth_scale("near", 1.0);
        let seen = Point3::new(0.1, -0.2, 2.0);
        let nominal = scene.operators_mounting("near", &scene.config.kinect[0].t_rig_kinect).isometry() * seen;
        let truth = scene.config.kinect[0].t_rig_kinect.isometry() * Point3::from(seen.coords / scale);
        let pose = Isometry3::from_parts(nominal.coords.into(), nalgebra::UnitQuaternion::identity());
        assert!((correction.of_point(&pose) - truth).norm() < 1e-12);
        assert!((nominal - truth).norm() > 1e-4, "the operator's calibration is off");
        // Nothing is to be corrected where the truth is the config.
        let none = Correction::of(&scene, View::Truth, "front").expect("a LiDAR");
        assert!(
            (none.of_point(&pose).coords - pose.translation.vector).norm() < 1e-12 && none.rotation().angle() < 1e-12
        );
        assert_eq!(none.later, Span(0));
    }

    #[test]
    fn a_tumbles_momentum_stays_and_a_turntable_has_none() {
        let scene = scenes::load("tumble").expect("a scene");
        // J = (1, 1.6, 1.9), ω = (9, 2, 12) °/s, and the target begins upright: h ∝ (9, 3.2, 22.8).
        let expected = Vector3::new(9.0, 3.2, 22.8).normalize();
        assert!((momentum(&scene).expect("one").normalize() - expected).norm() < 1e-9);
        assert_eq!(momentum(&scenes::load("demo").expect("a scene")), None);
    }
}
