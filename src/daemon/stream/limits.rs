//! The bounds of the stream. Each is there so that no client can cost the daemon more than it says.

use std::time::Duration;

/// What clients may take of the daemon. The defaults are what the contract names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at a time, over all listeners.
    pub clients: usize,
    /// Clients at a time of one address that is not this machine.
    pub clients_per_address: usize,
    /// Data lines waiting for one client; the oldest is dropped. At 50 lines a second: 1.3 s.
    pub data_lines: usize,
    /// Bytes of data lines waiting for one client; the oldest is dropped. A hundred CLOUD lines of 2 000 points.
    pub data_bytes: usize,
    /// Control lines waiting for one client; a client that lets more wait is closed, since none may be dropped.
    pub control_lines: usize,
    /// Bytes of control lines waiting for one client; likewise.
    pub control_bytes: usize,
    /// Lines a client may send in a second.
    pub requests_per_s: u32,
    /// A client that does not take a line within this time is cut off.
    pub lag: Duration,
    /// How long a connection that the server ends has to take its last lines.
    pub farewell: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            clients: 32,
            clients_per_address: 4,
            data_lines: 64,
            data_bytes: 8 << 20,
            control_lines: 64,
            control_bytes: 1 << 20,
            requests_per_s: 20,
            lag: Duration::from_secs(10),
            farewell: Duration::from_secs(1),
        }
    }
}
