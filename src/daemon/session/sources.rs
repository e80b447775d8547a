//! A session's sources: opened before any of them runs, kept running, told to stop together.
//!
//! Simulated LiDARs are received by the same sources, on free ports of loopback; what sends to them, and puts everything
//! else in, is a [`SimulatedRig`].

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::live::{
    Backoff, Device, Intake, Ledger, Notice, Opener, QueueBound, SessionClock, Source, SourceCounters, SourceInfo,
    StopToken, Supervised, UdpConfig, UdpInfo, UdpOpener, supervise,
};
use tumbled_model::SensorId;

use super::setup::TURNTABLE;
use crate::cli::Failure;
use crate::config::{Config, LidarConfig};
use crate::simulation::live::shortfall::ShortfallReport;
use crate::simulation::live::{DoneFaults, RunningScene, SimulatedRig, Way};

/// Where a session's data come from.
#[derive(Clone, Debug)]
pub enum Rig {
    /// The config's devices.
    Devices,
    /// A scene in real time.
    Simulated(SimulatedRig),
}

/// Everything that is open and does not run yet.
pub struct OpenedSources {
    /// In the order of their ways into the ledger.
    sources: Vec<OpenedSource>,
    scene: Option<(SimulatedRig, BTreeMap<SensorId, Way>)>,
}

/// Everything that runs.
#[derive(Debug)]
pub struct RunningSources {
    sources: Vec<RunningSource>,
    scene: Option<RunningScene>,
}

/// What the sources did.
#[derive(Clone, Debug, Default)]
pub struct SourcesEnd {
    /// Each, in the config's order.
    pub sources: Vec<SourceReport>,
    /// What a scene left out; `None`: nothing was simulated.
    pub shortfall: Option<ShortfallReport>,
    /// What was done on purpose.
    pub faults: DoneFaults,
}

/// A source that is open and not running yet.
enum OpenedSource {
    /// A LiDAR's sockets.
    Udp { opener: UdpOpener, source: Box<dyn Source>, intake: Intake },
    /// A simulated sensor that is no LiDAR: the scene has its intake.
    OfScene { sensor: SensorId, counters: Arc<SourceCounters> },
}

/// A source that runs.
#[derive(Debug)]
pub struct RunningSource {
    sensor: String,
    counters: Arc<SourceCounters>,
    /// `None`: the scene's threads run it.
    supervised: Option<Supervised>,
}

/// Opens every source of the config: a port that is taken is told at once, before anything runs.
///
/// # Errors
/// Exit code 2: two LiDARs on one port. 1: a port that cannot be had.
pub fn open(rig: Rig, config: &Config, ledger: &mut Ledger, clock: &SessionClock) -> Result<OpenedSources, Failure> {
    match rig {
        Rig::Devices => {
            refuse_shared_ports(&config.lidars)?;
            let open = |lidar: &LidarConfig| open_udp(udp(lidar), ledger, clock).map(|(opened, _)| opened);
            let sources = config.lidars.iter().map(open).collect::<Result<_, _>>()?;
            Ok(OpenedSources { sources, scene: None })
        }
        Rig::Simulated(scene) => open_simulated(scene, config, ledger, clock),
    }
}

fn open_udp(udp: UdpConfig, ledger: &mut Ledger, clock: &SessionClock) -> Result<(OpenedSource, Device), Failure> {
    let intake = ledger.intake(udp.sensor.clone(), QueueBound::LIDAR_PACKETS);
    let mut opener = UdpOpener::new(udp, clock.clone());
    let source = opener.open().map_err(Failure::failed)?;
    let device = source.describe().device;
    Ok((OpenedSource::Udp { opener, source, intake }, device))
}

/// A way in for each sensor of the config. LiDARs get free ports of loopback, whatever the config says: a scene disturbs
/// no sensor on the network, and no other scene.
fn open_simulated(
    scene: SimulatedRig,
    config: &Config,
    ledger: &mut Ledger,
    clock: &SessionClock,
) -> Result<OpenedSources, Failure> {
    let (mut sources, mut ways) = (Vec::new(), BTreeMap::new());
    for lidar in &config.lidars {
        let address = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let udp = UdpConfig { address, port: 0, position_port: Some(0), ..UdpConfig::new(lidar.id.clone()) };
        let (opened, device) = open_udp(udp, ledger, clock)?;
        if let Device::Udp(UdpInfo { data, position: Some(position), .. }) = device {
            ways.insert(lidar.id.clone(), Way::Datagrams { data, position });
        }
        sources.push(opened);
    }
    let kinects = config.kinects.iter().map(|kinect| (kinect.id.clone(), QueueBound::KINECT_FRAMES));
    let serials = config.turntable.iter().map(|_| (SensorId::from(TURNTABLE), QueueBound::SERIAL_CHUNKS));
    for (sensor, bound) in kinects.chain(serials) {
        let intake = ledger.intake(sensor.clone(), bound);
        sources.push(OpenedSource::OfScene { sensor: sensor.clone(), counters: intake.counters() });
        ways.insert(sensor, Way::Intake(intake));
    }
    Ok(OpenedSources { sources, scene: Some((scene, ways)) })
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

impl OpenedSources {
    /// Lets everything run until the stop.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(self, clock: &SessionClock, stop: &StopToken) -> Result<RunningSources, Failure> {
        // Who receives is there before who sends.
        let sources = self.sources.into_iter().map(|source| source.start(clock, stop)).collect::<Result<_, _>>()?;
        let scene = self.scene.map(|(scene, ways)| scene.start(ways, clock, stop)).transpose()?;
        Ok(RunningSources { sources, scene })
    }
}

impl RunningSources {
    /// Each source, in the order of their ways into the ledger.
    pub(super) fn sources(&self) -> &[RunningSource] {
        &self.sources
    }

    /// The scene; `None`: nothing is simulated.
    pub(super) fn scene(&self) -> Option<&RunningScene> {
        self.scene.as_ref()
    }

    /// Waits for the end of all: tell them to stop first.
    pub fn join(self) -> SourcesEnd {
        let (shortfall, faults) = self.scene.map(RunningScene::join).unzip();
        let sources = self.sources.into_iter().map(RunningSource::join).collect();
        SourcesEnd { sources, shortfall, faults: faults.unwrap_or_default() }
    }
}

impl OpenedSource {
    /// Lets it run, on a thread of its own, until the stop.
    fn start(self, clock: &SessionClock, stop: &StopToken) -> Result<RunningSource, Failure> {
        let (opener, source, intake) = match self {
            Self::Udp { opener, source, intake } => (opener, source, intake),
            Self::OfScene { sensor, counters } => {
                return Ok(RunningSource { sensor: sensor.to_string(), counters, supervised: None });
            }
        };
        let (sensor, counters) = (opener.sensor().to_string(), intake.counters());
        let (clock, stop, told) = (clock.clone(), stop.clone(), notice(&sensor));
        let supervised = supervise(Box::new(opener), Some(source), intake, clock, stop, Backoff::default(), told);
        Ok(RunningSource { sensor, counters, supervised: Some(supervised.map_err(Failure::failed)?) })
    }
}

/// What a source did.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SourceReport {
    /// The sensor.
    pub sensor: String,
    /// Packets, frames or chunks delivered.
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
    fn join(self) -> SourceReport {
        let error = self.supervised.and_then(|supervised| supervised.join().error);
        let counts = self.counters.snapshot();
        SourceReport {
            sensor: self.sensor,
            packets: counts.delivered,
            bytes: counts.bytes,
            lost_kernel: counts.lost_kernel,
            lost_queue: counts.lost_queue,
            other_source: counts.other_source,
            oversized: counts.oversized,
            error: error.map(|error| error.to_string()),
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
