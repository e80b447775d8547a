//! What `calibrate` finds, as files and pages.
//!
//! * [`standstill`], [`gather`]: the poses of a recording;
//! * [`camera`]: the Kinect's geometry as the decoder has it;
//! * [`extrinsic`]: the Kinect's place, as JSON and in the file; [`extrinsic_page`], `drawing`: as a page;
//! * [`depth`], [`depth_page`]: the Kinect's lens and depths, alike;
//! * [`provenance`]: how a result was found, as it stands in the file;
//! * [`mod@file`]: the calibration file: read, one result replaced, written beside a copy of what was there;
//! * [`plays`]: inputs played through the core with changed configs, with the turntable's angles;
//! * [`turntable`], [`time`]: what `calibrate turntable` and `calibrate time` tell;
//! * [`frame`]: the report's page: the verdict first, then the gates, then what the result shows.

pub mod camera;
pub mod depth;
pub mod depth_page;
mod drawing;
pub mod extrinsic;
pub mod extrinsic_page;
pub mod file;
pub mod frame;
pub mod gather;
pub mod plays;
pub mod provenance;
pub mod standstill;
pub mod time;
pub mod turntable;

pub use provenance::{InputDigest, Provenance};
