//! HDL-64E: 64 lasers in two banks, three generations, a factory calibration without which no point has a place.
//!
//! ```text
//!   db.xml, YAML, CSV ─ calibration ─┐            ┌─▶ points
//!   packet ─┬─ blocks ───────────────┼─ decoder ──┤
//!           └─ last six bytes ─ status, in_stream ┘─▶ status
//! ```
//!
//! * [`timing`]: the generations S1, S2, S3 and when their lasers fire;
//! * [`calibration`]: the 64 lasers; its formats are in `csv`, `db_xml` and `yaml`,
//!   the numbers they name in `field`;
//! * [`geometry`]: count to point and back, two-point correction, intensity;
//! * [`status`], [`in_stream`], [`pace`]: what the last six bytes of the packets add up to;
//! * [`decoder`] and [`encode`].

pub mod calibration;
mod csv;
mod db_xml;
pub mod decoder;
pub mod encode;
mod field;
pub mod geometry;
pub mod in_stream;
pub mod pace;
pub mod status;
pub mod timing;
mod yaml;

pub use calibration::{Calibration, CalibrationError, LASERS, LaserCalibration};
pub use decoder::{Hdl64Decoder, Hdl64Packet};
pub use encode::Hdl64Encoder;
pub use geometry::{Beams, Ray};
pub use in_stream::{InStream, InStreamError, Unit};
pub use status::{Firmware, Status, Warnings};
pub use timing::Generation;
