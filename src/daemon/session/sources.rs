//! The rig's live sources: opened before any of them runs, kept running, told to stop together.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::live::{
    Backoff, Device, Intake, Ledger, Notice, Opener, QueueBound, SessionClock, Source, SourceCounters, SourceInfo,
    StopToken, Supervised, UdpConfig, UdpOpener, supervise,
};

use crate::cli::Failure;
use crate::config::{Config, LidarConfig};

/// A source that is open and not running yet.
pub struct OpenedSource {
    opener: UdpOpener,
    source: Box<dyn Source>,
    intake: Intake,
}

/// A source that runs.
#[derive(Debug)]
pub struct RunningSource {
    sensor: String,
    counters: Arc<SourceCounters>,
    supervised: Supervised,
}

/// Opens every source of the config: a port that is taken is told at once, before anything runs.
///
/// # Errors
/// Exit code 2: two LiDARs on one port. 1: a port that cannot be had.
pub fn open(config: &Config, ledger: &mut Ledger, clock: &SessionClock) -> Result<Vec<OpenedSource>, Failure> {
    refuse_shared_ports(&config.lidars)?;
    let open = |lidar: &LidarConfig| {
        let intake = ledger.intake(lidar.id.clone(), QueueBound::LIDAR_PACKETS);
        let mut opener = UdpOpener::new(udp(lidar), clock.clone());
        let source = opener.open().map_err(Failure::failed)?;
        Ok(OpenedSource { opener, source, intake })
    };
    config.lidars.iter().map(open).collect()
}

/// Captures may hold two LiDARs on one port, told apart by their addresses; a live port belongs to one.
fn refuse_shared_ports(lidars: &[LidarConfig]) -> Result<(), Failure> {
    let ports = |lidar: &LidarConfig| [lidar.port, lidar.position_port];
    for (n, lidar) in lidars.iter().enumerate() {
        let shared = |other: &&LidarConfig| ports(lidar).iter().any(|port| *port != 0 && ports(other).contains(port));
        if let Some(other) = lidars.iter().take(n).find(shared) {
            let message = format!("the LiDARs {} and {} share a port: live, each needs its own", other.id, lidar.id);
            let help = "set another data and position port on one sensor's web page, and as its port and position_port";
            return Err(Failure::input(message).with_help(help));
        }
    }
    Ok(())
}

impl OpenedSource {
    /// Lets it run, on a thread of its own, until the stop.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(self, clock: &SessionClock, stop: &StopToken) -> Result<RunningSource, Failure> {
        let Self { opener, source, intake } = self;
        let (sensor, counters) = (opener.sensor().to_string(), intake.counters());
        let (clock, stop, told) = (clock.clone(), stop.clone(), notice(&sensor));
        let supervised = supervise(Box::new(opener), Some(source), intake, clock, stop, Backoff::default(), told);
        Ok(RunningSource { sensor, counters, supervised: supervised.map_err(Failure::failed)? })
    }
}

/// What a source did.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SourceReport {
    /// The sensor.
    pub sensor: String,
    /// Packets delivered.
    pub packets: u64,
    /// Their payload, bytes.
    pub bytes: u64,
    /// Lost in the kernel's socket buffer, as far as it told.
    pub lost_kernel: u64,
    /// Lost because the ledger's queue was full.
    pub lost_queue: u64,
    /// Datagrams from other addresses than `lidar.source`; left out.
    pub other_source: u64,
    /// Datagrams larger than any sensor sends; left out.
    pub oversized: u64,
    /// Why it ended early; null: it did not.
    pub error: Option<String>,
}

impl RunningSource {
    /// Items lost so far because the ledger's queue was full.
    pub(super) fn lost_in_queue(&self) -> u64 {
        self.counters.snapshot().lost_queue
    }

    /// Waits for its end: tell it to stop first.
    pub fn join(self) -> SourceReport {
        let ended = self.supervised.join();
        let counts = ended.summary;
        SourceReport {
            sensor: self.sensor,
            packets: counts.delivered,
            bytes: counts.bytes,
            lost_kernel: counts.lost_kernel,
            lost_queue: counts.lost_queue,
            other_source: counts.other_source,
            oversized: counts.oversized,
            error: ended.error.map(|error| error.to_string()),
        }
    }
}

fn udp(lidar: &LidarConfig) -> UdpConfig {
    UdpConfig {
        port: lidar.port,
        position_port: Some(lidar.position_port),
        source: lidar.source,
        ..UdpConfig::new(lidar.id.clone())
    }
}

/// Tells the log what happens to a source.
fn notice(sensor: &str) -> impl FnMut(Notice) + Send + 'static {
    let sensor = sensor.to_owned();
    move |notice| match notice {
        Notice::Opened(info) => opened(&sensor, &info),
        Notice::Failed { error, retry_in } => {
            tracing::warn!(%sensor, retry_in_ms = retry_in.as_millis() as u64, "{error}");
        }
        _ => {}
    }
}

fn opened(sensor: &str, info: &SourceInfo) {
    match &info.device {
        Device::Udp(udp) => {
            let position = udp.position.map_or_else(|| "none".to_owned(), |address| address.to_string());
            tracing::info!(%sensor, data = %udp.data, %position, "receiving");
        }
        _ => tracing::info!(%sensor, "receiving"),
    }
    for warning in &info.warnings {
        tracing::warn!(%sensor, "{warning}");
    }
}
