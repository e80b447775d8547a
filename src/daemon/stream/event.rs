//! EVENT: something that happened once.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, SensorId, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// How grave an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EventLevel {
    /// Good to know.
    Info,
    /// Something is worse than it should be.
    Warn,
    /// Data were lost or cannot be trusted.
    Error,
}

/// Something that happened once, e.g. a sensor that was lost, a clock that was reset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: EVENT")]
pub struct EventLine {
    /// EVENT.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// When, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// Whose event; none: the rig's.
    pub sensor: Option<String>,
    /// A word for programs, e.g. `clock_reset`.
    pub kind: String,
    /// How grave it is.
    pub level: EventLevel,
    /// A sentence for people.
    pub message: String,
}

impl EventLine {
    /// Of something that happened at `t`, wall time `unix`, to `sensor` or to the rig.
    pub fn new(
        origin: StreamOrigin,
        (t, unix): (RigNs, UnixNs),
        sensor: Option<&SensorId>,
        kind: &str,
        level: EventLevel,
        message: impl Into<String>,
    ) -> Self {
        Self {
            class: Class::Event,
            origin,
            t_ns: t.0,
            unix_ns: unix.0.to_string(),
            sensor: sensor.map(ToString::to_string),
            kind: kind.to_owned(),
            level,
            message: message.into(),
        }
    }
}
