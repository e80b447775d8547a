//! Where a rig's sensors are relative to each other, and how well that is known. Pure: points in, numbers out.
//!
//! * [`gate`]: what a result has to reach, and the verdict.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod gate;

pub use gate::{Gate, Status};
