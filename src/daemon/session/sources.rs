//! A session's sources: opened before any of them runs, kept running, told to stop together.
//!
//! Simulated LiDARs are received by the same sources, on free ports of loopback; what sends to them, and puts everything
//! else in, is a [`SimulatedRig`].

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::live::{
    Backoff, Device, Intake, Ledger, Opener, PortName, QueueBound, SerialConfig, SerialOpener, SerialProtocol,
    SessionClock, Source, SourceCounters, StopToken, Supervised, UdpConfig, UdpInfo, UdpOpener, supervise,
};
use tumbled_model::SensorId;

use super::kinects;
use super::setup::TURNTABLE;
use super::standing::Standing;
use crate::cli::Failure;
use crate::config::{Config, KinectConfig, LidarConfig, TurntableConfig, TurntableProtocol};
use crate::simulation::live::shortfall::ShortfallReport;
use crate::simulation::live::{DoneFaults, RunningScene, SimulatedRig, Way};
use crate::stream::SourceHealth;

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
    /// One with a thread of its own. `first`: it is open already, because an error of the first attempt is to be told at
    /// once; without it, it is opened on that thread, and may be absent.
    Supervised { opener: Box<dyn Opener>, first: Option<Box<dyn Source>>, intake: Intake, backoff: Backoff },
    /// A simulated sensor that is no LiDAR: the scene has its intake.
    OfScene { sensor: SensorId, counters: Arc<SourceCounters> },
}

/// A source that runs.
#[derive(Debug)]
pub struct RunningSource {
    sensor: String,
    counters: Arc<SourceCounters>,
    standing: Standing,
    /// `None`: the scene's threads run it.
    supervised: Option<Supervised>,
}

/// Opens every source of the config: a port that is taken is told at once, before anything runs. A Kinect and a turntable
/// are opened on their own threads: one that is absent or does not answer holds up neither the start nor the stop.
///
/// # Errors
/// Exit code 2: two LiDARs on one port, a Kinect that this build cannot read. 1: a port that cannot be had.
pub fn open(
    rig: Rig,
    config: &Config,
    ledger: &mut Ledger,
    clock: &SessionClock,
    stop: &StopToken,
) -> Result<OpenedSources, Failure> {
    match rig {
        Rig::Devices => {
            refuse_shared_ports(&config.lidars)?;
            let mut sources = Vec::new();
            for lidar in &config.lidars {
                sources.push(open_udp(udp(lidar), ledger, clock)?.0);
            }
            for kinect in &config.kinects {
                sources.push(kinect_source(kinect, ledger, clock, stop)?);
            }
            sources.extend(config.turntable.as_ref().map(|turntable| turntable_source(turntable, ledger, clock, stop)));
            Ok(OpenedSources { sources, scene: None })
        }
        Rig::Simulated(scene) => open_simulated(scene, config, ledger, clock),
    }
}

fn kinect_source(
    kinect: &KinectConfig,
    ledger: &mut Ledger,
    clock: &SessionClock,
    stop: &StopToken,
) -> Result<OpenedSource, Failure> {
    let (opener, backoff) = kinects::opener(kinect, clock, stop)?;
    let intake = ledger.intake(kinect.id.clone(), QueueBound::KINECT_FRAMES);
    Ok(OpenedSource::Supervised { opener, first: None, intake, backoff })
}

fn turntable_source(
    turntable: &TurntableConfig,
    ledger: &mut Ledger,
    clock: &SessionClock,
    stop: &StopToken,
) -> OpenedSource {
    let sensor = SensorId::from(TURNTABLE);
    let intake = ledger.intake(sensor.clone(), QueueBound::SERIAL_CHUNKS);
    let serial = SerialConfig {
        sensor,
        port: PortName::parse(&turntable.port),
        protocol: match turntable.protocol {
            TurntableProtocol::Zaber => SerialProtocol::Zaber,
            TurntableProtocol::Line => SerialProtocol::Line,
        },
        baud: turntable.baud,
        root: PathBuf::from("/"),
    };
    let opener = Box::new(SerialOpener::new(serial, clock.clone(), stop.clone()));
    OpenedSource::Supervised { opener, first: None, intake, backoff: SerialOpener::BACKOFF }
}

fn open_udp(udp: UdpConfig, ledger: &mut Ledger, clock: &SessionClock) -> Result<(OpenedSource, Device), Failure> {
    let intake = ledger.intake(udp.sensor.clone(), QueueBound::LIDAR_PACKETS);
    let mut opener = UdpOpener::new(udp, clock.clone());
    let source = opener.open().map_err(Failure::failed)?;
    let device = source.describe().device;
    let (opener, first, backoff) = (Box::new(opener), Some(source), Backoff::default());
    Ok((OpenedSource::Supervised { opener, first, intake, backoff }, device))
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
        let standing = Standing::default();
        let (opener, first, intake, backoff) = match self {
            Self::Supervised { opener, first, intake, backoff } => (opener, first, intake, backoff),
            Self::OfScene { sensor, counters } => {
                return Ok(RunningSource { sensor: sensor.to_string(), counters, standing, supervised: None });
            }
        };
        let (sensor, counters) = (opener.sensor().to_string(), intake.counters());
        let (name, told) = (sensor.clone(), standing.clone());
        let notice = move |notice| told.take(&name, notice);
        let supervised = supervise(opener, first, intake, clock.clone(), stop.clone(), backoff, notice);
        Ok(RunningSource { sensor, counters, standing, supervised: Some(supervised.map_err(Failure::failed)?) })
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
    /// Frames of a Kinect that its stamps say were sent and that did not come whole enough to be used.
    pub lost_usb: u64,
    /// Datagrams from other addresses than `lidar.source`; left out.
    pub other_source: u64,
    /// Datagrams larger than any sensor sends; left out.
    pub oversized: u64,
    /// How often it was opened; 0: it was never there, or a scene's threads ran it.
    pub opened: u64,
    /// Why it delivered nothing any more when the session ended, and what to do; null: it did.
    pub cause: Option<String>,
    /// Why it ended early; null: it did not.
    pub error: Option<String>,
}

impl SourceReport {
    /// What was lost between the cable and the ledger.
    pub fn lost_here(&self) -> u64 {
        self.lost_kernel + self.lost_queue + self.lost_usb
    }
}

impl RunningSource {
    /// Items lost so far because the ledger's queue was full.
    pub(super) fn lost_in_queue(&self) -> u64 {
        self.counters.snapshot().lost_queue
    }

    /// How it stands; `None`: the scene's threads run it.
    pub(super) fn health(&self) -> Option<SourceHealth> {
        self.supervised.as_ref()?;
        let stand = self.standing.now();
        Some(SourceHealth { sensor: self.sensor.clone(), opened: stand.opened, cause: stand.cause })
    }

    /// Waits for its end: tell it to stop first.
    fn join(self) -> SourceReport {
        // Before the stop's own consequences.
        let stand = self.standing.now();
        let error = self.supervised.and_then(|supervised| supervised.join().error);
        let counts = self.counters.snapshot();
        SourceReport {
            sensor: self.sensor,
            packets: counts.delivered,
            bytes: counts.bytes,
            lost_kernel: counts.lost_kernel,
            lost_queue: counts.lost_queue,
            lost_usb: counts.lost_usb,
            other_source: counts.other_source,
            oversized: counts.oversized,
            opened: stand.opened,
            cause: stand.cause,
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
