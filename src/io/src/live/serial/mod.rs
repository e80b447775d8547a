//! A turntable on a serial port.
//!
//! ```text
//!   SerialOpener ─ port: by path or USB serial number, raw, exclusive ─ zaber: who answers ─▶ SerialSource
//!   SerialSource ─┬─ zaber: asks 50 times a second ─ requests and replies ─▶ Intake
//!                 └─ line: listens ─────────────── what comes ───────────▶ Intake
//! ```
//!
//! The source only asks: nothing here moves a stage. What it puts into the ledger is both directions with the host's
//! stamps, so that the core makes the same angles of a live line and of its recording.

mod line;
mod port;
mod trouble;
mod zaber;

pub use trouble::{SerialError, SerialTrouble};

use super::clock::SessionClock;
use super::intake::{Intake, LedgerClosed};
use super::source::{Device, Opener, SerialInfo, Source, SourceError, SourceInfo, SourceWarning, Summary};
use super::stop::StopToken;
use super::supervise::Backoff;
use crate::machine::{latency_timer_ms, serial_by_usb};
use bytes::Bytes;
use port::Port;
use std::path::PathBuf;
use std::time::Duration;
use tumbled_model::{Body, RigNs, SensorId};
use tumbled_serial::zaber::{Address, Setting};

/// Which port, and what is spoken on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialConfig {
    /// The sensor's name.
    pub sensor: SensorId,
    /// Which port.
    pub port: PortName,
    /// What is spoken.
    pub protocol: SerialProtocol,
    /// The line's rate; 8 bits, no parity, one stop bit, no flow control.
    pub baud: u32,
    /// Below which folder the system lists its devices: `/`.
    pub root: PathBuf,
}

/// How a port is found, each time it is opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortName {
    /// By its device file, or a link to it.
    Path(PathBuf),
    /// By its adapter's USB serial number, wherever that is plugged in.
    UsbSerial(String),
}

/// What is spoken on a turntable's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SerialProtocol {
    /// Zaber ASCII.
    Zaber,
    /// This project's line stream.
    Line,
}

impl PortName {
    /// Before a USB serial number in a config.
    pub const USB: &'static str = "usb:";

    /// From a config: a path, or `usb:` and a USB serial number.
    pub fn parse(text: &str) -> Self {
        match text.strip_prefix(Self::USB) {
            Some(serial) => Self::UsbSerial(serial.to_owned()),
            None => Self::Path(text.into()),
        }
    }

    /// The device file now.
    ///
    /// # Errors
    /// [`SerialTrouble::NoAdapter`], [`SerialTrouble::SeveralAdapters`].
    pub fn find(&self, root: &std::path::Path) -> Result<PathBuf, SerialTrouble> {
        match self {
            Self::Path(path) => Ok(path.clone()),
            Self::UsbSerial(serial) => match serial_by_usb(root, serial).as_slice() {
                [one] => Ok(one.clone()),
                [] => Err(SerialTrouble::NoAdapter { serial: serial.clone() }),
                several => Err(SerialTrouble::SeveralAdapters { serial: serial.clone(), devices: several.to_vec() }),
            },
        }
    }
}

impl core::fmt::Display for PortName {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Path(path) => path.display().fmt(f),
            Self::UsbSerial(serial) => write!(f, "{}{serial}", Self::USB),
        }
    }
}

/// Opens a turntable's port, again and again.
#[derive(Debug)]
pub struct SerialOpener {
    config: SerialConfig,
    clock: SessionClock,
    stop: StopToken,
}

impl SerialOpener {
    /// How long to wait between attempts: a port that is back is open again within 5 s, so no pause may be longer than 2 s.
    pub const BACKOFF: Backoff = Backoff { first: Duration::from_millis(500), last: Duration::from_secs(2) };

    /// An opener; nothing is opened yet. An opening that is under way ends when `stop` says so.
    pub fn new(config: SerialConfig, clock: SessionClock, stop: StopToken) -> Self {
        Self { config, clock, stop }
    }

    /// Opens it; the source has a type of its own.
    ///
    /// # Errors
    /// [`SourceError::Serial`].
    pub fn open_serial(&mut self) -> Result<SerialSource, SourceError> {
        let config = &self.config;
        let told = |trouble| SourceError::Serial(SerialError { port: config.port.to_string(), trouble });
        let path = config.port.find(&config.root).map_err(told)?;
        let mut port = Port::open(&config.root, &path, config.baud).map_err(told)?;
        let stage = match config.protocol {
            SerialProtocol::Zaber => Some(zaber::find(&mut port, config.baud, &self.stop).map_err(told)?),
            SerialProtocol::Line => None,
        };
        Ok(SerialSource {
            port,
            stage,
            info: self.info(path, stage),
            config: config.clone(),
            clock: self.clock.clone(),
        })
    }

    fn info(&self, path: PathBuf, stage: Option<Stage>) -> SourceInfo {
        let slow = latency_timer_ms(&self.config.root, &path).filter(|ms| *ms > 1);
        let axis = stage.map(|stage| stage.axis);
        let device = Device::Serial(SerialInfo { path, baud: self.config.baud, axis });
        let mut info = SourceInfo::new(self.config.sensor.clone(), device);
        info.warnings.extend(slow.map(|ms| SourceWarning::SlowSerialAdapter { ms }));
        info
    }
}

impl Opener for SerialOpener {
    fn sensor(&self) -> &SensorId {
        &self.config.sensor
    }

    fn open(&mut self) -> Result<Box<dyn Source>, SourceError> {
        Ok(Box::new(self.open_serial()?))
    }
}

/// A Zaber stage that has answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stage {
    axis: Address,
    /// What is polled: the encoder, or where the stage was told to be if there is none.
    position: Setting,
}

/// An open port.
#[derive(Debug)]
pub struct SerialSource {
    port: Port,
    /// Of protocol `zaber`.
    stage: Option<Stage>,
    info: SourceInfo,
    config: SerialConfig,
    clock: SessionClock,
}

impl Source for SerialSource {
    fn describe(&self) -> SourceInfo {
        self.info.clone()
    }

    fn run(self: Box<Self>, sink: Intake, stop: StopToken) -> Result<Summary, SourceError> {
        let counters = sink.counters();
        let Self { mut port, stage, config, clock, .. } = *self;
        let mut chunks = Chunks { sensor: config.sensor, sink, clock, newest: RigNs(0) };
        let ended = match stage {
            Some(stage) => zaber::poll(&mut port, stage, config.baud, &mut chunks, &stop),
            None => line::listen(&mut port, &mut chunks, &stop),
        };
        match ended {
            Ok(()) => Ok(counters.snapshot()),
            // Who stops the ledger has told this source too: the two only raced.
            Err(_) if stop.is_stopped() => Ok(counters.snapshot()),
            Err(Ended::LedgerClosed) => Err(SourceError::LedgerClosed { sensor: chunks.sensor }),
            Err(Ended::Trouble(trouble)) => {
                Err(SourceError::Serial(SerialError { port: config.port.to_string(), trouble }))
            }
        }
    }
}

/// Why a conversation ended before the stop.
enum Ended {
    LedgerClosed,
    Trouble(SerialTrouble),
}

impl From<LedgerClosed> for Ended {
    fn from(LedgerClosed: LedgerClosed) -> Self {
        Self::LedgerClosed
    }
}

impl From<SerialTrouble> for Ended {
    fn from(trouble: SerialTrouble) -> Self {
        Self::Trouble(trouble)
    }
}

/// Where the bytes of both directions go.
struct Chunks {
    sensor: SensorId,
    sink: Intake,
    clock: SessionClock,
    newest: RigNs,
}

impl Chunks {
    fn now(&self) -> RigNs {
        self.clock.now().rig
    }

    /// A chunk of that instant; never earlier than the one before it, so that the line's order is that of its stamps.
    fn push(&mut self, at: RigNs, bytes: &[u8]) -> Result<(), LedgerClosed> {
        self.newest = self.newest.max(at);
        let body = Body::SerialChunk { sensor: self.sensor.clone(), bytes: Bytes::copy_from_slice(bytes) };
        self.sink.push(self.newest, body).map(|_| ())
    }
}
