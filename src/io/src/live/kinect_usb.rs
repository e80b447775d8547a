//! A Kinect on the USB.
//!
//! The driver (`tumbled-freenect`) has the device on a thread of its own, `usb-SENSOR`; frames go from there straight into the
//! ledger's queue, stamped when the library finished them. This source's own thread only watches: it ends the stream at a
//! stop, and within its deadline even when the driver's thread hangs in the USB library.

use super::clock::SessionClock;
use super::intake::{Intake, LedgerClosed};
use super::source::{Device, KinectInfo, Opener, Source, SourceError, SourceInfo, SourceWarning, Summary};
use super::stop::StopToken;
use super::supervise::Backoff;
use crate::machine::{KinectFinding, kinect_cameras, kinect_findings};
use bytes::Bytes;
use core::fmt;
use core::ops::ControlFlow;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tumbled_freenect::{Abandoned, End, Frame, FrameSink, Kinect, KinectError, Library, Options, Priority, reset};
use tumbled_kinect::{Freshness, FrozenDetector};
use tumbled_model::{Body, LossPoint, SensorId};

/// How often the stream is looked at: a Kinect that is unplugged is known this much later, at most.
const LOOK: Duration = Duration::from_millis(100);
/// Repetitions on end that make a frozen device: a third of a second.
pub const FROZEN_AFTER: u32 = 10;
/// Failures on end of a device that is there before it is reset.
const RESET_AFTER: u32 = 2;

/// A stream that brought so many frames, ten seconds' worth, has forgotten the failures before it.
const HEALTHY_FRAMES: u64 = 300;

/// Which Kinect, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct KinectUsbConfig {
    /// The sensor's name.
    pub sensor: SensorId,
    /// Which device, its deadlines, and what else of it than depth.
    pub options: Options,
    /// Frames on end that repeat the one before until the device counts as frozen.
    pub frozen_after: u32,
    /// Below which folder the system lists its devices: `/`.
    pub root: PathBuf,
}

impl KinectUsbConfig {
    /// The Kinect of this serial number; an empty one means the only Kinect.
    pub fn new(sensor: SensorId, serial: &str) -> Self {
        let serial = (!serial.is_empty()).then(|| serial.to_owned());
        let options = Options { serial, ..Options::default() };
        Self { sensor, options, frozen_after: FROZEN_AFTER, root: PathBuf::from("/") }
    }
}

/// What the system knows of a Kinect that cannot be read, and what was tried.
#[derive(Debug)]
#[non_exhaustive]
pub enum KinectHint {
    /// Something keeps it from being read.
    Found(KinectFinding),
    /// It was reset.
    Reset,
    /// It could not be reset.
    ResetFailed {
        /// Its device file.
        node: PathBuf,
        /// What the system said.
        error: io::Error,
    },
}

impl fmt::Display for KinectHint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Found(finding) => finding.fmt(f),
            Self::Reset => f.write_str("it was reset"),
            Self::ResetFailed { node, error } => write!(f, "resetting it by {} failed: {error}", node.display()),
        }
    }
}

/// Hints as they follow an error's text.
pub(super) fn listed(hints: &[KinectHint]) -> String {
    hints.iter().map(|hint| format!("; {hint}")).collect()
}

/// Opens a Kinect, again and again.
#[derive(Debug)]
pub struct KinectOpener {
    config: KinectUsbConfig,
    clock: SessionClock,
    stop: StopToken,
    abandoned: Abandoned,
    /// Failures on end of a device that is there; its sources count too.
    failures: Arc<AtomicU32>,
}

impl KinectOpener {
    /// How long to wait between attempts: a Kinect that is plugged in again is live within 5 s, so no pause may be longer
    /// than 2 s.
    pub const BACKOFF: Backoff = Backoff { first: Duration::from_millis(250), last: Duration::from_secs(2) };

    /// An opener; nothing is opened yet. An opening that is under way ends when `stop` says so.
    pub fn new(config: KinectUsbConfig, clock: SessionClock, stop: StopToken) -> Self {
        Self { config, clock, stop, abandoned: Abandoned::default(), failures: Arc::default() }
    }

    /// Threads that hang, or hung, in the USB library: a device that never answered.
    pub fn abandoned(&self) -> Abandoned {
        self.abandoned.clone()
    }

    /// Opens it; the source has a type of its own.
    ///
    /// # Errors
    /// [`SourceError::Kinect`].
    pub fn open_kinect(&mut self) -> Result<KinectSource, SourceError> {
        let tried = self.reset_if_due();
        let (options, stop) = (self.config.options.clone(), self.stop.clone());
        match Kinect::open(self.config.sensor.as_str(), options, &self.abandoned, &|| stop.is_stopped()) {
            Ok(kinect) => {
                let info = info(&self.config, &kinect);
                let (config, clock, failures) = (self.config.clone(), self.clock.clone(), Arc::clone(&self.failures));
                Ok(KinectSource { kinect, info, config, clock, failures })
            }
            Err(error) => {
                count(&self.failures, &error);
                let mut hints = found(&self.config, &error);
                hints.extend(tried);
                Err(SourceError::Kinect { error, hints })
            }
        }
    }

    /// The last remedy, for a device that is there and has failed again and again.
    fn reset_if_due(&self) -> Option<KinectHint> {
        if self.failures.load(Ordering::Relaxed) < RESET_AFTER {
            return None;
        }
        self.failures.store(0, Ordering::Relaxed);
        let cameras = kinect_cameras(&self.config.root, self.config.options.serial.as_deref());
        let [camera] = cameras.as_slice() else { return None };
        let node = camera.node.clone()?;
        let below = self.config.root.join(node.strip_prefix("/").unwrap_or(&node));
        Some(match reset(&below) {
            Ok(()) => KinectHint::Reset,
            Err(error) => KinectHint::ResetFailed { node, error },
        })
    }
}

impl Opener for KinectOpener {
    fn sensor(&self) -> &SensorId {
        &self.config.sensor
    }

    fn open(&mut self) -> Result<Box<dyn Source>, SourceError> {
        Ok(Box::new(self.open_kinect()?))
    }
}

fn count(failures: &AtomicU32, error: &KinectError) {
    if error.calls_for_a_reset() {
        failures.fetch_add(1, Ordering::Relaxed);
    }
}

/// What the system knows of it. A system that lists no Kinect at all has nothing to add to what the driver says.
fn found(config: &KinectUsbConfig, error: &KinectError) -> Vec<KinectHint> {
    if matches!(error, KinectError::Cancelled | KinectError::Playback(_)) {
        return Vec::new();
    }
    let findings = kinect_findings(&config.root, config.options.serial.as_deref());
    let telling = |finding: &KinectFinding| match finding {
        KinectFinding::NoCamera { other_parts } => *other_parts,
        // This program, while a thread of it hangs there; of another one the driver says so.
        KinectFinding::InUse => false,
        _ => true,
    };
    findings.into_iter().filter(telling).map(KinectHint::Found).collect()
}

fn info(config: &KinectUsbConfig, kinect: &Kinect) -> SourceInfo {
    let opened = kinect.opened();
    let recorded = opened.library == Library::Fakenect;
    let mut device = KinectInfo { serial: opened.serial.clone(), recorded, ..KinectInfo::default() };
    if !recorded {
        let serial = opened.serial.as_deref().or(config.options.serial.as_deref());
        if let [camera] = kinect_cameras(&config.root, serial).as_slice() {
            device.model = camera.model();
            device.release = camera.release;
            device.place = Some(camera.place.clone());
        }
    }
    let mut info = SourceInfo::new(config.sensor.clone(), Device::Kinect(device));
    info.warnings.extend(opened.posture_failed.map(|step| SourceWarning::KinectPosture { step }));
    if !recorded && opened.priority != Priority::RealTime {
        info.warnings.push(SourceWarning::KinectPriority { granted: opened.priority });
    }
    info
}

/// An open Kinect.
#[derive(Debug)]
pub struct KinectSource {
    kinect: Kinect,
    info: SourceInfo,
    config: KinectUsbConfig,
    clock: SessionClock,
    failures: Arc<AtomicU32>,
}

/// Why the sink wants no more.
#[derive(Clone, Copy, Debug)]
enum Enough {
    LedgerClosed,
    Frozen { repeats: u32 },
}

/// Where frames go: runs on the driver's thread, and neither waits nor allocates beyond the frame's copy.
struct Delivery {
    sensor: SensorId,
    clock: SessionClock,
    intake: Intake,
    /// `None` for recorded frames: they repeat what they will.
    frozen: Option<FrozenDetector>,
    enough: Arc<OnceLock<Enough>>,
}

impl Delivery {
    fn take(&mut self, frame: &Frame<'_>) -> ControlFlow<()> {
        let arrived = self.clock.now().rig;
        self.intake.lost(LossPoint::Usb, u64::from(frame.missing_before));
        let bytes = Bytes::copy_from_slice(frame.bytes);
        let freshness = self.frozen.as_mut().map(|frozen| frozen.observe(Some(frame.ticks), frame.encoding, &bytes));
        let body = Body::DepthFrame {
            sensor: self.sensor.clone(),
            ticks: Some(frame.ticks),
            encoding: frame.encoding,
            lost_packets: frame.lost_packets,
            bytes,
        };
        let enough = match (self.intake.push(arrived, body), freshness) {
            (Err(LedgerClosed), _) => Enough::LedgerClosed,
            (Ok(_), Some(Freshness::Frozen { run, .. })) => Enough::Frozen { repeats: run },
            (Ok(_), _) => return ControlFlow::Continue(()),
        };
        // Nobody else sets it.
        self.enough.set(enough).unwrap_or(());
        ControlFlow::Break(())
    }
}

impl KinectSource {
    /// Lets a sink have its frames while `watch` watches, then closes it; what it is.
    pub(super) fn taken_by(
        mut self,
        sink: FrameSink,
        watch: impl FnOnce(&mut Kinect) -> Result<(), KinectError>,
    ) -> Result<SourceInfo, SourceError> {
        self.kinect.start(sink);
        let outcome = watch(&mut self.kinect);
        let Self { kinect, info, config, .. } = self;
        kinect.stop();
        match outcome {
            Ok(()) => Ok(info),
            Err(error) => {
                let hints = found(&config, &error);
                Err(SourceError::Kinect { error, hints })
            }
        }
    }

    /// Watches until the stream is over or told to stop.
    fn watch(&mut self, stop: &StopToken) -> Result<End, KinectError> {
        loop {
            if let Some(outcome) = self.kinect.look() {
                return outcome;
            }
            if self.kinect.frames() >= HEALTHY_FRAMES {
                self.failures.store(0, Ordering::Relaxed);
            }
            if stop.wait(LOOK) {
                return Ok(End::Stopped);
            }
        }
    }
}

impl Source for KinectSource {
    fn describe(&self) -> SourceInfo {
        self.info.clone()
    }

    fn run(mut self: Box<Self>, sink: Intake, stop: StopToken) -> Result<Summary, SourceError> {
        let counters = sink.counters();
        let enough = Arc::new(OnceLock::new());
        let is_device = self.kinect.opened().library == Library::Freenect;
        let mut delivery = Delivery {
            sensor: self.config.sensor.clone(),
            clock: self.clock.clone(),
            intake: sink,
            frozen: is_device.then(|| FrozenDetector::new(self.config.frozen_after)),
            enough: Arc::clone(&enough),
        };
        let sink: FrameSink = Box::new(move |frame| delivery.take(frame));
        self.kinect.start(sink);
        let outcome = self.watch(&stop);
        let Self { kinect, config, failures, .. } = *self;
        kinect.stop();
        match (outcome, enough.get()) {
            // Who stops the ledger has told this source too: the two only raced.
            _ if stop.is_stopped() => {}
            (Err(error), _) => {
                count(&failures, &error);
                let hints = found(&config, &error);
                return Err(SourceError::Kinect { error, hints });
            }
            (Ok(_), Some(Enough::LedgerClosed)) => return Err(SourceError::LedgerClosed { sensor: config.sensor }),
            (Ok(_), Some(Enough::Frozen { repeats })) => {
                failures.fetch_add(1, Ordering::Relaxed);
                return Err(SourceError::KinectFrozen { repeats: *repeats });
            }
            (Ok(End::Stopped | End::SinkClosed | End::Played), None) => {}
        }
        Ok(counters.snapshot())
    }
}
