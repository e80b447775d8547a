//! What the core says of the target after an epoch.

use crate::ukf::Estimate;
use nalgebra::{Isometry3, SMatrix, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, SensorId};

/// Covariance of a pose with its motion: θ, ρ (body twist of the pose: rad, m), δv, δω (rig axes: m/s, rad/s).
pub type MotionCovariance = SMatrix<f64, 12, 12>;

/// The target after one epoch.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetState {
    /// The epoch's number.
    pub epoch: u64,
    /// The epoch's time.
    pub t: RigNs,
    /// Whose epoch.
    pub sensor: SensorId,
    /// What is known.
    pub mode: Mode,
    /// How far it may be trusted.
    pub validity: Validity,
    /// Why it is not fully valid, or what a user should know besides.
    pub reasons: Vec<StateReason>,
    /// Where the target is and how it moves. `None`: nobody knows.
    pub motion: Option<TargetMotion>,
    /// The innovation's normalised square: six on the average if all is as assumed. `None`: nothing was measured.
    pub nis: Option<f64>,
    /// What the epoch gave.
    pub inputs: StateInputs,
    /// Other poses that explain what was seen.
    pub alternatives: u32,
}

/// A target's pose and motion.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetMotion {
    /// Target coordinates to rig coordinates.
    pub t_rig_target: Isometry3<f64>,
    /// Of the target frame's origin, rig axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Rig axes, rad/s.
    pub angular_velocity_rps: Vector3<f64>,
    /// See [`MotionCovariance`].
    pub covariance: MotionCovariance,
    /// The spin, where it is more than noise.
    pub spin: Option<SpinState>,
    /// Direction of the angular momentum, which a free tumble keeps: of length 1, rig axes. `None`: not known, or a motion
    /// about a fixed axis is assumed.
    pub momentum: Option<Vector3<f64>>,
}

impl From<Estimate> for TargetMotion {
    fn from(estimate: Estimate) -> Self {
        Self {
            t_rig_target: estimate.t_rig_target,
            velocity_mps: estimate.velocity_mps,
            angular_velocity_rps: estimate.t_rig_target.rotation * estimate.angular_velocity_rps,
            covariance: estimate.covariance,
            spin: estimate.spin.map(|spin| SpinState {
                axis: spin.axis_rig.into_inner(),
                rate_rps: spin.rate_rps,
                axis_sigma_rad: spin.axis_sigma_rad,
                rate_sigma_rps: spin.rate_sigma_rps,
            }),
            momentum: estimate.momentum.map(|momentum| momentum.axis_rig.into_inner()),
        }
    }
}

/// A spin that is more than noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpinState {
    /// The axis, of length 1, rig axes, right-handed.
    pub axis: Vector3<f64>,
    /// The rate, rad/s, above 0.
    pub rate_rps: f64,
    /// One standard deviation of the axis, across it, rad.
    pub axis_sigma_rad: f64,
    /// One standard deviation of the rate, rad/s.
    pub rate_sigma_rps: f64,
}

/// What an epoch gave to the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StateInputs {
    /// Whether the epoch is a Kinect's; else a LiDAR's.
    pub is_kinect: bool,
    /// Points of the target.
    pub points: u32,
    /// The share of the registered points that lie on the model.
    pub inliers: f64,
    /// Root mean square distance of these from it, m.
    pub rmse_m: f64,
}

/// How much is known of the target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Nothing stands where it is looked for.
    #[default]
    NoTarget,
    /// A target is seen; its motion is not known yet.
    Acquiring,
    /// Measured with this epoch.
    Tracking,
    /// Predicted: this epoch measured nothing.
    Predicted,
    /// It was tracked, and is looked for again.
    Lost,
}

impl Mode {
    /// The word in the state stream.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoTarget => "no_target",
            Self::Acquiring => "acquiring",
            Self::Tracking => "tracking",
            Self::Predicted => "predicted",
            Self::Lost => "lost",
        }
    }
}

/// How far a state may be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Validity {
    /// As its covariance says.
    Ok,
    /// Usable, with less than usual behind it: the reasons say what is missing.
    Degraded,
    /// Not to be used.
    #[default]
    Invalid,
}

/// Why a state is not fully valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StateReason {
    /// Nothing stands in the region of interest.
    NoPoints,
    /// Too few of the epoch's points belong to the target.
    FewPoints,
    /// The points lie badly on the model.
    PoorFit,
    /// The points leave a direction open: panels edge-on, a wall.
    Degenerate,
    /// The measurement is farther from the prediction than both explain.
    Rejected,
    /// The motion has just changed: something pushed the target, or its stage starts or stops.
    Manoeuvre,
    /// The empty room is being learned: nothing is looked for.
    Learning,
    /// The motion is not known yet.
    Settling,
    /// Only one sensor has measured in the last two seconds.
    OneSensor,
    /// Several things, or several poses, explain what was seen.
    Ambiguous,
    /// What is seen is not recognised as the target whose model is given.
    Unrecognised,
    /// Nothing was measured for longer than the prediction is good for.
    Stale,
    /// The sensors disagree by more than their mountings' uncertainty.
    Extrinsic,
}

impl StateReason {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::NoPoints,
        Self::FewPoints,
        Self::PoorFit,
        Self::Degenerate,
        Self::Rejected,
        Self::Manoeuvre,
        Self::Learning,
        Self::Settling,
        Self::OneSensor,
        Self::Ambiguous,
        Self::Unrecognised,
        Self::Stale,
        Self::Extrinsic,
    ];

    /// The word in the state stream.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoPoints => "no_points",
            Self::FewPoints => "few_points",
            Self::PoorFit => "poor_fit",
            Self::Degenerate => "degenerate",
            Self::Rejected => "rejected",
            Self::Manoeuvre => "manoeuvre",
            Self::Learning => "learning",
            Self::Settling => "settling",
            Self::OneSensor => "one_sensor",
            Self::Ambiguous => "ambiguous",
            Self::Unrecognised => "unrecognised",
            Self::Stale => "stale",
            Self::Extrinsic => "extrinsic",
        }
    }
}
