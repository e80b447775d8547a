//! From inputs and a config to decoded sensor data: what `export`, `info` and later the daemon share.
//!
//! ```text
//!   INPUT… ─ inputs ─▶ Event ─┬─ LidarPacket ─▶ lidar:  velodyne::StreamDecoder with the config's settings
//!                             └─ DepthFrame  ─▶ kinect: depth table, intrinsics, frozen-frame watch
//! ```

pub mod inputs;
pub mod kinect;
pub mod lidar;

pub use inputs::Inputs;
pub use kinect::KinectDecoder;
