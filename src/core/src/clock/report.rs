//! What the mapper says about itself.

use super::kind::DeviceClockKind;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, Span};
use tumbled_velodyne::position::Pps;

/// How device stamps become times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClockMode {
    /// The lower convex hull of the arrivals: free of jitter and queueing.
    #[default]
    Hull,
    /// The newest packet's arrival: every delay is an error of time. For comparison, and for broken device clocks.
    Arrival,
    /// A filter of the mean delay: smooth, but late by that mean. For comparison.
    Kalman,
}

/// How far the mapping may be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClockState {
    /// Less than 2 s of data: the offset is the least delayed arrival's, the rate the last known or nominal.
    Acquiring,
    /// Offset and rate follow the data.
    Locked,
    /// Nothing usable for more than 1 s, or for less than 0.5 s again: the last line is extrapolated.
    Holdover,
    /// Nothing usable for more than 5 s, or nothing yet: the next stamp begins anew.
    Lost,
    /// The data ask for a skew beyond 500 ppm: the last believable line is kept.
    Suspect,
}

impl ClockState {
    /// The word in health and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Acquiring => "acquiring",
            Self::Locked => "locked",
            Self::Holdover => "holdover",
            Self::Lost => "lost",
            Self::Suspect => "suspect",
        }
    }
}

/// What became of a pushed stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// Later than all before; used.
    InOrder,
    /// The first of an epoch: of the first at all, after a reset, or after a silence.
    NewEpoch,
    /// Up to 1 s earlier than the newest: overtaken on the way. It can be mapped; the clock does not learn from it.
    Reordered,
    /// The newest stamp again.
    Duplicate,
    /// It does not fit the clock, which is kept until three in a row agree: it has no time, leave its data out.
    Doubtful,
}

/// A time on the rig's timeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mapped {
    /// The device's stamp as a time, the least delay included.
    pub t: RigNs,
    /// One standard deviation of `t`, the unknown least delay excluded.
    pub sigma: Span,
    /// How far to trust both.
    pub state: ClockState,
}

/// Epochs begun, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResetCounts {
    /// The device's counter was set, restarted or stood still.
    pub device: u64,
    /// Silences of more than 5 s.
    pub gap: u64,
    /// Changes of the sensor's pulse state.
    pub pps: u64,
    /// Times the host's receive stamps were anchored anew.
    pub reanchor: u64,
}

impl ResetCounts {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.device + self.gap + self.pps + self.reanchor
    }
}

/// Everything counted since the clock was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockCounts {
    /// Stamps pushed.
    pub pushed: u64,
    /// Stamps equal to the newest.
    pub duplicates: u64,
    /// Stamps less than 1 s behind the newest.
    pub reordered: u64,
    /// Stamps that did not fit the clock.
    pub doubtful: u64,
    /// Stamps at or past 3.6e9 µs: the sensor's clock was never set.
    pub raw_over_hour: u64,
    /// Changes of the line beyond 5 ms, taken at once.
    pub steps: u64,
    /// Times that had to wait for an earlier, later-lying one (after a step back).
    pub held: u64,
    /// Epochs begun after the first.
    pub resets: ResetCounts,
}

/// A clock's state, for health and for people.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockReport {
    /// Whose clock.
    pub kind: DeviceClockKind,
    /// How it is mapped.
    pub mode: ClockMode,
    /// How far to trust it.
    pub state: ClockState,
    /// Rig time minus the device's time at the newest stamp; the device's time counts wraps from the epoch's first stamp.
    pub offset: Span,
    /// How much slower than the host the device's clock runs, ppm; negative = faster.
    pub skew_ppm: f64,
    /// One standard deviation of mapped times, the unknown least delay excluded.
    pub sigma: Span,
    /// Device time that the estimate rests on.
    pub window: Span,
    /// Pairs that it rests on, after decimation.
    pub pairs: u64,
    /// Since the newest usable stamp arrived; `None` before the first.
    pub age: Option<Span>,
    /// The sensor's pulse state, where it has one and has told.
    pub pps: Option<Pps>,
    /// What was counted.
    pub counts: ClockCounts,
}
