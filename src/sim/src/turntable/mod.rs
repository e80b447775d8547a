//! A Zaber stage without hardware: the bytes it would answer, at the instants it would.
//!
//! ```text
//!   scripted angle + stall, slip ─┐
//!                                 ├─ stage ─▶ ZaberEmulator: request bytes in, reply bytes out ─▶ mishaps ─▶ pty, serial.log
//!   motion as commanded ──────────┘
//! ```
//!
//! * [`ScriptedStage`]: an angle for every instant, and what goes wrong with it; what the target stands on follows
//!   [`ScriptedStage::table`];
//! * [`CommandedStage`]: a stage that goes where it is told;
//! * [`ZaberEmulator`]: either of them behind a serial line;
//! * [`Mishaps`]: what happens to replies on the line; [`Conversation`]: a whole session on the line.

mod commanded;
mod emulator;
mod line_log;
mod mishaps;
mod scripted;

pub use commanded::CommandedStage;
pub use emulator::{EmulatorSettings, Latency, Outgoing, Stage, ZaberEmulator};
pub use line_log::{Conversation, LineLogSettings};
pub use mishaps::{Mishap, Mishaps};
pub use scripted::{ScriptedStage, StageFault, StageMotion, StageState};

/// The stage's name among a rig's sensors.
pub const SENSOR: &str = "turntable";
