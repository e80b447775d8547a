//! Velodyne packets to points and back. Pure: bytes in, values out.
//!
//! ```text
//!   payload ─ wire ─▶ blocks ─▶ points
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod azimuth;
pub mod beams;
pub mod clock;
pub mod decode;
pub mod detect;
pub mod encode;
pub mod hdl64;
pub mod models;
pub mod points;
pub mod position;
pub mod stream;
pub mod track;
pub mod wire;

pub use models::{Model, Product, ReturnMode};
pub use points::{LidarPoint, Points, Return};
pub use wire::{Bank, Block, DataPacket, WireError};
