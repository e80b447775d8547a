//! Velodyne packets to points and back. Pure: bytes in, values out.
//!
//! ```text
//!   payload ─┬─ position ─▶ clock: PPS, UTC
//!            └─ wire ─▶ detect (which model?) ─▶ azimuth (how far does the head turn?) ─▶ track (lost? silent?)
//!                          └─▶ decode with beams, or hdl64 with its calibration ─▶ points
//! ```
//!
//! * [`stream`]: all of it together, one decoder a sensor; start here;
//! * [`wire`]: the 1 206 bytes; [`models`]: what is built into each sensor; [`beams`]: the same, slot by slot;
//! * [`detect`]: the model by product byte, checked by the packet period;
//! * [`azimuth`]: turn per block, wrap, the jump of a limited field of view; [`decode`]: slots to points;
//! * [`heads`]: where the head stood during a packet; [`track`]: loss, order, pauses, speed; [`position`] and [`clock`]: what the sensor knows of UTC;
//! * [`hdl64`]: the HDL-64E, its calibrations and generations;
//! * [`encode`]: packets from values, for tests and the simulator.
//!
//! ```
//! use tumbled_model::{LidarTime, RigNs};
//! use tumbled_velodyne::encode::DataPacketBuilder;
//! use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
//! use tumbled_velodyne::{Model, ReturnMode};
//!
//! let mut packet = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
//! for block in 0..12u16 {
//!     packet.block(usize::from(block), 20 * block, &[(500, 80); 32]); // 500 counts of 4 mm
//! }
//! let mut decoder = StreamDecoder::new(Settings::default());
//! let mut decoded = Decoded::default(); // kept and cleared: no allocation per packet
//! decoder.push(&packet.stamp(LidarTime(7)).build(), RigNs(0), &mut decoded);
//! assert_eq!(decoded.points.len(), 384);
//! assert_eq!(decoded.points.range_m[0], 2.0);
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod azimuth;
pub mod beams;
pub mod clock;
pub mod decode;
mod decoded;
pub mod detect;
pub mod encode;
pub mod hdl64;
pub mod heads;
pub mod models;
mod order;
pub mod points;
pub mod position;
mod settings;
mod silence;
mod speed;
pub mod stream;
pub mod track;
pub mod wire;

pub use models::{Model, Product, ReturnMode};
pub use points::{LidarPoint, Points, Return};
pub use wire::{Bank, Block, DataPacket, WireError};
