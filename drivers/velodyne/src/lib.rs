//! Velodyne packets to points and back. Pure: bytes in, values out.
//!
//! ```text
//!   payload ─ wire ─▶ blocks ─▶ points
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod azimuth;
pub mod beams;
pub mod decode;
pub mod models;
pub mod points;
pub mod position;
pub mod wire;

pub use points::{LidarPoint, Points, Return};
pub use wire::{Bank, Block, DataPacket, WireError};
