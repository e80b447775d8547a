//! Live data: from sensors through bounded queues into one ordered ledger.
//!
//! ```text
//!   rx-front ── Intake ──┐                        ┌── recorder queue ──▶ recorder
//!   rx-near  ── Intake ──┼──▶ ledger: seq, Tick, ─┤
//!   rx-stage ── Intake ──┘    Anchor, Skip        └── core queue ──────▶ core
//!    (drop newest, one Gap)                        (recorder loses; the core is relieved by Skip)
//! ```
//!
//! * [`source`]: what a source is; [`udp`] is the one for a LiDAR, `kinect_usb` the one for a Kinect (feature `kinect-usb`),
//!   [`serial`] the one for a turntable; [`mod@supervise`] keeps it running;
//! * [`intake`]: a source's bounded way into the ledger, with its losses counted and posted; [`control`]: an operator's;
//! * [`ledger`]: the thread that makes the one order; [`outlet`]: the bounded ways out of it;
//! * [`clock`], [`arrival`]: the session's timeline and the kernel's stamps on it;
//! * [`probe`], `kinect_probe`: listening for a moment, outside of any ledger;
//! * [`send`]: the other end, a UDP sender that keeps a recording's pace; [`pty`]: a serial port without a device;
//! * [`stop`]: how every thread is told to end.
//!
//! Every queue has a bound and a policy; nothing is lost without a count.

pub mod arrival;
pub mod clock;
pub mod control;
pub mod intake;
#[cfg(feature = "kinect-usb")]
pub mod kinect_probe;
#[cfg(feature = "kinect-usb")]
pub mod kinect_usb;
pub mod ledger;
mod metronome;
pub mod outlet;
pub mod probe;
pub mod pty;
pub mod send;
pub mod serial;
pub mod source;
pub mod stop;
pub mod supervise;
pub mod udp;
mod udp_port;

pub use arrival::{Arrival, ArrivalClock};
pub use clock::{HostClock, HostSample, SessionClock, SessionInstant, SystemClock};
pub use control::{ControlError, ControlIntake};
pub use intake::{Delivery, Intake, LedgerClosed, QueueBound};
#[cfg(feature = "kinect-usb")]
pub use kinect_probe::{KinectProbed, probe_kinect};
#[cfg(feature = "kinect-usb")]
pub use kinect_usb::{KinectHint, KinectOpener, KinectSource, KinectUsbConfig};
pub use ledger::{Ledger, LedgerHandle, LedgerSummary, QueueFill};
pub use outlet::{Consumer, EventReceiver, OutletCounts, OutletGauge, Patience, ScanMark, WhenFull};
pub use probe::{Heard, UdpProbe, listen};
pub use pty::PseudoTerminal;
pub use send::{Pace, SendError, Sent, UdpSender};
pub use serial::{PortName, SerialConfig, SerialError, SerialOpener, SerialProtocol, SerialSource, SerialTrouble};
pub use source::{
    Device, KinectInfo, Opener, ReceiveBuffer, SerialInfo, Source, SourceCounters, SourceError, SourceInfo,
    SourceWarning, Summary, UdpInfo,
};
pub use stop::StopToken;
pub use supervise::{Backoff, Notice, Supervised, SupervisedSummary, supervise};
pub use udp::{UdpConfig, UdpOpener, UdpSource};
