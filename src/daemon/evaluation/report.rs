//! What an evaluation found.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::{Mode, StateReason};

use super::figures::{MeanSquare, TruthFigures, TurntableFigures};
use super::gather::{Gathered, MODES};
use crate::experiment::bounds::Share;
use crate::limits::LimitCheck;
use crate::stream::StreamOrigin;

/// The states of a session held against the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled evaluate --json")]
pub struct EvaluateReport {
    /// The program's version and commit.
    pub program: String,
    /// The inputs.
    pub inputs: Vec<String>,
    /// `replay` or `simulated`.
    pub origin: StreamOrigin,
    /// One hash over everything that came out, as `tumbled replay --digest` prints it.
    pub digest: String,
    /// The truth.
    pub truth: TruthSource,
    /// Rig time that was played, s.
    pub duration_s: f64,
    /// Epochs in all.
    pub epochs: u64,
    /// How many of them in each mode.
    pub modes: Vec<ModeShare>,
    /// How many with each reason, the most frequent first.
    pub reasons: Vec<ReasonCount>,
    /// Session time of the first state of mode `tracking` that is not `invalid`, s; null: there is none.
    pub first_tracking_s: Option<f64>,
    /// What was scored; null: nothing, and `unscored` says why.
    pub scored: Option<Scored>,
    /// Why nothing was scored. The exit code is then 3.
    pub unscored: Option<String>,
    /// The limits that were asked for; where one is not kept, the exit code is 3.
    #[serde(default)]
    pub limits: Vec<LimitCheck>,
    /// Nothing of the inputs was missing, nothing stopped the run, and something was scored. Otherwise the exit code is 3.
    pub complete: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Where the truth comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TruthSource {
    /// The file, or `turntable ID`.
    pub name: String,
    /// By which times it is laid on the session.
    pub clock: TruthClock,
    /// Samples used.
    pub samples: u64,
    /// Samples that were no truth: a stage that reports a fault, or has no encoder.
    pub left_out: u64,
}

/// By which times a truth is laid on the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TruthClock {
    /// `unix_ns`: wall time.
    Wall,
    /// `t_ns`: the session's, or the ledger's own.
    Session,
}

/// Epochs of a mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModeShare {
    /// The mode.
    pub mode: Mode,
    /// Epochs.
    pub epochs: u64,
    /// Their share of all.
    pub share: f64,
}

/// Epochs with a reason.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReasonCount {
    /// The reason.
    pub reason: StateReason,
    /// Epochs.
    pub epochs: u64,
}

/// What was scored, and what came out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scored {
    /// Session time of the first state scored, s.
    pub from_s: f64,
    /// Of the last, s.
    pub to_s: f64,
    /// How far the target turned between them, degrees.
    pub travel_deg: f64,
    /// States scored: mode `tracking`, not `invalid`, in the interval, with truth at their time.
    pub states: u64,
    /// Tracked states not scored.
    pub left_out: u64,
    /// States of mode `tracking` and validity `ok` with an attitude error above 10°, the time before the interval included.
    pub wrong: Share,
    /// Mean of the innovations' normalised squares; null: there are none.
    pub nis: Option<MeanSquare>,
    /// Against full poses; null: the truth is a turntable.
    pub pose: Option<TruthFigures>,
    /// Against a turntable's encoder; null: the truth is a file.
    pub turntable: Option<TurntableFigures>,
}

impl Scored {
    /// What limits are held against.
    pub fn against_limits(&self) -> [(&'static str, Option<f64>); 4] {
        let pose = self.pose.as_ref();
        let gauge_free = pose.and_then(|figures| figures.pose.first());
        let turntable = self.turntable.as_ref();
        let rate = pose.map(|figures| figures.rate_dps).or(turntable.map(|figures| figures.rate_dps));
        let axis = pose.and_then(|figures| figures.axis_deg).or(turntable.map(|figures| figures.cone_deg));
        let about = turntable.map(|figures| figures.about_axis_deg.rms);
        [
            ("rate_rms_dps", rate.map(|errors| errors.rms)),
            ("axis_rms_deg", axis.map(|errors| errors.rms)),
            ("attitude_rms_deg", gauge_free.map(|figures| figures.attitude_rms_deg).or(about)),
            ("position_rms_mm", gauge_free.map(|figures| figures.position_rms_mm)),
        ]
    }
}

/// Epochs by mode, and by reason.
pub fn counts(gathered: &Gathered) -> (u64, Vec<ModeShare>, Vec<ReasonCount>) {
    let all: u64 = gathered.modes.iter().sum();
    let modes = MODES.into_iter().zip(gathered.modes);
    let modes = modes.map(|(mode, epochs)| ModeShare { mode, epochs, share: epochs as f64 / all.max(1) as f64 });
    let reasons = gathered.reasons.iter().map(|(reason, epochs)| ReasonCount { reason: *reason, epochs: *epochs });
    let mut reasons: Vec<ReasonCount> = reasons.collect();
    reasons.sort_by_key(|count| std::cmp::Reverse(count.epochs));
    (all, modes.collect(), reasons)
}
