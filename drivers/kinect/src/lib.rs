//! Kinect v1 depth: raw frames to metres, millimetres and points, and back.
//!
//! ```text
//!  device replies ─ reply ─▶ ZeroPlane (law) ─┐
//!  per-device CSV ─ table_csv ────────────────┴▶ DepthTable (table)
//!                                                     │
//!  frame bytes + lost packets ── depth ───────────────┴─▶ DepthImage │ MmImage │ RawImage
//!                                                              │
//!  Intrinsics ─▶ RayTable (rays), NoiseModel (noise) ── points ┴─▶ Points: x, y, z, σ_z, pixel
//! ```
//!
//! * [`frame`]: sizes of a frame and what its numbers mean; [`image`]: 640 × 480 of one kind of pixel;
//! * [`packed`]: the 11-bit stream as it is on the wire, read and written;
//! * [`law`]: the factory depth law, raw disparity ⇄ metres; [`reply`]: the law's constants from the device itself;
//! * [`table`]: 2 048 codes to depth, from a law or ([`table_csv`]) from a device's own calibration;
//! * [`loss`]: which pixels a lost USB packet takes with it; [`depth`]: bytes to images; [`counts`]: what went wrong how often;
//! * [`intrinsics`]: pinhole with Brown–Conrady distortion; [`rays`]: the same as a table per pixel;
//! * [`noise`]: how far a depth may be off; [`flying`]: pixels between two surfaces; [`points`]: depth images to points;
//! * [`warp`]: a camera's own error of depth over its image, taken out of the points;
//! * [`frozen`]: a device that sends one frame for ever; [`encode`]: frames for tests and the simulator.
//!
//! The usual way from bytes to points:
//!
//! ```
//! use tumbled_kinect::{BackProjector, DepthImage, DepthTable, Intrinsics, NoiseModel, Points, ZeroPlane, decode_metres};
//! use tumbled_model::{DepthEncoding, PacketMask};
//! # let law = ZeroPlane::default();
//! # let code = law.code_at(2.0).expect("in range");
//! # let frame = tumbled_kinect::encode_raw(&tumbled_kinect::RawImage::filled(code), DepthEncoding::Packed11)?;
//! let table = DepthTable::from_law(&ZeroPlane::default());
//! let projector = BackProjector::new(&Intrinsics::default(), &NoiseModel::default())?;
//! let (mut depth, mut points) = (DepthImage::new(), Points::new()); // kept: no allocation per frame
//!
//! decode_metres(DepthEncoding::Packed11, &frame, &PacketMask::NONE, &table, &mut depth)?;
//! projector.points(&depth, &mut points);
//! assert_eq!(points.len(), 307_200);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod counts;
pub mod depth;
pub mod encode;
pub mod flying;
pub mod frame;
pub mod frozen;
pub mod image;
pub mod intrinsics;
pub mod law;
pub mod loss;
pub mod noise;
pub mod packed;
pub mod points;
pub mod rays;
pub mod reply;
pub mod table;
pub mod table_csv;
pub mod warp;

pub use counts::DecodeCounts;
pub use depth::{DecodeError, FrameLoss, decode_metres, decode_mm, decode_raw};
pub use encode::{EncodeError, encode_mm, encode_raw};
pub use flying::without_flying;
pub use frame::{HEIGHT, PIXELS, RawDisparity, WIDTH, frame_bytes};
pub use frozen::{Freshness, FrozenDetector, RepeatCause};
pub use image::{DepthImage, Image, MmImage, RawImage};
pub use intrinsics::{Intrinsics, IntrinsicsError, Undistorted};
pub use law::ZeroPlane;
pub use loss::lost_pixels;
pub use noise::{DisparitySigma, NoiseModel};
pub use points::{BackProjector, Points};
pub use rays::{RayTable, UndistortReport};
pub use reply::{ReplyError, parse_const_shift, parse_zero_plane};
pub use table::DepthTable;
pub use table_csv::TableCsvError;
pub use warp::{DepthWarp, WARP_TERMS, WarpError};
