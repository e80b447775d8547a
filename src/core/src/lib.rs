//! What happens between raw events and results: pure functions over values, no clock, file, socket or thread.
//!
//! * [`clock`]: device stamps to the session's timeline, the wall clock and UTC beside it.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod clock;

pub use clock::{
    ClockCounts, ClockMode, ClockParameters, ClockReport, ClockState, DeviceClock, DeviceClockKind, Mapped, Pushed,
    ResetCounts, UtcMap, UtcReading, WallClock,
};
