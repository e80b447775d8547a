//! The facts of this moment on this machine: the part of health that is not replayed.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tumbled_core::health::{Level, Reason};
use tumbled_io::live::outlet::{CORE_QUEUE_BYTES, RECORDER_QUEUE_BYTES};
use tumbled_io::live::{LedgerHandle, OutletGauge};
use tumbled_io::recording::thread::RecorderStatus as Status;
use tumbled_io::recording::{FileSystem, RecorderState, StopReason, Storage};
use tumbled_model::RigNs;

use super::sources::{RunningSource, RunningSources};
use crate::simulation::live::shortfall::ShortfallReport;
use crate::stream::{
    QueueHealth, QueueUnit, RecorderHealth, RecorderStatus, ShellHealth, SimulationHealth, SourceHealth,
};

/// The newest facts: the main thread looks, the core's thread tells. Clones share them.
#[derive(Clone, Debug, Default)]
pub(super) struct Facts(Arc<Mutex<ShellHealth>>);

impl Facts {
    pub(super) fn set(&self, health: ShellHealth) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = health;
    }

    pub(super) fn get(&self) -> ShellHealth {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Reads them.
pub(super) fn look(
    (uptime, now): (Duration, RigNs),
    ledger: &LedgerHandle,
    sources: &RunningSources,
    recorder: Option<Status>,
) -> ShellHealth {
    let names: &[(&str, usize)] = match &recorder {
        Some(_) => &[("ledger -> recorder", RECORDER_QUEUE_BYTES), ("ledger -> core", CORE_QUEUE_BYTES)],
        None => &[("ledger -> core", CORE_QUEUE_BYTES)],
    };
    // Both in the order of the config.
    let queues = ledger.queues().into_iter().zip(sources.sources()).map(|(queue, source)| QueueHealth {
        name: format!("{} -> ledger", queue.sensor),
        unit: QueueUnit::Items,
        waiting: queue.waiting as u64,
        bound: queue.bound as u64,
        lost: source.lost_in_queue(),
    });
    let outlets = ledger.outlets().iter().zip(names).map(|(gauge, (name, bound))| outlet(gauge, name, *bound));
    let pretrigger_bytes = recorder.as_ref().map_or(0, |status| status.ring_bytes);
    let recorder = recorder.and_then(|status| Some((recorder_health(&status, status.path.as_deref()?), status)));
    let mut reasons = recorder.as_ref().map(|(_, status)| reasons(status)).unwrap_or_default();
    let scene = sources.scene().map(|scene| {
        let left_out = scene.shortfall().report();
        if scene.shortfall().is_recent(now) {
            reasons.push(too_slow(&left_out));
        }
        SimulationHealth { scene: scene.name().to_owned(), left_out }
    });
    let sources: Vec<SourceHealth> = sources.sources().iter().filter_map(RunningSource::health).collect();
    reasons.extend(sources.iter().filter_map(without_data));
    ShellHealth {
        reasons,
        sources,
        uptime_s: uptime.as_secs_f64(),
        memory_bytes: memory_bytes(),
        queues: queues.chain(outlets).collect(),
        shed_scans: ledger.shed_scans(),
        pretrigger_bytes,
        recorder: recorder.map(|(health, _)| health),
        simulation: scene,
        ..ShellHealth::default()
    }
}

fn outlet(gauge: &OutletGauge, name: &str, bound: usize) -> QueueHealth {
    let counts = gauge.counts();
    QueueHealth {
        name: name.to_owned(),
        unit: QueueUnit::Bytes,
        waiting: counts.waiting_bytes,
        bound: bound as u64,
        lost: counts.lost + counts.lost_notes,
    }
}

fn recorder_health(status: &Status, path: &Path) -> RecorderHealth {
    RecorderHealth {
        state: match &status.state {
            RecorderState::Recording => RecorderStatus::Recording,
            RecorderState::Stopped { reason: StopReason::LowSpace { .. } } => RecorderStatus::StoppedDisk,
            RecorderState::Stopped { .. } => RecorderStatus::StoppedError,
        },
        file: path.display().to_string(),
        bytes: status.file_bytes,
        dropped: status.dropped,
        synced_s: status.synced.map(|synced| synced.elapsed().as_secs_f64()),
        disk_free_bytes: FileSystem.free_bytes(path).ok(),
    }
}

fn reasons(status: &Status) -> Vec<Reason> {
    let reason =
        |key: &str, message: String| Reason { level: Level::Degraded, sensor: None, key: key.to_owned(), message };
    let mut reasons = Vec::new();
    if let RecorderState::Stopped { reason: why } = &status.state {
        reasons.push(reason("recording_stopped", format!("the recording stopped, measuring goes on: {why}")));
    }
    if status.dropped > 0 {
        let message =
            format!("the recording is incomplete: {} events were dropped because the disk is too slow", status.dropped);
        reasons.push(reason("recording_incomplete", message));
    }
    reasons
}

/// The core says what a sensor lacks; why, only its source knows.
fn without_data(source: &SourceHealth) -> Option<Reason> {
    let (sensor, message) = (Some(source.sensor.clone()), source.cause.clone()?);
    Some(Reason { level: Level::Degraded, sensor, key: "source".to_owned(), message })
}

fn too_slow(left_out: &ShortfallReport) -> Reason {
    let ShortfallReport { left_out_s, late, .. } = left_out;
    let message = format!(
        "this machine is too slow for the simulated sensors: {left_out_s:.1} s of the scene and {late} items were left \
         out since the start; end other programs, or simulate fewer sensors (`--set kinect=[]`)"
    );
    Reason { level: Level::Degraded, sensor: None, key: "simulation_behind".to_owned(), message }
}

/// Memory of this process that is in RAM.
fn memory_bytes() -> Option<u64> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: u64 = statm.split_whitespace().nth(1)?.parse().ok()?;
    // The page size of every machine this runs on.
    Some(pages * 4_096)
}
