//! The vocabulary every other crate speaks. Data and arithmetic only.
//!
//! * [`time`]: four kinds of time, four types, no conversion that could mix them up;
//! * [`civil`]: calendar dates and the hour a device's "microseconds past the hour" belong to;
//! * [`nmea`]: what a GPS receiver's sentence says about time;
//! * [`frames`]: rigid transforms whose frames the compiler checks;
//! * [`se3`]: rigid motion as twists;
//! * [`event`]: what the ledger holds: raw bytes with the instant the host first had them.
//!
//! ```text
//!   io (files, sockets, USB) ── Event ──▶ drivers (bytes → points, depth) ──▶ core
//! ```
#![forbid(unsafe_code)]

pub mod civil;
pub mod event;
pub mod frames;
pub mod nmea;
pub mod se3;
pub mod time;

pub use civil::{CivilTime, resolve_hour};
pub use event::{Body, Command, DepthEncoding, Event, LossPoint, PacketMask, SensorId, SourceState};
pub use frames::{Frame, Iso, Kinect, Lidar, Point, Rig, Stage, Target, UnitQuaternionError};
pub use se3::Twist;
pub use time::{KinectTicks, LidarTime, RigNs, Span, UnixNs};
