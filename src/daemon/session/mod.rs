//! A session: the ledger's events through the core, and what comes out to whoever wants it.
//!
//! ```text
//!   run:    sources ─▶ ledger ─┬─▶ recorder                      replay: INPUT… ─▶ pace ─▶ engine
//!                              └─▶ engine ─▶ publish ─▶ stream, viewers, log
//! ```
//!
//! * [`setup`]: from the config to what the core has to know;
//! * [`engine`], [`chain`]: the core with its hash chain, the same for every command; [`play`]: inputs through it;
//! * [`publish`], [`serve`], [`lines`]: what came out, as lines of the stream, the log and files;
//! * [`beat`]: predicted states between epochs, at a steady rate;
//! * [`surface`], [`contour`]: the target's surface and its edges, for people;
//! * [`live`], [`sources`], [`kinects`]: a session on live sensors, started and ended in order; `standing`: how each source
//!   stands; [`shell`], [`steps`]: the session's health;
//! * [`recordings`], `witness`: recordings ordered meanwhile; [`run_info`]: what people say of a run;
//! * [`reload`]: what of a config may change meanwhile; [`pace`]: how fast a recording is played, [`transport`] by whose
//!   orders.

pub mod beat;
pub mod chain;
pub mod contour;
pub mod engine;
pub mod kinects;
pub mod lines;
pub mod live;
pub mod pace;
pub mod play;
pub mod publish;
pub mod recordings;
pub mod reload;
pub mod run_info;
pub mod serve;
pub mod service;
pub mod setup;
pub mod shell;
pub mod sources;
mod standing;
pub mod steps;
pub mod surface;
pub mod transport;
mod witness;

pub use chain::Checkpoint;
pub use engine::{Engine, Step};
pub use live::{LiveSession, SessionEnd};
pub use pace::{Pace, Speed};
pub use publish::Publish;
pub use sources::{Rig, SourceReport};
