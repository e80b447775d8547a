//! From inputs and a config to decoded sensor data: what `export`, `info` and later the daemon share.
//!
//! ```text
//!   INPUT… ─ inputs ─▶ Event ─┬─ LidarPacket ─▶ lidar:  velodyne::StreamDecoder with the config's settings
//!                             └─ DepthFrame  ─▶ kinect: depth table, intrinsics, frozen-frame watch
//! ```
//! [`listening`] tells who speaks on the LiDARs' ports; [`turning`] how fast a head turns.

pub mod inputs;
pub mod kinect;
pub mod lidar;
pub mod listening;
pub mod turning;

pub use inputs::Inputs;
pub use kinect::KinectDecoder;
