//! The control socket: operators' orders into a running session.
//!
//! ```text
//!   tumbled ctl ─▶ control.sock (0660) ─▶ a line of JSON ─▶ ledger ─▶ core        so a replay repeats it
//! ```
//!
//! A Unix socket for its owner and group: the state stream, which a guidance computer reads over the network, takes no orders.

mod orders;
mod server;
mod socket;

pub use orders::{Order, OrderLine, Reply};
pub use server::{ControlServer, MOST_LINE_BYTES};
pub use socket::{ControlError, Listener};
