//! What happened that a person may want to know of: the stream's EVENT lines and the log.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, SensorId};

/// How much attention it asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Gravity {
    /// As it should be.
    Info,
    /// Measurements go on, with less.
    Warn,
    /// Measurements are missing or wrong.
    Error,
}

/// What kind of thing happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum NoticeKind {
    /// A sensor's state changed.
    SensorState,
    /// A device's clock began anew.
    ClockReset,
    /// The host's wall clock was set.
    WallStep,
    /// The sensor's model or return mode became known, or changed.
    Model,
    /// Data that could not be read.
    Malformed,
    /// Data of a sensor that the config does not have.
    UnknownSensor,
    /// An operator's marker.
    Marker,
    /// The empty room is learned, or forgotten.
    Background,
    /// The target was forgotten on an operator's order.
    Reset,
    /// The config was changed.
    Configured,
    /// A turntable's angle is no truth any more, or is again.
    Truth,
    /// A live session sheds scans: it cannot keep up.
    Shedding,
}

impl NoticeKind {
    /// The word in events and logs.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SensorState => "sensor_state",
            Self::ClockReset => "clock_reset",
            Self::WallStep => "wall_step",
            Self::Model => "model",
            Self::Malformed => "malformed",
            Self::UnknownSensor => "unknown_sensor",
            Self::Marker => "marker",
            Self::Background => "background",
            Self::Reset => "reset",
            Self::Configured => "configured",
            Self::Truth => "truth",
            Self::Shedding => "shedding",
        }
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// When the host learned of it.
    pub t: RigNs,
    /// Whose it is; `None`: the session's.
    pub sensor: Option<SensorId>,
    /// How much attention it asks for.
    pub gravity: Gravity,
    /// What kind it is.
    pub kind: NoticeKind,
    /// A sentence for people.
    pub message: String,
}

/// At most so many wait for their time: a flood of them is cut, not kept.
const WAITING: usize = 256;

/// Notices that wait until every sensor's events of their time are in, so that their order rests on time alone.
#[derive(Clone, Debug, Default)]
pub(crate) struct Waiting {
    notices: Vec<(usize, Notice)>,
}

impl Waiting {
    /// Takes a notice of a source; sources are told apart by their number, for ties.
    pub(crate) fn push(&mut self, source: usize, notice: Notice) {
        if self.notices.len() < WAITING {
            self.notices.push((source, notice));
        }
    }

    /// Moves those from before `t` out, in the order of time and source.
    pub(crate) fn release(&mut self, t: RigNs, out: &mut Vec<Notice>) {
        // Stable: of one source and time, in the order they came.
        self.notices.sort_by_key(|(source, notice)| (notice.t, *source));
        let due = self.notices.partition_point(|(_, notice)| notice.t < t);
        out.extend(self.notices.drain(..due).map(|(_, notice)| notice));
    }
}
