//! What happens between raw events and results: pure functions over values, no clock, file, socket or thread.
//!
//! ```text
//!   Event ─▶ pipeline ─▶ lidar:  decode ─ clock ─ reorder ─ assemble ─┐
//!               │        kinect: decode ─ clock ──────────────────────┴▶ align ─▶ epochs
//!               │                                    epochs ─▶ estimate ─▶ the target's states
//!               │        turntable: line ─ angle, truth ─▶ samples
//!               └──────▶ beat: states, health, notices
//! ```
//!
//! * [`pipeline`]: one event in, what follows out; start here;
//! * [`config`]: what the core has to know of the rig;
//! * [`clock`]: device stamps to the session's timeline, the wall clock and UTC beside it;
//! * [`sector`], [`boundary`]: the region of interest as a LiDAR's head sweeps over it, and where a scan begins;
//! * [`turntable`]: where a turntable was, and whether that is truth;
//! * [`cga`]: points, planes, spheres and motors of conformal geometric algebra;
//! * [`epoch`]: what a sensor saw at one time; [`health`], [`notice`]: what the core says of itself and its sensors;
//! * [`estimate`]: epochs to the target's state; [`segment`]: its points; [`track`]: its model; [`ukf`]: its motion;
//! * [`smooth`]: a session's frames to its whole motion; [`recon`]: registered frames to planes and a contour;
//! * [`register`]: two clouds of one body to the pose between them;
//! * [`neighbours`]: who is near whom;
//! * [`segment`]: which points are the target's;
//! * [`surface`]: a cloud as a surface of small spheres;
//! * [`evaluate`]: estimates held against the truth;
//! * [`workers`]: the threads it may use.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod align;
mod assemble;
mod beat;
pub mod boundary;
pub mod cga;
mod channel;
pub mod clock;
pub mod config;
pub mod epoch;
pub mod estimate;
pub mod evaluate;
pub mod health;
mod kinect;
mod lidar;
pub mod neighbours;
pub mod notice;
pub mod pipeline;
mod place;
mod reasons;
pub mod recon;
pub mod register;
mod reorder;
pub mod sector;
pub mod segment;
pub mod smooth;
pub mod surface;
pub mod track;
pub mod turntable;
pub mod ukf;
mod vitals;
pub mod workers;

pub use boundary::ScanBoundaries;
pub use clock::{
    ClockCounts, ClockMode, ClockParameters, ClockReport, ClockState, DeviceClock, DeviceClockKind, Mapped, Pushed,
    ResetCounts, UtcMap, UtcReading, WallClock,
};
pub use config::{CoreConfig, KinectSetup, LidarSetup, RegionOfInterest, Timing, TurntableProtocol, TurntableSetup};
pub use epoch::{Epoch, KinectScan, LidarScan, RigCloud, Scan, TimeBasis};
pub use health::{CoreHealth, Level, SensorHealth, SensorKind};
pub use notice::{Gravity, Notice, NoticeKind};
pub use pipeline::{Outputs, Pipeline};
pub use turntable::TurntableSample;
pub use workers::Workers;
