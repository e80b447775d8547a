//! SIGMA: where the uncertainty of an epoch's pose comes from.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::SigmaReport;
use tumbled_model::{RigNs, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// The pose's standard deviations by source, after an epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: SIGMA")]
pub struct SigmaLine {
    /// SIGMA.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The epoch it follows.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// As in HEALTH; null: nothing is tracked, or the filter does not tell the sources apart.
    pub sigma_by_source: Option<SigmaReport>,
}

impl SigmaLine {
    /// Of an epoch at `t`, wall time `unix`.
    pub fn new(origin: StreamOrigin, epoch: u64, (t, unix): (RigNs, UnixNs), sigma: Option<SigmaReport>) -> Self {
        Self { class: Class::Sigma, origin, epoch, t_ns: t.0, unix_ns: unix.0.to_string(), sigma_by_source: sigma }
    }
}
