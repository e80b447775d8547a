//! What a source is: something that puts raw events into the ledger.

use super::intake::Intake;
use super::stop::StopToken;
use crate::machine::KinectModel;
use core::fmt;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use tumbled_model::{LossPoint, SensorId};

/// Something that puts raw events into the ledger. Runs on an OS thread of its own.
pub trait Source: Send {
    /// What it is, for the operator and for a recording's metadata.
    fn describe(&self) -> SourceInfo;

    /// Delivers until it is done or told to stop.
    ///
    /// # Errors
    /// When the device or socket fails; whoever supervises opens it again.
    fn run(self: Box<Self>, sink: Intake, stop: StopToken) -> Result<Summary, SourceError>;
}

/// Opens a source, again and again.
pub trait Opener: Send {
    /// The sensor it opens.
    fn sensor(&self) -> &SensorId;

    /// Opens it.
    ///
    /// # Errors
    /// When the device is absent or refused; the message says what to do.
    fn open(&mut self) -> Result<Box<dyn Source>, SourceError>;
}

/// What a source is, once it is open.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SourceInfo {
    /// Whose data it gives.
    pub sensor: SensorId,
    /// Where they come from.
    pub device: Device,
    /// What the operator should know and change.
    pub warnings: Vec<SourceWarning>,
}

impl SourceInfo {
    /// A source without warnings.
    pub fn new(sensor: SensorId, device: Device) -> Self {
        Self { sensor, device, warnings: Vec::new() }
    }
}

/// Where a source's data come from.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Device {
    /// UDP sockets.
    Udp(UdpInfo),
    /// A Kinect on the USB.
    Kinect(KinectInfo),
    /// A turntable on a serial port.
    Serial(SerialInfo),
    /// Values in memory or a file, not a device.
    Stored,
}

/// The sockets of a LiDAR.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct UdpInfo {
    /// Address and port of the data socket as bound: a configured port 0 shows the port chosen.
    pub data: SocketAddr,
    /// Of the position socket.
    pub position: Option<SocketAddr>,
    /// Only datagrams from this address count.
    pub source: Option<IpAddr>,
    /// The data socket's receive buffer.
    pub buffer: ReceiveBuffer,
}

/// A Kinect on the USB.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct KinectInfo {
    /// Its model; `None`: the system does not list it.
    pub model: Option<KinectModel>,
    /// Its serial number, as a config names it.
    pub serial: Option<String>,
    /// The release number of its camera's firmware (bcdDevice).
    pub release: Option<u16>,
    /// Its place on the bus, e.g. `1-2.3`.
    pub place: Option<String>,
    /// Recorded frames, played by fakenect in the USB library's stead: no device.
    pub recorded: bool,
}

/// A turntable's serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SerialInfo {
    /// The device file that was opened.
    pub path: PathBuf,
    /// The line's rate.
    pub baud: u32,
    /// The device and axis that answered; `None`: this protocol has no such numbers.
    pub axis: Option<tumbled_serial::zaber::Address>,
}

/// A socket's receive buffer, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceiveBuffer {
    /// Asked for.
    pub requested: usize,
    /// Usable size that the kernel granted: half of what it reports, the other half being its own bookkeeping.
    pub granted: usize,
}

/// What the operator should know about a source that works all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SourceWarning {
    /// The kernel granted less than 1 MiB of receive buffer: a short pause of this machine loses packets.
    SmallReceiveBuffer(ReceiveBuffer),
    /// A USB adapter holds bytes back before it hands them over.
    SlowSerialAdapter {
        /// For so long, ms.
        ms: u32,
    },
    /// A Kinect's tilt, lamp or accelerometer does not do what was asked; its depth comes all the same.
    KinectPosture {
        /// The step that failed.
        step: &'static str,
    },
    /// The system did not grant real-time priority to the thread that receives a Kinect's packets.
    #[cfg(feature = "kinect-usb")]
    KinectPriority {
        /// What it granted.
        granted: tumbled_freenect::Priority,
    },
}

impl SourceWarning {
    /// What makes an adapter hand over what it has every millisecond.
    pub const LATENCY_RULE: &'static str = "a udev rule sets its latency_timer to 1: ACTION==\"add\", \
                                            SUBSYSTEM==\"usb-serial\", DRIVER==\"ftdi_sio\", ATTR{latency_timer}=\"1\"";
}

impl fmt::Display for SourceWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SmallReceiveBuffer(buffer) => write!(
                f,
                "the kernel granted a receive buffer of {} bytes of the {} asked for: packets are lost when this machine \
                 is busy for a moment; allow more with `sysctl -w net.core.rmem_max=8388608`",
                buffer.granted, buffer.requested
            ),
            Self::SlowSerialAdapter { ms } => write!(
                f,
                "the serial adapter holds bytes back for {ms} ms: the angle's time is that uncertain; {}",
                Self::LATENCY_RULE
            ),
            Self::KinectPosture { step } => write!(
                f,
                "{step} failed: on model 1473 and Kinect for Windows tilt, lamp and accelerometer need firmware for the \
                 microphones; depth does not"
            ),
            #[cfg(feature = "kinect-usb")]
            Self::KinectPriority { granted } => write!(
                f,
                "the Kinect's thread has {granted} priority: frames lose packets when this machine is busy for 32 ms; allow \
                 real time: LimitRTPRIO=20 in the service's unit, for a user a line `USER - rtprio 20` in \
                 /etc/security/limits.d/tumbled.conf and a new log-in"
            ),
        }
    }
}

/// Why a source does not deliver.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// Another socket has the port.
    #[error(
        "UDP port {port} is in use: `ss -ulpn 'sport = :{port}'` shows by whom; end that program or set another port"
    )]
    PortInUse {
        /// The port.
        port: u16,
    },
    /// The port is reserved, or the system's policy forbids the socket.
    #[error(
        "no permission to receive on UDP port {port}: ports below 1024 need the capability CAP_NET_BIND_SERVICE, \
         binding to an interface may need CAP_NET_RAW ({error})"
    )]
    NotPermitted {
        /// The port.
        port: u16,
        /// What the system said.
        error: io::Error,
    },
    /// The bind address belongs to no interface.
    #[error(
        "no interface of this machine has the address {address}: `ip address` lists those it has; 0.0.0.0 takes all"
    )]
    NoSuchAddress {
        /// The configured address.
        address: IpAddr,
    },
    /// The interface is not there, or not any more.
    #[error("there is no network interface `{interface}`: `ip link` lists them")]
    NoSuchInterface {
        /// The configured name.
        interface: String,
    },
    /// The system refused something else while opening.
    #[error("cannot open UDP port {port}: {step} failed: {error}")]
    Open {
        /// The port.
        port: u16,
        /// What was tried.
        step: &'static str,
        /// What the system said.
        error: io::Error,
    },
    /// An open socket failed.
    #[error("receiving from {address} failed: {error}")]
    Receive {
        /// The socket's own address.
        address: SocketAddr,
        /// What the system said.
        error: io::Error,
    },
    /// A turntable's port does not deliver.
    #[error(transparent)]
    Serial(super::serial::SerialError),
    /// A Kinect does not deliver.
    #[cfg(feature = "kinect-usb")]
    #[error("{error}{}", super::kinect_usb::listed(hints))]
    Kinect {
        /// Why, as the driver sees it.
        error: tumbled_freenect::KinectError,
        /// What the system knows besides.
        hints: Vec<super::kinect_usb::KinectHint>,
    },
    /// A Kinect sends the same frame again and again.
    #[cfg(feature = "kinect-usb")]
    #[error(
        "the Kinect is frozen: {repeats} frames on end repeat the one before; it is opened anew; if that does not help, plug it \
         in anew"
    )]
    KinectFrozen {
        /// Repetitions on end.
        repeats: u32,
    },
    /// The ledger ended before the source was told to stop.
    #[error("the ledger has ended: nothing takes the data of {sensor} any more")]
    LedgerClosed {
        /// Whose.
        sensor: SensorId,
    },
}

impl SourceError {
    /// Whether another attempt can help. Cables, ports and permissions change; a ledger that has ended and recorded frames
    /// that cannot be played do not.
    pub fn is_worth_a_retry(&self) -> bool {
        match self {
            Self::LedgerClosed { .. } => false,
            #[cfg(feature = "kinect-usb")]
            Self::Kinect { error, .. } => error.is_worth_a_retry(),
            _ => true,
        }
    }
}

/// A source's counts while it runs; read from any thread.
#[derive(Debug, Default)]
pub struct SourceCounters {
    pub(super) delivered: AtomicU64,
    pub(super) bytes: AtomicU64,
    pub(super) lost_kernel: AtomicU64,
    pub(super) lost_queue: AtomicU64,
    pub(super) lost_usb: AtomicU64,
    pub(super) other_source: AtomicU64,
    pub(super) oversized: AtomicU64,
    pub(super) clock_steps: AtomicU64,
    pub(super) stamped_at_reading: AtomicU64,
}

impl SourceCounters {
    /// The counts now. Each is exact; together they are of about the same instant.
    pub fn snapshot(&self) -> Summary {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        Summary {
            delivered: read(&self.delivered),
            bytes: read(&self.bytes),
            lost_kernel: read(&self.lost_kernel),
            lost_queue: read(&self.lost_queue),
            lost_usb: read(&self.lost_usb),
            other_source: read(&self.other_source),
            oversized: read(&self.oversized),
            clock_steps: read(&self.clock_steps),
            stamped_at_reading: read(&self.stamped_at_reading),
        }
    }

    pub(super) fn add(count: &AtomicU64, n: u64) {
        count.fetch_add(n, Ordering::Relaxed);
    }

    /// The count of one place of loss; places behind the intake are not a source's to count.
    pub(super) fn lost_at(&self, place: LossPoint) -> Option<&AtomicU64> {
        match place {
            LossPoint::Kernel => Some(&self.lost_kernel),
            LossPoint::Queue => Some(&self.lost_queue),
            LossPoint::Usb => Some(&self.lost_usb),
            _ => None,
        }
    }
}

/// What a source did, in all its runs of this session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Summary {
    /// Packets, frames or chunks that the ledger's queue took.
    pub delivered: u64,
    /// Their payload.
    pub bytes: u64,
    /// Lost in the kernel's socket buffer, as far as it told: it tells with the next packet.
    pub lost_kernel: u64,
    /// Lost because the queue into the ledger was full.
    pub lost_queue: u64,
    /// Lost on the USB.
    pub lost_usb: u64,
    /// Datagrams from another address than the configured one; not delivered.
    pub other_source: u64,
    /// Datagrams larger than any sensor sends (2 048 bytes); not delivered.
    pub oversized: u64,
    /// Steps of the wall clock noticed.
    pub clock_steps: u64,
    /// Datagrams whose arrival is the instant of reading, because the kernel's stamp was absent or impossible.
    pub stamped_at_reading: u64,
}
