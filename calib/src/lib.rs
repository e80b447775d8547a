//! Where a rig's sensors are relative to each other, and how well that is known. Pure: points in, numbers out.
//!
//! ```text
//!   views of still poses ─▶ board | sphere: found in both sensors ─▶ solved together ─▶ consistency ─▶ gates
//! ```
//!
//! * [`view`]: what two sensors saw of a pose; `blocks`: a camera's view made small;
//! * [`plane`], `robust`, `draws`: planes, weights, repeatable draws;
//! * [`board`]: a board; [`sphere`]: a sphere;
//! * [`fit`]: a result with its covariance; [`consistency`]: whether poses agree;
//! * [`coverage`]: whether they differ enough, in words;
//! * [`depth_camera`]: its lens, and its depths over the picture;
//! * [`turntable`]: a stage's axis in the rig; [`time`]: how late a sensor's stamps are;
//! * [`extrinsic`]: a result with its poses; [`gate`]: what it has to reach, and the verdict.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod blocks;
pub mod board;
pub mod consistency;
pub mod coverage;
pub mod depth_camera;
mod draws;
pub mod extrinsic;
pub mod fit;
pub mod gate;
pub mod plane;
mod robust;
pub mod sphere;
pub mod time;
pub mod turntable;
pub mod view;

pub use consistency::{Agreement, HeldOut, LeftOut, Split};
pub use extrinsic::{Extrinsic, PoseFigures, PoseOutcome};
pub use fit::{Fit, Unsolved};
pub use gate::{Gate, Status};
pub use view::{CameraView, LidarPoint, View};
