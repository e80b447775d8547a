//! The core's evaluation as figures in the units that people use: degrees, millimetres.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::evaluate::{
    Aligned, Alignment, Consistency, Evaluation, NormalisedMean, ScalarErrors, TurntableEvaluation,
};

/// A number's errors, estimate less truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Errors {
    /// Mean.
    pub mean: f64,
    /// Root mean square.
    pub rms: f64,
    /// The largest without its sign.
    pub max: f64,
    /// Of the last state scored.
    pub end: f64,
}

/// How the target frame of the states was laid on that of the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AlignedBy {
    /// The mean error of all scored states is removed: the target frame is the estimate's own choice.
    MeanTwist,
    /// That of the first second of tracking: what has drifted since is an error.
    FirstSecond,
    /// A known transform.
    Given,
}

impl AlignedBy {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::MeanTwist => "gauge-free",
            Self::FirstSecond => "aligned in the first second",
            Self::Given => "aligned as given",
        }
    }
}

/// Errors of poses under one alignment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseFigures {
    /// How the frames were aligned.
    pub alignment: AlignedBy,
    /// Attitude, the whole angle, r.m.s., degrees.
    pub attitude_rms_deg: f64,
    /// The largest, degrees.
    pub attitude_max_deg: f64,
    /// The part about the true spin axis, r.m.s., degrees.
    pub about_axis_rms_deg: f64,
    /// The part across it, r.m.s., degrees.
    pub across_axis_rms_deg: f64,
    /// Position of the origin about its mean offset, r.m.s. of the whole length, mm.
    pub position_rms_mm: f64,
    /// That mean offset, estimate less truth, rig axes, mm.
    pub position_offset_mm: [f64; 3],
    /// Velocity of the origin, r.m.s. of the whole length, mm/s.
    pub velocity_rms_mmps: f64,
    /// Whether errors are as large as stated; null: no covariance.
    pub consistency: Option<ConsistencyFigures>,
}

/// How errors compare with their covariances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConsistencyFigures {
    /// Of pose, velocity and angular velocity: 12 if the covariances are right.
    pub nees12: MeanSquare,
    /// Of the pose alone: 6 if they are right.
    pub nees6: MeanSquare,
    /// Stated standard deviation over r.m.s. error, 1 if it is right.
    pub sigma_over_rms: SigmaOverRms,
    /// States whose covariance was none; they are left out.
    pub not_positive: u64,
}

/// Mean of normalised squares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeanSquare {
    /// The mean.
    pub mean: f64,
    /// What it is if all is as stated.
    pub expected: u32,
    /// Where it lies in 95 of 100 cases if all is as stated: lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// How many values.
    pub count: u64,
}

/// By axis; null: there was no error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SigmaOverRms {
    /// Rotation, target axes.
    pub rotation: [Option<f64>; 3],
    /// Translation, target axes.
    pub translation: [Option<f64>; 3],
    /// Velocity, rig axes.
    pub velocity: [Option<f64>; 3],
    /// Angular velocity, rig axes.
    pub angular_velocity: [Option<f64>; 3],
}

/// Errors against full poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TruthFigures {
    /// By alignment.
    pub pose: Vec<PoseFigures>,
    /// Angle between estimated and true spin axis, degrees; null: the target is at rest.
    pub axis_deg: Option<Errors>,
    /// Of the rate, degrees a second.
    pub rate_dps: Errors,
}

/// Errors against a turntable's encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurntableFigures {
    /// The axis that all the estimated turning was about, rig axes, of length 1.
    pub axis: [f64; 3],
    /// Angle turned about it less the encoder's and the mean of that, degrees.
    pub about_axis_deg: Errors,
    /// How far the attitude tilts off it, r.m.s., degrees: a true turntable has none.
    pub tilt_rms_deg: f64,
    /// Angle between each state's spin axis and it, degrees.
    pub cone_deg: Errors,
    /// Of the rate, degrees a second.
    pub rate_dps: Errors,
}

impl Errors {
    /// In degrees, of radians.
    fn degrees(errors: &ScalarErrors) -> Self {
        let ScalarErrors { mean, rms, max, end } = *errors;
        Self { mean: mean.to_degrees(), rms: rms.to_degrees(), max: max.to_degrees(), end: end.to_degrees() }
    }
}

impl MeanSquare {
    /// Of this many degrees of freedom.
    pub fn of(found: &NormalisedMean, expected: u32) -> Self {
        let (low, high) = found.bounds;
        Self { mean: found.mean, expected, low, high, count: found.count.into() }
    }
}

impl TruthFigures {
    /// `turns`: whether the target does; at rest it has no axis.
    pub fn of(evaluation: &Evaluation, turns: bool) -> Self {
        Self {
            pose: evaluation.aligned.iter().map(pose).collect(),
            axis_deg: turns.then(|| Errors::degrees(&evaluation.motion.axis_rad)),
            rate_dps: Errors::degrees(&evaluation.motion.rate_rps),
        }
    }
}

impl TurntableFigures {
    /// Of the core's.
    pub fn of(evaluation: &TurntableEvaluation) -> Self {
        Self {
            axis: evaluation.axis.into(),
            about_axis_deg: Errors::degrees(&evaluation.about_axis_rad),
            tilt_rms_deg: evaluation.tilt_rms_rad.to_degrees(),
            cone_deg: Errors::degrees(&evaluation.cone_rad),
            rate_dps: Errors::degrees(&evaluation.rate_rps),
        }
    }
}

fn pose(aligned: &Aligned) -> PoseFigures {
    let pose = &aligned.pose;
    PoseFigures {
        alignment: match aligned.alignment {
            Alignment::MeanTwist => AlignedBy::MeanTwist,
            Alignment::FirstSecond => AlignedBy::FirstSecond,
            Alignment::Given => AlignedBy::Given,
        },
        attitude_rms_deg: pose.attitude_rms_rad.to_degrees(),
        attitude_max_deg: pose.attitude_max_rad.to_degrees(),
        about_axis_rms_deg: pose.about_axis_rms_rad.to_degrees(),
        across_axis_rms_deg: pose.across_axis_rms_rad.to_degrees(),
        position_rms_mm: 1e3 * pose.position_rms_m,
        position_offset_mm: Vector3::into(pose.position_offset_m * 1e3),
        velocity_rms_mmps: 1e3 * pose.velocity_rms_mps,
        consistency: aligned.consistency.as_ref().map(consistency),
    }
}

fn consistency(found: &Consistency) -> ConsistencyFigures {
    let ratios = found.sigma_over_rms;
    let three = |from: usize| std::array::from_fn(|n| Some(ratios[from + n]).filter(|ratio| ratio.is_finite()));
    ConsistencyFigures {
        nees12: MeanSquare::of(&found.nees12, 12),
        nees6: MeanSquare::of(&found.nees6, 6),
        sigma_over_rms: SigmaOverRms {
            rotation: three(0),
            translation: three(3),
            velocity: three(6),
            angular_velocity: three(9),
        },
        not_positive: found.not_positive.into(),
    }
}
