//! One LiDAR of `tumbled info`'s report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::hdl64e::Hdl64eReport;
use super::{RateClock, Refusal, Spread, WallTime};

/// One LiDAR.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LidarReport {
    /// Its id in the config.
    pub id: String,
    /// The model decoded as, spelt as in the config, e.g. `vlp-32c`; null when no packet was accepted.
    pub model: Option<String>,
    /// Where the model comes from; null without a model.
    pub model_source: Option<ModelSource>,
    /// What the packets themselves say they are from.
    pub claims: Vec<Claim>,
    /// Data packets decoded.
    pub data_packets: u64,
    /// Position packets read.
    pub position_packets: u64,
    /// Payloads that gave no points, by reason.
    pub rejected: Vec<Refusal>,
    /// Decoded data packets by return mode.
    pub return_modes: Vec<ModeCount>,
    /// Points decoded; no range limit applied.
    pub points: u64,
    /// Points by the return they are.
    pub returns: Returns,
    /// Share of the laser shots that had any return, 0 to 1; null without decoded packets.
    pub return_share: Option<f64>,
    /// Data packets that came per second, without those lost; of a limited view the mean over whole turns. Null when
    /// fewer than two came or no time tells.
    pub packets_per_s: Option<f64>,
    /// Points per second; null as `packets_per_s`.
    pub points_per_s: Option<f64>,
    /// The clock of the two rates.
    pub rate_clock: Option<RateClock>,
    /// Turns of the head per minute, mean over the inputs; null when less than two packets in a row tell it.
    pub rpm: Option<f64>,
    /// Whether z includes the heights at which the beams leave the sensor; null without a model.
    pub vertical_offsets: Option<bool>,
    /// Stamp of the first decoded packet, µs past the sensor's hour; null without one (HDL-64E S1).
    pub first_stamp_us: Option<u32>,
    /// Stamp of the newest decoded packet, µs past the sensor's hour.
    pub last_stamp_us: Option<u32>,
    /// Device time between the two, seconds, hours counted.
    pub device_span_s: Option<f64>,
    /// What the sensor knows of absolute time.
    pub clock: ClockReport,
    /// What the stamps say is missing; null for a sensor without a clock.
    pub loss: Option<LossReport>,
    /// Where it looks; null when not known: less than a turn seen, or no clock.
    pub field_of_view: Option<FieldOfView>,
    /// Ranges of the points, metres.
    pub range_m: Option<Spread>,
    /// HDL-64E only.
    pub hdl64e: Option<Hdl64eReport>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Where the model comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelSource {
    /// Byte 1205 of the packets.
    ProductByte,
    /// The flags of the packets' blocks (HDL-64E, which sends no product byte).
    BlockStructure,
    /// `lidar.model` in the config.
    Config,
}

/// What packets say they are from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// The product: a model as the config spells it, a product this program does not decode, or the byte.
    pub product: String,
    /// Data packets that say so.
    pub packets: u64,
}

/// Packets of one return mode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModeCount {
    /// `strongest`, `last` or `dual`.
    pub mode: String,
    /// Decoded data packets.
    pub packets: u64,
}

/// Points by return.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Returns {
    /// Strongest; in dual mode the second strongest when the strongest is also the last.
    pub strongest: u64,
    /// Last.
    pub last: u64,
    /// Dual mode: strongest and last are the same.
    pub both: u64,
}

/// What the sensor knows of absolute time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClockReport {
    /// How far the stamps are UTC, at the end of the inputs.
    pub state: ClockState,
    /// UTC of the first firing of the inputs' first decoded packet; null while the stamps are not UTC.
    pub first_firing: Option<WallTime>,
    /// Pulse per second as the newest position packet has it: `absent`, `synchronising`, `locked`, `error` or
    /// `unknown (BYTE)`; null without position packets.
    pub pps: Option<String>,
    /// How often that changed.
    pub pps_changes: u64,
    /// NMEA sentences of the position packets, by what they are worth.
    pub sentences: Sentences,
    /// Top board, °C; null where the firmware does not send it.
    pub temperature_top_c: Option<i8>,
    /// Bottom board, °C; null where the firmware does not send it.
    pub temperature_bottom_c: Option<i8>,
    /// Position packets that report a shutdown of the lasers because of heat.
    pub thermal_shutdowns: u64,
}

/// How far stamps are UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ClockState {
    /// The sensor has no clock (HDL-64E S1).
    None,
    /// No usable sentence: only differences of stamps mean anything.
    FreeRunning,
    /// A valid sentence that contradicts the stamps.
    Contradicted,
    /// A valid sentence agrees, no pulse is reported (old HDL-32E firmware never reports one).
    Sentence,
    /// Pulse locked, and a valid sentence that agrees.
    Locked,
}

/// NMEA sentences by what they are worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sentences {
    /// RMC that the receiver vouches for (status A).
    pub valid: u64,
    /// RMC with a warning (status V).
    pub void: u64,
    /// Wrong checksum.
    pub bad_checksum: u64,
    /// Position packets without any sentence.
    pub missing: u64,
    /// No RMC, or an unreadable one.
    pub unusable: u64,
}

/// What the stamps say is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LossReport {
    /// Packets sent and not in the inputs.
    pub lost: u64,
    /// Places where they are missing.
    pub gaps: u64,
    /// Most packets missing in one place.
    pub longest_gap: u64,
    /// Packets that came twice.
    pub duplicates: u64,
    /// Packets that came after a later one.
    pub late: u64,
    /// Times the counter was set anew; what was lost around it is not known.
    pub resets: u64,
    /// Silences of a limited field of view; not loss.
    pub pauses: u64,
}

/// Where the sensor looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldOfView {
    /// It is set to look at a part of the turn only.
    pub limited: bool,
    /// Azimuth of its first firing in a turn, degrees clockwise from above; 0 when not limited.
    pub from_deg: f64,
    /// Azimuth of its last firing in a turn, degrees; 360 when not limited.
    pub to_deg: f64,
    /// How long it is silent in a turn, milliseconds.
    pub pause_ms: f64,
}
