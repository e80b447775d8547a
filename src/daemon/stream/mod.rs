//! The state stream: one JSON object per line, over TCP and a Unix socket, to whoever connects.
//!
//! ```text
//!   daemon ─▶ Publisher ─▶ Hub ─▶ a Queue per client ─▶ the client's task ─▶ its socket
//!                                   ▲ bounded, oldest data dropped       ◀─ its requests
//!   StreamServer: listeners ─▶ accept ─▶ admitted, or refused with an ERROR
//! ```
//!
//! * [`class`], [`hello`], [`state`], [`health`], [`cloud`], [`point`], [`sigma`], [`model`], [`contour`], [`truth`],
//!   [`event`]: the lines and what is in them;
//! * [`subscriber`]: a client whose connection is another server's;
//! * [`frame`]: a line that many clients share; `queue`: what waits for one of them;
//! * [`request`]: what a client may ask for; `client`: its task;
//! * [`bind`], [`reach`], `accept`, [`limits`]: where it listens, who comes in, what each may take;
//! * [`hub`], [`server`]: all clients, and the server as the daemon sees it.
//!
//! Whoever publishes never waits: not for a client, not for the network. The protocol for users is `docs/stream.md`.

mod accept;
pub mod bind;
pub mod class;
mod client;
pub mod cloud;
pub mod contour;
pub mod event;
pub mod frame;
pub mod health;
pub mod hello;
pub mod hub;
pub mod limits;
pub mod model;
pub mod point;
mod queue;
pub mod reach;
pub mod request;
pub mod server;
pub mod sigma;
pub mod state;
pub mod subscriber;
pub mod truth;

pub use bind::StreamError;
pub use class::Class;
pub use cloud::{CloudKind, CloudLine, CloudView};
pub use contour::ContourLine;
pub use event::EventLine;
pub use frame::Sent;
pub use health::{
    HealthLine, QueueHealth, QueueUnit, RecorderHealth, RecorderStatus, ShellHealth, SimulationHealth, SourceHealth,
    StepHealth, StreamHealth,
};
pub use hello::{ErrorLine, Hello, StreamOrigin};
pub use hub::{ClientTotals, Publisher};
pub use limits::Limits;
pub use model::{ModelLine, ModelView};
pub use point::{Ahead, PointLine};
pub use server::{StreamAddresses, StreamConfig, StreamServer};
pub use sigma::SigmaLine;
pub use state::StateLine;
pub use subscriber::Subscriber;
pub use truth::TruthLine;
