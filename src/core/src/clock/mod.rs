//! One timeline for every device.
//!
//! ```text
//!  raw stamp ──▶ unwrap ──▶ (x, y) ──▶ estimator ──▶ line ──▶ timeline ──▶ RigNs ± sigma
//!  arrived ───────────────────┘         hull                  slews, never
//!                                       arrival               goes back
//!                                       kalman
//! ```
//!
//! x is the device's time since the epoch's first stamp, y how much later than x the host had it; an epoch is a stretch
//! in which the device's counter ran on undisturbed. A packet can be late, never early, so the line under all (x, y) is
//! the device's clock and what lies above it is delay. What no host can see from arrivals alone is the least delay
//! itself: a mapped time is the time of measurement plus that constant, which calibration measures.
//!
//! * [`DeviceClock`]: the mapper, one per device;
//! * [`WallClock`]: what the host's wall clock said, and its steps;
//! * [`UtcMap`]: UTC from a sensor whose counter is locked to a GPS receiver's pulse.

mod estimator;
mod hull;
mod kalman;
mod kind;
mod line;
mod mapper;
mod report;
mod timeline;
mod unwrap;
mod utc;
mod wall;

pub use kind::{ClockParameters, DeviceClockKind};
pub use mapper::DeviceClock;
pub use report::{ClockCounts, ClockMode, ClockReport, ClockState, Mapped, Pushed, ResetCounts};
pub use utc::{UtcMap, UtcReading};
pub use wall::WallClock;
