//! What this machine has: network interfaces, serial ports, Kinects on the USB.
//!
//! Looked up by name and without opening anything, so that nothing is reset, claimed or switched on by a look. What lies
//! in `/dev` and `/sys` is looked for below a root that tests replace.

pub mod interfaces;
pub mod kinect;
pub mod serial;
pub mod serial_line;
#[cfg(test)]
mod sysfs;
pub mod usb;

pub use interfaces::{Interface, Network, interfaces};
pub use kinect::{KinectFinding, camera_findings, kinect_cameras, kinect_findings, udev_rule};
pub use serial::{SerialAccess, SerialPort, serial_access, serial_ports};
pub use serial_line::{
    SerialHolder, byte_time, in_use_by, latency_timer_ms, serial_by_usb, serial_holders, shorten_latency, usb_serial,
};
pub use usb::{KinectModel, KinectPart, KinectUsb, kinects};
