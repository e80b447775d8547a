//! The operator's page and the metrics, over HTTP.
//!
//! ```text
//!   core ─▶ Latest (newest STATE and HEALTH, latencies) ─▶ /healthz /api/state /api/health /metrics
//!   state stream ─▶ a Subscriber per page, thinned out ──▶ /ws ─▶ the page at /
//! ```
//!
//! * [`latest`]: what answers are made of; [`metrics`]: the text for a monitoring system;
//! * [`server`]: what is served where; `door`: how many are served, and for how long; `reply`: who may ask;
//! * `pages`: the page's WebSocket; `transport`: a replay is steered.
//!
//! Orders are taken only where the config says so (`control`), and whoever measures waits for no reader. For users: `docs/page.md`.

pub mod control;
mod door;
pub mod latest;
pub mod metrics;
mod pages;
mod reply;
pub mod server;
mod transport;

pub use control::ControlDoor;
pub use latest::Latest;
pub use server::{WebConfig, WebError, WebServer};
