//! What a turntable says of itself, and what its angle is worth.

use super::TurntableErrors;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What only a turntable has.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurntableHealth {
    /// Who it says it is; null: it has not said.
    pub device: Option<String>,
    /// Counts of a full turn, by the config or the device; null: neither says, and there is no angle.
    pub counts_per_turn: Option<u32>,
    /// Angles measured so far.
    pub samples: u64,
    /// Of them in the last second.
    pub samples_hz: f64,
    /// The newest angle, degrees, not wrapped.
    pub angle_deg: Option<f64>,
    /// One standard deviation of it.
    pub sigma_deg: Option<f64>,
    /// How fast it turned, degrees a second.
    pub rate_dps: Option<f64>,
    /// How far the newest angle's time may be off, ns; null: it is by the device's clock.
    pub half_rtt_ns: Option<i64>,
    /// The stage says that it moves.
    pub moving: Option<bool>,
    /// Its counts are referred to its zero; null: it does not say.
    pub referenced: Option<bool>,
    /// Readable replies that were not used, by reason.
    pub refused: BTreeMap<String, u64>,
    /// What the angle is worth.
    pub truth: TruthState,
    /// From when on it is invalid, ns: the last instant at which nothing was wrong yet; null: it is not.
    pub invalid_since_ns: Option<i64>,
    /// Why it is invalid; null: it is not.
    pub invalid_because: Option<String>,
    /// The estimate's errors against the encoder; null: nothing to compare in the last ten seconds, or too little was turned.
    #[serde(default)]
    pub errors: Option<TurntableErrors>,
}

/// What a turntable's angle is worth as truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TruthState {
    /// There was no angle yet.
    #[default]
    Unknown,
    /// Measured by the encoder, and the stage reports nothing wrong.
    Valid,
    /// It was measured, and nothing comes any more.
    Stale,
    /// The stage reports a fault, it slipped, or it has no encoder.
    Invalid,
}
