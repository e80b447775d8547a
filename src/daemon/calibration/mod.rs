//! What `calibrate` finds, as files and pages.
//!
//! * [`provenance`]: how a result was found, as it stands in the file;
//! * [`file`]: the calibration file: read, one result replaced, written beside a copy of what was there;
//! * [`frame`]: the report's page: the verdict first, then the gates, then what the result shows.

pub mod file;
pub mod frame;
pub mod provenance;

pub use provenance::{InputDigest, Provenance};
