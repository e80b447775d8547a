//! One sender for those who tell epochs and those who tell predictions: its numbers go on over both.

use std::sync::{Arc, Mutex, PoisonError};

use super::datagram::Telemetry;
use super::sender::TelemetrySender;
use crate::config::TelemetryKinds;

/// A shared sender, and which states it is for. Clones share it.
#[derive(Clone, Debug)]
pub struct TelemetryOutlet {
    sender: Arc<Mutex<TelemetrySender>>,
    kinds: TelemetryKinds,
}

impl TelemetryOutlet {
    /// For states of these kinds.
    pub fn new(sender: TelemetrySender, kinds: TelemetryKinds) -> Self {
        Self { sender: Arc::new(Mutex::new(sender)), kinds }
    }

    /// Which states it is for; whoever has another one keeps it.
    pub const fn kinds(&self) -> TelemetryKinds {
        self.kinds
    }

    /// Sends a state.
    pub fn send(&self, telemetry: &Telemetry) {
        // A sender is whole between two datagrams.
        self.sender.lock().unwrap_or_else(PoisonError::into_inner).send(telemetry);
    }
}
