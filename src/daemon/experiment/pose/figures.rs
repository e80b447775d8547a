//! What the poses at a target's rests come to.

use nalgebra::{UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::evaluate::{Alignment, EstimateSample, EvaluateOptions, Trajectory, evaluate};

use super::methods::{PoseMethod, Posed};
use super::rests::Rest;

/// Root mean square and largest of some errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Root mean square.
    pub rms: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Of errors; `None`: there are none.
    fn of(errors: &[f64]) -> Option<Self> {
        let square: f64 = errors.iter().map(|error| error * error).sum();
        let rms = (square / errors.len() as f64).sqrt();
        rms.is_finite().then(|| Self { rms, max: errors.iter().fold(0.0, |max, error| f64::max(max, error.abs())) })
    }
}

/// A method in a session of steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseRow {
    /// The sensors: a set's name, or the recording's.
    pub set: String,
    /// The axis that was turned about: `x`, `y` or `z`; null: a recording, nobody says.
    pub axis: Option<String>,
    /// The method.
    pub method: PoseMethod,
    /// Rests of the target.
    pub rests: u64,
    /// Rests in which the method had a pose.
    pub posed: u64,
    /// Attitude errors at the rests, gauge-free, degrees; null: no truth, or not two poses.
    pub attitude_deg: Option<Spread>,
    /// Position errors at the rests about their mean offset, r.m.s., mm; null as above.
    pub position_rms_mm: Option<f64>,
    /// Angle between the axis of all steps together and the true one, degrees; null: no truth, or no step.
    pub axis_deg: Option<f64>,
    /// Angle between each step's axis and the true one; without a truth the one of all steps together; degrees.
    pub step_axis_deg: Option<Spread>,
    /// Angle of each step less the true one, or the encoder's, degrees; null: nobody knows it.
    pub step_deg: Option<Spread>,
    /// Rest by rest.
    pub at: Vec<AtRest>,
}

/// A rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AtRest {
    /// Its number, from 0.
    pub rest: u64,
    /// When it ends, session time, s.
    pub until_s: f64,
    /// Angle turned since the rest before as estimated, degrees; null: no pose here or there.
    pub step_deg: Option<f64>,
    /// The true one, or the encoder's.
    pub true_step_deg: Option<f64>,
    /// Angle between this step's axis and the one it is compared with, degrees.
    pub step_axis_deg: Option<f64>,
    /// Attitude error, gauge-free, degrees.
    pub attitude_deg: Option<f64>,
}

/// What is known of the rests besides what is estimated.
#[derive(Clone, Copy, Debug)]
pub enum Known<'a> {
    /// Everything.
    Truth(&'a Trajectory, &'a [UnitQuaternion<f64>]),
    /// An encoder's angles, rad.
    Encoder(&'a [f64]),
    /// Nothing.
    Nothing,
}

/// The figures of a method's poses.
pub fn row(
    set: &str,
    axis: Option<&str>,
    method: PoseMethod,
    (rests, poses): (&[Rest], &[Posed]),
    known: Known<'_>,
) -> PoseRow {
    let at: Vec<Option<Posed>> = rests.iter().map(|rest| rest.last(poses)).collect();
    let attitudes: Vec<Option<UnitQuaternion<f64>>> =
        at.iter().map(|posed| Some(posed.as_ref()?.t_rig_target.rotation)).collect();
    let steps = steps(&attitudes);
    let (true_steps, true_angles): (Option<Vec<_>>, Vec<Option<f64>>) = match known {
        Known::Truth(_, truth) => {
            let steps = self::steps(&truth.iter().map(|attitude| Some(*attitude)).collect::<Vec<_>>());
            let angles = steps.iter().map(|step| step.map(|step| step.norm().to_degrees())).collect();
            (Some(steps), angles)
        }
        Known::Encoder(angles) => (None, encoder_steps(angles)),
        Known::Nothing => (None, vec![None; steps.len()]),
    };
    let whole = sum(&steps);
    let true_whole = true_steps.as_ref().map(|steps| sum(steps));
    let reference = |n: usize| match &true_steps {
        Some(steps) => steps.get(n).copied().flatten(),
        None => Some(whole),
    };
    let errors = attitude_errors(&at, known);
    let lines = rests.iter().enumerate().map(|(n, rest)| {
        let step = steps.get(n).copied().flatten();
        AtRest {
            rest: n as u64,
            until_s: rest.until.0 as f64 * 1e-9,
            step_deg: step.map(|step| step.norm().to_degrees()),
            true_step_deg: true_angles.get(n).copied().flatten(),
            step_axis_deg: step.and_then(|step| angle_deg(&step, &reference(n)?)),
            attitude_deg: errors.as_ref().and_then(|(errors, _)| *errors.get(n)?),
        }
    });
    let lines: Vec<AtRest> = lines.collect();
    let all = |of: &dyn Fn(&AtRest) -> Option<f64>| Spread::of(&lines.iter().filter_map(of).collect::<Vec<_>>());
    PoseRow {
        set: set.to_owned(),
        axis: axis.map(str::to_owned),
        method,
        rests: rests.len() as u64,
        posed: at.iter().flatten().count() as u64,
        attitude_deg: all(&|line| line.attitude_deg),
        position_rms_mm: errors.as_ref().map(|(_, position)| *position),
        axis_deg: true_whole.and_then(|truth| angle_deg(&whole, &truth)),
        step_axis_deg: all(&|line| line.step_axis_deg),
        step_deg: all(&|line| Some(line.step_deg? - line.true_step_deg?)),
        at: lines,
    }
}

/// The rotation vector in rig axes from the rest before to each; `None` at the first one and where a pose is missing.
fn steps(attitudes: &[Option<UnitQuaternion<f64>>]) -> Vec<Option<Vector3<f64>>> {
    let before = core::iter::once(&None).chain(attitudes);
    before.zip(attitudes).map(|(before, now)| Some(((*now)? * (*before)?.inverse()).scaled_axis())).collect()
}

/// An encoder's angles as steps, degrees, whichever way it counts.
fn encoder_steps(angles: &[f64]) -> Vec<Option<f64>> {
    let steps = angles.iter().zip(angles.iter().skip(1)).map(|(a, b)| Some((b - a).abs().to_degrees()));
    core::iter::once(None).chain(steps).collect()
}

fn sum(steps: &[Option<Vector3<f64>>]) -> Vector3<f64> {
    steps.iter().flatten().sum()
}

/// `None`: one of them has no direction.
fn angle_deg(a: &Vector3<f64>, b: &Vector3<f64>) -> Option<f64> {
    let (a, b) = (a.try_normalize(1e-9)?, b.try_normalize(1e-9)?);
    Some(a.cross(&b).norm().atan2(a.dot(&b)).to_degrees())
}

/// Attitude errors by rest, degrees, and the position's r.m.s., mm, gauge-free by `tumbled evaluate`'s own figures.
fn attitude_errors(at: &[Option<Posed>], known: Known<'_>) -> Option<(Vec<Option<f64>>, f64)> {
    let Known::Truth(truth, _) = known else { return None };
    let estimates: Vec<EstimateSample> = at.iter().flatten().map(sample).collect();
    let found = evaluate(&estimates, truth, &EvaluateOptions::default()).ok()?;
    let aligned = found.aligned.iter().find(|aligned| aligned.alignment == Alignment::MeanTwist)?;
    let mut errors = found.series.iter();
    // Every pose at a rest has a truth: a session's truth covers all of it.
    let by_rest = at.iter().map(|posed| {
        posed.as_ref()?;
        Some(errors.next()?.1.attitude_rad.norm().to_degrees())
    });
    Some((by_rest.collect(), 1e3 * aligned.pose.position_rms_m))
}

fn sample(posed: &Posed) -> EstimateSample {
    EstimateSample {
        t: posed.t,
        t_rig_target: posed.t_rig_target,
        velocity_mps: Vector3::zeros(),
        angular_velocity_rps: Vector3::zeros(),
        covariance: None,
        nis: None,
        momentum: None,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use tumbled_core::evaluate::TruthSample;
    use tumbled_model::RigNs;

    use super::*;

    const S: i64 = 1_000_000_000;

    fn turned(degrees: f64, tilt_deg: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * degrees.to_radians());
        let tilt = UnitQuaternion::from_scaled_axis(Vector3::x() * tilt_deg.to_radians());
        Isometry3::from_parts(Vector3::new(2.0, 0.0, 0.0).into(), tilt * turn)
    }

    /// Rests of a second at 0, 22.5, 45 and 67.5°.
    fn rests() -> Vec<Rest> {
        (0..4).map(|n| Rest { from: RigNs(2 * n * S), until: RigNs((2 * n + 1) * S) }).collect()
    }

    fn poses(tilt: &[f64; 4]) -> Vec<Posed> {
        let pose = |(n, tilt): (usize, &f64)| Posed {
            t: RigNs(2 * n as i64 * S + S / 2),
            t_rig_target: turned(22.5 * n as f64, *tilt),
            rate_rps: Some(0.0),
        };
        tilt.iter().enumerate().map(pose).collect()
    }

    #[test]
    fn errors_are_those_of_the_rests_and_axes_those_of_the_steps() {
        let sample = |half: i64| TruthSample {
            t: RigNs(half * S / 2),
            t_rig_target: turned(22.5 * (half / 4) as f64, 0.0),
            angular_velocity_rps: Vector3::zeros(),
        };
        let truth = Trajectory::new((0..=15).map(sample).collect()).expect("in order");
        let attitudes: Vec<_> = (0..4).map(|n| turned(22.5 * f64::from(n), 0.0).rotation).collect();
        let right =
            row("s", Some("z"), PoseMethod::Fused, (&rests(), &poses(&[0.0; 4])), Known::Truth(&truth, &attitudes));
        assert_eq!((right.rests, right.posed), (4, 4));
        assert!(right.attitude_deg.expect("some").max < 1e-6 && right.axis_deg.expect("one") < 1e-6);
        assert!((right.at[1].step_deg.expect("a step") - 22.5).abs() < 1e-9 && right.at[0].step_deg.is_none());
        // Tilts of ±1° about x, at angles of 0, 22.5, 45, 67.5°: their body twists keep a mean, so that less than 1° is left.
        let tilted = poses(&[1.0, -1.0, 1.0, -1.0]);
        let off = row("s", None, PoseMethod::Kinect, (&rests(), &tilted), Known::Truth(&truth, &attitudes));
        assert!((0.8..1.0).contains(&off.attitude_deg.expect("some").rms), "{off:?}");
        // A step from +1° to −1° about x and 22.5° about z: atan(2 / 22.5) = 5.1° off the axis.
        assert!((off.at[1].step_axis_deg.expect("one") - 5.1).abs() < 0.2, "{off:?}");
    }

    #[test]
    fn without_a_truth_steps_are_held_against_the_encoder_and_their_own_axis() {
        let angles: Vec<f64> = (0..4).map(|n| -(22.4 * f64::from(n)).to_radians()).collect();
        let mut poses = poses(&[0.0; 4]);
        poses.remove(1);
        let found = row("r", None, PoseMethod::Lidar, (&rests(), &poses), Known::Encoder(&angles));
        assert_eq!((found.posed, found.attitude_deg, found.axis_deg), (3, None, None));
        // The one step with both ends is from rest 2 to 3: 22.5° against the encoder's 22.4°.
        let step = found.step_deg.expect("a step");
        assert!((step.rms - 0.1).abs() < 1e-9 && found.at[2].step_deg.is_none());
        assert!(found.step_axis_deg.expect("an axis").max < 1e-6);
    }
}
