//! The count of what was done.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What was done to one sensor's items.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FaultCounts {
    /// Items that came in: data packets, frames, chunks.
    pub items: u64,
    /// Lost singly or in bursts, a LiDAR's position packets left out.
    pub lost: u64,
    /// Position packets lost.
    pub lost_positions: u64,
    /// Bursts begun.
    pub bursts: u64,
    /// Repeated.
    pub duplicated: u64,
    /// Overtaken.
    pub overtaken: u64,
    /// With bytes changed.
    pub corrupted: u64,
    /// With a wrong length.
    pub resized: u64,
    /// Foreign payloads added.
    pub spoofed: u64,
    /// Come late.
    pub delayed: u64,
    /// Not come because the device was unplugged or restarting.
    pub silenced: u64,
    /// Restarts.
    pub reboots: u64,
    /// Replaced by an older payload.
    pub frozen: u64,
    /// Position packets with another pulse.
    pub pulses: u64,
    /// With a stamp moved by a set clock.
    pub stepped: u64,
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FaultTruth {
    /// By sensor.
    pub sensors: BTreeMap<String, FaultCounts>,
    /// Wall-clock anchors moved.
    pub anchors_stepped: u64,
}
