//! Captures as other programs write them, for programs that are not ours: what the simulator makes beside a recording.
//!
//! * [`PcapFile`]: LiDAR packets as a network capture has them;
//! * [`FakenectFolder`]: depth frames as libfreenect's `fakenect-record` dumps them.

mod fakenect;
mod pcap;

pub use fakenect::FakenectFolder;
pub use pcap::PcapFile;
