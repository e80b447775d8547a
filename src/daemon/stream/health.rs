//! HEALTH: how sensors, clocks, queues and recorder are doing.
//!
//! It has three parts. `core` follows from the ledger alone and is the same on replay; `estimate` tells how well the target
//! is known; `shell` holds the facts of this moment on this machine.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::EstimateHealth;
use tumbled_core::health::{CoreHealth, Level, Reason};
use tumbled_model::{RigNs, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;
use super::hub::ClientTotals;
use crate::session::run_info::RunInfo;
use crate::simulation::live::shortfall::ShortfallReport;

/// Health, once a second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: HEALTH")]
pub struct HealthLine {
    /// HEALTH.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// When the shell's facts were read, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// The worse of the core's level and the shell's.
    pub level: Level,
    /// What follows from the ledger: sensors, losses, clocks. The same on replay.
    pub core: CoreHealth,
    /// The estimation as of the newest epoch; null: no epoch yet.
    #[serde(default)]
    pub estimate: Option<EstimateHealth>,
    /// What is so now, on this machine.
    pub shell: ShellHealth,
}

impl HealthLine {
    /// Its parts at `t`, wall time `unix`.
    pub fn new(
        origin: StreamOrigin,
        (t, unix): (RigNs, UnixNs),
        core: CoreHealth,
        estimate: Option<EstimateHealth>,
        shell: ShellHealth,
    ) -> Self {
        Self {
            class: Class::Health,
            origin,
            t_ns: t.0,
            unix_ns: unix.0.to_string(),
            level: core.level.max(shell.level()),
            core,
            estimate,
            shell,
        }
    }

    /// The same with the shell's facts of now, while the session's timeline stands still.
    pub fn renew(&mut self, shell: ShellHealth) {
        self.level = self.core.level.max(shell.level());
        self.shell = shell;
    }
}

/// The part of health that is not replayed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShellHealth {
    /// What is not as it should be on this machine, and what to do about it, a sentence each.
    pub reasons: Vec<Reason>,
    /// Since the session's start, s.
    pub uptime_s: f64,
    /// Memory of the process that is in RAM, bytes; null where the system does not say.
    pub memory_bytes: Option<u64>,
    /// The sources of the config's devices, in the config's order; empty where nothing is read from devices.
    #[serde(default)]
    pub sources: Vec<SourceHealth>,
    /// The queues between the threads, in the order the data pass them.
    pub queues: Vec<QueueHealth>,
    /// Scans shed since the start because the core was behind. They are recorded all the same.
    pub shed_scans: u64,
    /// What people say of the run; null: nothing.
    #[serde(default)]
    pub run: Option<RunInfo>,
    /// What of the past is kept in memory for a snapshot, bytes.
    #[serde(default)]
    pub pretrigger_bytes: u64,
    /// The recorder; null when nothing is recorded.
    pub recorder: Option<RecorderHealth>,
    /// The scene whose sensors are simulated; null: nothing is simulated in real time.
    #[serde(default)]
    pub simulation: Option<SimulationHealth>,
    /// Clients of the state stream.
    pub stream: StreamHealth,
    /// How often the service manager's watchdog was fed; 0: there is none.
    #[serde(default)]
    pub watchdog_feeds: u64,
    /// How long the steps of the work take, over the last minute.
    pub steps: Vec<StepHealth>,
}

impl ShellHealth {
    /// The worst of its reasons.
    pub fn level(&self) -> Level {
        self.reasons.iter().map(|reason| reason.level).max().unwrap_or_default()
    }
}

/// What reads a device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SourceHealth {
    /// Whose device.
    pub sensor: String,
    /// How often it was opened since the start.
    pub opened: u64,
    /// Why it delivers nothing, and what to do; null: it is open, or being opened for the first time.
    pub cause: Option<String>,
}

/// A queue between two threads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct QueueHealth {
    /// What it leads from and to, e.g. `front -> ledger`.
    pub name: String,
    /// What waiting and bound count.
    pub unit: QueueUnit,
    /// How much waits.
    pub waiting: u64,
    /// How much may wait.
    pub bound: u64,
    /// Lost since the start because it was full.
    pub lost: u64,
}

/// What a queue's bound counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum QueueUnit {
    /// Packets, frames or chunks.
    Items,
    /// Bytes.
    Bytes,
}

/// What a recorder is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RecorderStatus {
    /// It writes.
    Recording,
    /// It stopped: the disk has less than the limit left.
    StoppedDisk,
    /// It stopped: an error, which is among the reasons.
    StoppedError,
}

/// The recorder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RecorderHealth {
    /// What it is doing.
    pub state: RecorderStatus,
    /// The part it writes.
    pub file: String,
    /// Bytes written, all parts together.
    pub bytes: u64,
    /// Events dropped from the recording because it was behind.
    pub dropped: u64,
    /// Since the last time everything written was safe on the disk, s.
    pub synced_s: Option<f64>,
    /// Free on its disk, bytes.
    pub disk_free_bytes: Option<u64>,
}

/// A scene in real time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimulationHealth {
    /// Its name.
    pub scene: String,
    /// What was left out since the start because this machine was too slow.
    pub left_out: ShortfallReport,
}

/// Clients of the state stream, counted since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StreamHealth {
    /// Connected now.
    pub clients: u64,
    /// Connected since the start.
    pub accepted: u64,
    /// Refused because there were too many.
    pub refused: u64,
    /// Cut off because they did not read.
    pub cut_off: u64,
    /// Lines dropped because a client was behind.
    pub dropped: u64,
    /// Bytes that wait for clients.
    pub queued_bytes: u64,
}

impl From<ClientTotals> for StreamHealth {
    fn from(totals: ClientTotals) -> Self {
        Self {
            clients: totals.clients as u64,
            accepted: totals.accepted,
            refused: totals.refused,
            cut_off: totals.cut_off,
            dropped: totals.dropped,
            queued_bytes: totals.queued_bytes as u64,
        }
    }
}

/// How long a step takes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StepHealth {
    /// The step.
    pub name: String,
    /// Half of the runs take less, ms.
    pub p50_ms: f64,
    /// All but one in a hundred take less, ms.
    pub p99_ms: f64,
    /// The longest, ms.
    pub max_ms: f64,
}
