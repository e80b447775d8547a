//! What is particular to an HDL-64E in `tumbled info`'s report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What an HDL-64E says about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hdl64eReport {
    /// `S1`, `S2` or `S3`; null while not recognised.
    pub generation: Option<String>,
    /// Where the calibration comes from.
    pub calibration: CalibrationSource,
    /// While no calibration is known: how much of the one in the stream has come.
    pub awaiting: Option<Awaiting>,
    /// Firmware: a number or four characters; null until said.
    pub firmware: Option<String>,
    /// Temperature inside, °C.
    pub temperature_c: Option<f32>,
    /// Date and time by the sensor's clock, RFC 3339; null until said, or when it was never set.
    pub date_time: Option<String>,
    /// GPS status, the character sent; `A`: a receiver vouches for the time. Null until said.
    pub gps_status: Option<String>,
    /// Warning bits in words; empty when none is set or none was said.
    pub warnings: Vec<String>,
    /// What the calibration in the stream says of the unit; null when it was not read.
    pub unit: Option<UnitReport>,
}

/// Where a calibration comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationSource {
    /// `lidar.calibration` in the config.
    File,
    /// The packets (S2, S3).
    InStream,
    /// None: no point can be placed.
    None,
}

/// How much of the calibration in the stream has come.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Awaiting {
    /// Bytes there.
    pub bytes: usize,
    /// Of so many.
    pub of: usize,
    /// Why the last full set was none.
    pub failure: Option<String>,
}

/// What the calibration in the stream says of the unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UnitReport {
    /// When it was calibrated, RFC 3339.
    pub calibrated: Option<String>,
    /// Speed set, turns per minute.
    pub rpm_set: i16,
    /// Field of view set: from, degrees.
    pub view_from_deg: f64,
    /// Field of view set: to, degrees.
    pub view_to_deg: f64,
    /// Hours of operation.
    pub hours: u16,
}
