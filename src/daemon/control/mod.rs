//! The control socket: operators' orders into a running session.
//!
//! ```text
//!   tumbled ctl ─▶ control.sock (0660) ─▶ a line of JSON ─▶ ledger ─▶ core        so a replay repeats it
//!   page ─────────▶ POST /api/control ────────────────┘        where [stream] http_control allows it
//! ```
//! What concerns recordings goes to the recorder beside the ledger.
//!
//! A Unix socket for its owner and group: the state stream, which a guidance computer reads over the network, takes no orders.

mod desk;
mod orders;
mod server;
mod socket;

pub use desk::Desk;
pub use orders::{Order, OrderLine, RecordingReply, Reply};
pub use server::{ControlServer, MOST_LINE_BYTES};
pub use socket::{ControlError, Listener};
